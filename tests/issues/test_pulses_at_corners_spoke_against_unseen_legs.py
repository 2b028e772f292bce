"""Of two ways that nobody saw the wrong one won, since pulses that two legs light together counted
as light of no leg: 40 of 317 lay about one corner, each at the price of a five-sigma error. So did
the wings of bright legs.

Laboratory 4016 of `benchmarks/piece_labs.py`, unseen legs: six legs without a way unseen,
contradicted ("index off by 0.11"); it is the right path now, "check". Of 4019 a leg of 2 px about
the corner stayed, which no pulse spoke for: paths with unseen legs were not revised as others are.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.piece_labs import drawn_scene, path_of, pulls_of, right_legs
from lightflight.reconstruct.verdict.lost import cost_of_light
from tests.labs import blurred_leg, corner_in_view, fit_from_truth

pytestmark = pytest.mark.filterwarnings("ignore::lightflight.errors.LightflightWarning")


@pytest.mark.long
@pytest.mark.parametrize("seed", [4016, 4019])
def test_light_that_was_out_of_the_picture(seed):
    """Farthest of two places on each leg below five stated errors (false alarm 1e-5 for all)."""
    scene = drawn_scene("unseen", seed)
    path = path_of(scene)
    assert right_legs(scene, path)
    assert path.verdict.level == "check"
    assert pulls_of(scene, path)[:, 1].max() < 5.0


def test_light_of_two_legs_costs_as_much_as_any_that_is_right():
    """Some 100 pulses, seven of them about the corner: 100 of chi-square, four sigma wide.

    Late by 300 ps these seven are as much in the way as before, 25 each.
    """
    lab = corner_in_view()
    fit, sighting, setting = fit_from_truth(lab, lab.recording(1, 20_000.0))
    n = len(sighting.usable_pulses)
    left = np.setdiff1d(sighting.usable_pulses, fit.times.index[fit.times.weight > 0])
    assert len(left) > 4
    right = cost_of_light(fit, [sighting], setting)
    assert right == pytest.approx(n, abs=4.0 * np.sqrt(2.0 * n))
    late = sighting.arrival_ps.copy()
    late[left] += 300.0
    wrong = cost_of_light(fit, [replace(sighting, arrival_ps=late)], setting)
    assert wrong - right == pytest.approx(24.0 * len(left), abs=10.0)


def test_a_wing_costs_about_as_much_as_any_light_that_is_right():
    """Of 402 to 408 pulses 114 to 120 beyond what the leg claims: 1.8 to 2.1 of chi-square each.

    Not one, since a fit of a few photons is not Gaussian; as light of no leg it is 25 each.
    """
    lab = blurred_leg()
    fit, sighting, setting = fit_from_truth(lab, lab.recording(1))
    n, n_used = len(sighting.usable_pulses), np.count_nonzero(fit.times.weight)
    assert n - n_used > 100
    assert cost_of_light(fit, [sighting], setting) < n + 2.0 * (n - n_used)
