"""Two thirds of the time of three legs went into the fit of a mirror where there is none.

Shares of light that is not there leave the plane free: it wandered through all thirty rounds, and
was then refused. After six it is asked whether what is still to come could be enough. With more
patience one was found all the same: of pulses fitted once and of those fitted to the end, which it
was held against, the latter are narrower, and explain 28 more.
"""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import lightflight as lf
from lightflight.reconstruct.model.second_path import SecondPath
from lightflight.reconstruct.other_light import strengths, twice
from lightflight.reconstruct.other_light.second_path import LEAST_GAIN
from tests.labs import three_legs


def path_and_rounds(monkeypatch):
    rounds = []
    drawn = SecondPath.images

    def counted(second):
        rounds.append(second)
        return drawn(second)

    with monkeypatch.context() as patched:
        patched.setattr(SecondPath, "images", counted)
        lab = three_legs()
        path = lf.reconstruct(
            lab.recording(1, 4000.0), camera=lab.camera, source=lab.timed, timing=lab.timing
        )
    return path, len(rounds)


@pytest.mark.parametrize(("gained", "explains"), [(-1.0, False), (1.0, True)])
def test_what_comes_twice_is_held_against_pulses_that_were_fitted_to_the_end(gained, explains):
    """Those that were fitted once explain 28 less: that is no mirror's."""

    def pulses_alone(*, to_the_end=False, **_):
        least = 1_000.0 + LEAST_GAIN + gained
        return SimpleNamespace(misfit=lambda: least if to_the_end else least + 28.0)

    known: Any = SimpleNamespace(misfit=lambda: 1_000.0, lags_ps=None)
    asked: Any = SimpleNamespace(strengths=pulses_alone)
    assert twice._explains(known, asked) == explains


@pytest.mark.long
def test_they_are_given_up_and_the_path_is_the_same(monkeypatch):
    """A recording whose search for a mirror found a start: nothing of it may change."""
    path, few = path_and_rounds(monkeypatch)
    monkeypatch.setattr(strengths, "_PATIENCE", 100)
    patient, many = path_and_rounds(monkeypatch)
    assert 0 < few <= 10 < many
    np.testing.assert_array_equal(path.vertices_mm, patient.vertices_mm)
    np.testing.assert_array_equal(path.covariance, patient.covariance)
