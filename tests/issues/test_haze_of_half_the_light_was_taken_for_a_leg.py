"""Half of the light late by 500 ps moved corners by 14 mm, or made four legs of three.

Legs were sought in pulses fitted without a tail, and lines in the picture by light of other legs.
"""

from __future__ import annotations

import warnings
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest

import lightflight as lf
from lightflight.reconstruct.fit.joint import pulse_std_ps
from lightflight.reconstruct.model.setting import Setting
from lightflight.reconstruct.model.sighting import Sighting
from lightflight.reconstruct.other_light.tail import shape_with_tail
from lightflight.reconstruct.sightings import sighting_from_histograms
from lightflight.timing.pulses.amplitudes import amplitudes_at_times
from tests.oracles.worlds.border import record, what_the_user_tells
from tests.oracles.worlds.defects import DEFECTS
from tests.oracles.worlds.random_worlds import random_world


@pytest.mark.long
@pytest.mark.usefixtures("unexamined")
def test_three_legs_are_right_within_their_errors():
    """40,000 photons, source and emission known; false alarm 1e-4. Before: 51 mm off."""
    world = random_world(288, 3).but(haze=0.5, haze_ps=500.0)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        path = lf.reconstruct(record(world, 288), **what_the_user_tells(world))
    assert path.n_legs == 3
    off = (path.vertices_mm - world.vertices)[1:-1]
    assert np.abs(off).max() < 0.5
    assert (np.abs(off) < 4.5 * path.vertex_std[1:-1, :3]).all()


@pytest.mark.parametrize(
    ("defect", "strength", "has_tail"),
    [
        ("", 0.0, False),
        ("haze_500ps", 0.5, True),
        ("haze_150ps", 0.2, True),
        ("wall_60mm", 0.1, False),
    ],
)
def test_a_tail_is_told_from_an_echo_before_any_path_is_known(defect, strength, has_tail):
    world = random_world(288, 1)
    if defect:
        assert not DEFECTS[defect].held_out
        world = DEFECTS[defect].applied(world, strength)
    told = what_the_user_tells(world)
    setting = Setting(told["camera"], told["source"], told["medium"], (), ())
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        seen = sighting_from_histograms(
            record(world, 288), setting, timing=told["timing"], background=None,
            exclude_mask=None, least_squares=False,
        )  # fmt: skip
    found = shape_with_tail(seen, nominal=False)
    assert (found is not None) == has_tail
    if found is not None:
        assert found[1] == pytest.approx(world.std_ps, rel=0.03)
        # Widths are those of the light that is not late.
        assert pulse_std_ps([seen]) == pytest.approx(world.std_ps, rel=0.05)


def test_a_halo_does_not_say_how_wide_pulses_are():
    """Many dim pixels showed a halo's wide pulses: paths 1 to 7 mm off, strengths of nothing."""
    stds = np.concatenate((np.full(60, 70.0), np.full(900, 220.0)))
    photons = np.concatenate((np.full(60, 20_000.0), np.full(900, 300.0)))
    arrivals = SimpleNamespace(std_ps=stds, photons=photons, usable=np.ones(960, dtype=bool))
    seen = cast(Sighting, SimpleNamespace(arrivals=arrivals))
    assert pulse_std_ps([seen]) == 70.0


def test_photons_of_a_leg_are_counted_without_what_is_diffuse():
    """Codes of 20 ps: expected counts of a pulse, a background and light of a known course."""
    edges = np.arange(0.0, 20_000.0, 20.0)
    lower, upper = edges[np.newaxis, :-1], edges[np.newaxis, 1:]
    middle = 0.5 * (lower + upper)
    pulse = 5_000.0 * 20.0 * np.exp(-0.5 * ((middle - 9_000.0) / 70.0) ** 2)
    other = 40.0 * np.exp(-np.abs(middle - 8_800.0) / 500.0)
    counts = pulse / (70.0 * np.sqrt(2.0 * np.pi)) + 0.5 + other
    at = np.array([[9_000.0]]), np.array([[70.0]])
    known = amplitudes_at_times(counts, lower, upper, None, *at, other)
    assert known[0][0, 0] == pytest.approx(5_000.0, rel=1e-3)
    assert known[2][0] == pytest.approx(0.5 / 20.0, rel=1e-3)
    assert amplitudes_at_times(counts, lower, upper, None, *at)[0][0, 0] > 5_300.0
