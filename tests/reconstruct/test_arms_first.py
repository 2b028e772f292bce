"""Arms are tried before other light is looked for, and stay where the tests let them."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest

from lightflight.errors import NothingFoundError
from lightflight.path.verdict import Level
from lightflight.reconstruct import answer
from lightflight.reconstruct.trials import arms as trials
from lightflight.reconstruct.verdict import arms
from lightflight.reconstruct.ways import joint, photon
from lightflight.reconstruct.ways.request import Request


@pytest.mark.parametrize(
    ("misfit", "left", "taken"), [(900.0, 100.0, True), (900.0, 500.0, False), (60.0, 1.0, False)]
)
def test_arms_that_pay_and_take_up_most_are_taken(
    monkeypatch: pytest.MonkeyPatch, misfit: float, left: float, taken: bool
) -> None:
    """An arm of 300 pulses costs 70 of chi-square."""
    sightings: Any = [SimpleNamespace(usable_pulses=range(300))]
    costs = {"plain": 300.0 + misfit, "forked": 300.0 + left}
    monkeypatch.setattr(arms, "cost_of_pulses", lambda fit, _: costs[fit])
    monkeypatch.setattr(arms, "with_arms", lambda *_: "forked")
    plain: Any = "plain"
    found: Any = arms.with_arms_for_most(plain, sightings, None)  # type: ignore[arg-type]
    assert (found == "forked") is taken


@pytest.mark.parametrize("level", list(Level))
def test_a_path_with_arms_stays_where_tests_let_it(
    monkeypatch: pytest.MonkeyPatch, level: Level
) -> None:
    asked: list[bool] = []

    def fit(request: Request) -> tuple[Any, None]:
        asked.append(request.arms_first)
        return ((2, 1),) if request.arms_first else (), None

    def judged(forks: Any, *_: object) -> Any:
        return SimpleNamespace(forks=forks, verdict=SimpleNamespace(level=level, findings=()))

    monkeypatch.setattr(answer, "_judged", judged)
    monkeypatch.setattr(answer, "_may_fork", lambda *_: True)
    estimator: Any = SimpleNamespace(fit=fit)
    setting: Any = None
    timing: Any = "measured"
    found, _ = answer._found_first(Request([], setting, timing), estimator)
    stays = level is not Level.CONTRADICTED
    assert bool(found.forks) is stays
    assert asked == ([True] if stays else [True, False])
    asked.clear()
    found, _ = answer._found_first(Request([], setting), estimator)
    assert asked == [False]


def test_other_light_is_looked_for_with_the_arms(monkeypatch: pytest.MonkeyPatch) -> None:
    """Where they are asked for; a chain's light is looked for about the chain."""
    monkeypatch.setattr(joint, "_fit_as_found", lambda *_, **__: ("plain", ()))
    monkeypatch.setattr(joint, "without_short_pieces", lambda fit, _: f"{fit} of long pieces")
    monkeypatch.setattr(joint, "with_arms_for_most", lambda *_: "forked")
    monkeypatch.setattr(joint, "_with_other_light", lambda fit, _: fit)
    setting: Any = SimpleNamespace(curves=(), source=SimpleNamespace(position_mm=(0.0, 0.0, 0.0)))
    timing: Any = "measured"
    for arms_first, found in ((True, "forked of long pieces"), (False, "plain of long pieces")):
        request = Request([], setting, timing, arms_first=arms_first)
        got: Any = joint.fit_of_request(request)
        assert got == found


@pytest.mark.parametrize(("n_legs", "tried"), [(8, 8), (9, 0)])
def test_light_on_many_legs_is_no_arms(
    monkeypatch: pytest.MonkeyPatch, n_legs: int, tried: int
) -> None:
    """A fit for each start of 76 legs took more than ten minutes of a real recording."""
    starts: list[int] = []
    monkeypatch.setattr(trials, "unclaimed_by_path", lambda *_: None)
    monkeypatch.setattr(trials, "legs_among", lambda *_: list(range(n_legs)))
    monkeypatch.setattr(trials, "_straight_on", lambda *_: [])

    def begun(_: Any, leg: int, *__: Any) -> list[Any]:
        starts.append(leg)
        return []

    monkeypatch.setattr(trials, "_starts", begun)
    setting: Any = SimpleNamespace(cameras=("one",), at=lambda _: None)
    fit: Any = SimpleNamespace(solution=SimpleNamespace(state=None))
    sightings: Any = [SimpleNamespace(view=0)]
    assert trials.fits_with_arm(sightings, fit, setting) == []
    assert len(starts) == tried


def test_arms_from_which_the_counts_lead_nowhere_are_none(monkeypatch: pytest.MonkeyPatch) -> None:
    """All counts go on from the path without; what they refuse there stays refused."""

    def fit_of(request: Request) -> Any:
        forks = ((2, 1),) if request.arms_first else ()
        return SimpleNamespace(solution=SimpleNamespace(state=SimpleNamespace(forks=forks)))

    def of_all_counts(fit: Any, *_: object) -> str:
        if fit.solution.state.forks or refuse_all:
            raise NothingFoundError("the counts lead nowhere")
        return "without arms"

    monkeypatch.setattr(photon, "fit_of_request", fit_of)
    monkeypatch.setattr(photon, "path_of_fit", lambda *_: None)
    monkeypatch.setattr(photon, "path_of_all_counts", of_all_counts)
    setting: Any = None
    refuse_all = False
    found: Any = photon.path_by_photon(Request([], setting, arms_first=True))[0]
    assert found == "without arms"
    refuse_all = True
    with pytest.raises(NothingFoundError, match="lead nowhere"):
        photon.path_by_photon(Request([], setting, arms_first=True))
