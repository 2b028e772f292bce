"""An arm that explains all that a path leaves was none: wings of its bright legs, three spots from
them and more, counted as light of no leg, a hundred of 416 pulses at 25 of chi-square each.

Laboratory 4033 of `benchmarks/piece_labs.py`, beam splitter, 48,000 photons: two legs, contradicted
("2.5 of the light lies about the path").
"""

import numpy as np
import pytest

from benchmarks.piece_labs import drawn_scene, path_of, pulls_of, right_legs
from lightflight.flight import Medium
from lightflight.reconstruct.fit.joint import fit_joint
from lightflight.reconstruct.model.geometry import PathState
from lightflight.reconstruct.model.setting import Setting
from lightflight.reconstruct.sightings import sighting_from_histograms
from lightflight.reconstruct.verdict.lost import cost_of_pulses
from tests.labs import START_PS, blurred_leg


@pytest.mark.long
def test_it_is_an_arm():
    """Farthest of two places on each leg below 4.5 stated errors (false alarm 1e-4 for all)."""
    scene = drawn_scene("splitter", 4033)
    path = path_of(scene)
    assert right_legs(scene, path)
    assert path.verdict.level == "trust"
    assert pulls_of(scene, path)[:, 1].max() < 4.5


def test_a_wing_costs_about_as_much_as_any_light_that_is_right():
    """Of 402 to 408 pulses 114 to 120 beyond what the leg claims: 1.8 to 2.1 of chi-square each.

    Not one, since a fit of a few photons is not Gaussian; as light of no leg it is 25 each.
    """
    lab = blurred_leg()
    setting = Setting(lab.camera, lab.known, Medium())
    sighting = sighting_from_histograms(
        lab.recording(1), setting, timing=lab.timing, background=None, exclude_mask=None,
        least_squares=False,
    )  # fmt: skip
    fit = fit_joint([sighting], PathState(lab.vertices_mm, START_PS), setting, legs=None)
    n, n_used = len(sighting.usable_pulses), np.count_nonzero(fit.times.weight)
    assert n - n_used > 100
    assert cost_of_pulses(fit, [sighting]) < n + 2.0 * (n - n_used)
