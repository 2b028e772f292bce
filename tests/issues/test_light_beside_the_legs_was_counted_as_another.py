"""Light beside the legs was expected at another strength than it had been measured at.

Repeats lent `photon` the further pulses of the first alone, a fourth of four; known pile-up thinned
the light of the legs but not what was beside it, and let a pixel have no more photons than were
counted; and each repeat was fitted with the width that pulses seem to have, tail and all.
"""

import warnings

import numpy as np
import pytest

import lightflight as lf
from lightflight.errors import LightflightWarning, NothingFoundError
from lightflight.reconstruct.all_counts import counts
from lightflight.reconstruct.all_counts.strangers import counts_of_pulses
from lightflight.reconstruct.fit.fine import finely_lit
from lightflight.reconstruct.model.cells import Cells, lag_edges
from lightflight.reconstruct.model.counted import cumulated, lit_pixels
from lightflight.reconstruct.model.expected_counts import Pulses
from lightflight.reconstruct.other_light import diffuse, twice
from lightflight.reconstruct.verdict import taken_up
from lightflight.reconstruct.verdict.count_evidence import evidence_from_counts
from lightflight.reconstruct.ways import joint
from tests.oracles.miss import error_and_covariance
from tests.oracles.worlds.border import record, what_the_user_tells
from tests.oracles.worlds.defects import DEFECTS
from tests.oracles.worlds.mistakes import piled_up
from tests.oracles.worlds.random_worlds import random_world


def disturbed(name, strength, seed):
    assert not DEFECTS[name].held_out
    return DEFECTS[name].applied(random_world(seed, 1), DEFECTS[name].strengths[strength])


def found(world, seed, method="joint", **told):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", LightflightWarning)
        return lf.reconstruct(
            record(world, seed), method=method, **what_the_user_tells(world) | told
        )


@pytest.mark.long
def test_further_pulses_of_repeats_are_as_bright_as_in_all(monkeypatch):
    """A pulse before the beam's, a tenth of its light: four repeats show it four times."""
    seen = []

    def kept(*given):
        counts = counts_of_pulses(*given)
        seen.append(float(counts.sum()))
        return counts

    monkeypatch.setattr(counts, "counts_of_pulses", kept)
    # As light that the model has no place for: a second pulse on the same path has one.
    monkeypatch.setattr(twice, "second_pulse_in", lambda *_: None)
    world = disturbed("pulse_before_2ns", 1, 288)
    for repeats in (1, 4):
        found(world.but(repeats=repeats), 288, "photon")
    # Chance: 0.3 %; pulses that are too dim to be found in one of four are 2 %.
    assert seen[-1] == pytest.approx(seen[0], rel=0.05)


def test_each_repeat_is_fitted_with_the_pulse_of_all(monkeypatch):
    """In a tail of a tenth pulses seem 9 % wider than their cores are."""
    ratios, measured = [], diffuse._measured

    def kept(known, *given):
        ratios.append(float(np.median(known.pixels.std_ps[:, 0] / known.pulses.std_ps[:, 0])))
        return measured(known, *given)

    monkeypatch.setattr(diffuse, "_measured", kept)
    found(disturbed("response_long_tail", 1, 288).but(repeats=2), 288)
    # Chance: 0.3 %.
    np.testing.assert_allclose(ratios, 1.0, atol=0.015)


def test_more_photons_come_than_are_counted():
    """Expected counts of pulses of which all after the first half of their light is seen half."""
    edges = np.tile(lag_edges(70.0, 56.0, 1.3, 50_000.0), (2, 1))
    middle = 0.5 * (edges[:, 1:] + edges[:, :-1])
    share = np.where(middle > 0.0, 0.5, 1.0)
    came = 40_000.0 * np.diff(cumulated(edges, np.zeros(2), np.full(2, 70.0), 0.0), axis=1)
    counts = share * (came + 1e-3 * np.diff(edges, axis=1))
    cells = Cells(edges, counts, share > 0.0, 0.0 * share, share)
    pixels = lit_pixels(cells, Pulses(np.zeros((2, 1)), np.full((2, 1), 70.0)))
    np.testing.assert_allclose(pixels.photons[:, 0], 40_000.0, rtol=1e-3)
    np.testing.assert_allclose(pixels.late_ps[:, 0], 0.0, atol=0.05)


@pytest.mark.usefixtures("unexamined", "nothing_twice")
def test_known_pile_up_thins_haze_as_it_thins_the_legs():
    """Four of five frames occupied, ten periods each; false alarm 2e-4, and it was 3.3 errors."""
    world = piled_up(10, 10)(disturbed("haze_500ps", 1, 288), 0.8)
    path = found(world, 288, "photon")
    error, stated = error_and_covariance(path, world.vertices)
    assert np.sqrt(error @ np.linalg.solve(stated, error) / 2.0) < 2.9


def test_codes_never_measured_are_so_for_light_taken_up(monkeypatch):
    asked = []

    def kept(*given, **told):
        asked.append(told["nominal"])
        return evidence_from_counts(*given, **told)

    monkeypatch.setattr(taken_up, "evidence_from_counts", kept)
    found(disturbed("haze_500ps", 1, 288), 288, timing=None)
    assert asked == [True]


def test_a_fit_that_diffuse_light_leaves_in_the_middle_is_as_it_was(monkeypatch):
    """Lines were those measured without that light, times those with it."""
    shown = []

    def failing(fit, *_):
        shown.append(fit)
        raise NothingFoundError("too few pulses are left")

    def kept(fit, *given):
        shown.append(fit)
        return finely_lit(fit, *given)

    monkeypatch.setattr(diffuse, "fitted_again", failing)
    monkeypatch.setattr(diffuse, "finely_lit", kept)
    left = []

    def ended(*given, **told):
        left.append(diffuse.with_diffuse(*given, **told))
        return left[-1]

    monkeypatch.setattr(joint, "with_diffuse", ended)
    found(disturbed("haze_500ps", 1, 288), 288)
    before, pictured_anew = shown
    assert left == [before]
    assert pictured_anew.pictures is not before.pictures
