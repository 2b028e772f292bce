"""One pixel whose light comes at another time than it should kept `photon` from its start.

Each pixel's own delay follows a step of the climb, by all that its counts ask for: three hundred ps
of a pulse of seventy, where they no longer say so. However short the step the likelihood fell, by
140,000, and the path was that of the start, "check" (`scatter`: the fit stopped).
"""

import numpy as np
import pytest

from benchmarks.random_labs import drawn_lab, path_of, pulls_of
from lightflight.reconstruct.model.information import ascend


class _Swaying:
    """A parabola, whose value falls by as much on every step that is tried."""

    def __init__(self, at: np.ndarray, sway: float) -> None:
        self.at, self.sway = at, sway
        self.information, self.score = np.eye(2), -at
        self.value = -0.5 * float(at @ at) - sway


@pytest.mark.parametrize(("start", "is_top"), [(0.3, True), (30.0, False)])
def test_a_climb_ends_where_no_step_leads_higher_and_none_would_lead_far(start, is_top):
    tried = []

    def slope_at(at):
        tried.append(at)
        # What follows a step loses more than it gains.
        return _Swaying(at, 1e3 * (len(tried) > 1))

    at, _, converged = ascend(
        np.array([start, 0.0]), slope_at, lambda at, _, step: at + step, most_steps=40
    )
    assert converged is is_top
    assert at[0] == start


@pytest.mark.long
def test_a_path_by_all_counts_is_trusted_and_right():
    lab = drawn_lab(302)
    path = path_of(lab, "photon")
    assert path.goodness.converged
    assert path.verdict.level == "trust"
    assert pulls_of(lab, path)[:, 0].mean() < 2.0
