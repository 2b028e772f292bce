"""Each of two cameras alone showed a path of two legs, right and trusted; both together did not.

Legs of both pictures were put together to a corner 350 mm off, 1,900 stated errors, and
contradicted at 37 sigma (`benchmarks/piece_labs.py --only cameras --first 43 --labs 1`).
"""

from __future__ import annotations

import importlib
from types import SimpleNamespace
from typing import Any

import pytest

from benchmarks.piece_labs import drawn_scene, path_of, pulls_of, right_legs
from lightflight.path.verdict import Finding, FindingName, Level, Severity, Verdict
from tests.path_fakes import make_path

pytestmark = pytest.mark.filterwarnings("ignore::lightflight.errors.LightflightWarning")

FINDING = Finding(FindingName.UNEXPLAINED_LIGHT, "", 9.0, "", Severity.CONTRADICTED)
CONTRADICTED = make_path(verdict=Verdict(Level.CONTRADICTED, (FINDING,)))
TRUSTED = make_path(verdict=Verdict(Level.TRUST, ()))
answer = importlib.import_module("lightflight.reconstruct.answer")


def answered(
    found: Any, others: tuple[str, ...], start: Any, monkeypatch: Any, of_fit: Any = True
) -> tuple[Any, int]:
    """The path, and how many of the cameras were begun with; the second one's is right."""
    begun: list[int] = []

    def fits(_: Any) -> Any:
        for camera in range(2):
            begun.append(camera)
            yield camera

    monkeypatch.setattr(answer, "fits_begun_by_one_camera", fits)
    monkeypatch.setattr(answer, "_told", lambda fit, *_: (fit, fit))
    monkeypatch.setattr(answer, "_judged", lambda fit, *_: (CONTRADICTED, TRUSTED)[fit])
    request = SimpleNamespace(setting=SimpleNamespace(others=others), start=start)
    estimator = SimpleNamespace(of_fit=of_fit)
    return answer._begun_by_one_camera(found, request, estimator), len(begun)


def test_what_one_camera_shows_begins_where_both_led_nowhere(monkeypatch):
    assert answered(CONTRADICTED, ("second",), None, monkeypatch) == (TRUSTED, 2)


@pytest.mark.parametrize(
    ("found", "others", "start"),
    [(TRUSTED, ("second",), None), (CONTRADICTED, (), None), (CONTRADICTED, ("second",), TRUSTED)],
    ids=["it stands", "one camera", "told where to start"],
)
def test_nothing_more_is_tried(found, others, start, monkeypatch):
    path, begun = answered(found, others, start, monkeypatch)
    assert path is found
    assert begun == 0


def test_an_estimator_that_takes_no_fit_keeps_its_path(monkeypatch):
    """One that somebody added, of several cameras: it ended in an AssertionError."""
    assert answered(CONTRADICTED, ("second",), None, monkeypatch, None) == (CONTRADICTED, 0)


@pytest.mark.long
@pytest.mark.parametrize("method", ["joint", "photon"])
def test_the_corner_is_where_it_is(method):
    scene = drawn_scene("cameras", 43)
    path = path_of(scene, method)
    assert right_legs(scene, path)
    assert path.verdict.level is Level.TRUST
    assert (pulls_of(scene, path)[:, 1] < 5.0).all()
