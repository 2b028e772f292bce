"""What can be wrong with a world or with what is told of it, each at three strengths.

Strengths and the rule that holds a third of the defects out were fixed before any result was seen.
Where a strength stands for a place in a list (which axis, which unit) its docstring says so.
"""

from __future__ import annotations

import hashlib
import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache

import numpy as np

from tests.oracles.worlds.clock import pf32_clock
from tests.oracles.worlds.mistakes import (
    another_calibration,
    bent,
    detoured,
    emission_in_other_units,
    glinting,
    half_out,
    in_metres,
    legs_told_wrong,
    mirrored_picture,
    outside,
    piled_up,
    swapped_field,
    turned_picture,
    walled,
    wrong_distance,
)
from tests.oracles.worlds.world import NODE_MM, World

Change = Callable[[World, float], World]


@dataclass(frozen=True)
class Defect:
    """One thing that is wrong, and how wrong it may be."""

    name: str
    finding: str
    """Name of the finding (issue 14) that should come of it."""
    strengths: tuple[float, float, float]
    unit: str
    change: Change

    @property
    def held_out(self) -> bool:
        """True for those that are never used while the checks are developed: a third of all, by
        the SHA-1 of their names."""
        return self.name in _held_out()

    def applied(self, world: World, strength: float) -> World:
        """The world with this defect."""
        return self.change(world, strength)


def _share(name: str, **others: float) -> Change:
    return lambda world, strength: world.but(**{name: strength, **others})


def _view(change: Callable[[World, float], object]) -> Change:
    return lambda world, strength: world.but(view=change(world, strength))


def _lens(world: World, corner_px: float) -> World:
    """A radial stretch that moves the picture's corner by so many pixels."""
    view = world.view
    r = view.corner_slope()
    k1 = view.lens[0] + corner_px / (math.hypot(*view.shape) / 2) / r**2
    return world.but(view=replace(view, lens=(k1, view.lens[1])))


def _index(world: World, out: float, back: float) -> World:
    return world.but(path_index=world.path_index + out, return_index=world.return_index + back)


def _source(axis: int) -> Change:
    return lambda world, mm: world.told_but(source_mm=world.told.source_mm + mm * np.eye(3)[axis])


def _drift(world: World, ps: float, repeats: int = 1) -> World:
    return world.but(drift_ps=ps, repeats=repeats)


def _dust(world: World, gain: float) -> World:
    """A grain in the beam halfway along its first leg."""
    n = int(world.length_mm() / NODE_MM) + 2
    log = world.log_brightness.copy() if world.log_brightness.size else np.zeros(n)
    half = float(np.linalg.norm(world.vertices[1] - world.vertices[0])) / 2
    log[round(half / NODE_MM)] += math.log(gain)
    return world.but(log_brightness=log)


def _stale_gains(world: World, share: float) -> World:
    """Of the gains, phases and delays, this share has become another camera's."""
    return another_calibration(world, share, own=pf32_clock(world.pixel_seed, world.view.shape))


_TABLE: tuple[tuple[str, str, tuple[float, float, float], str, Change], ...] = (
    ("haze_500ps", "haze", (0.05, 0.2, 0.5), "share", _share("haze", haze_ps=500.0)),
    ("haze_150ps", "haze", (0.05, 0.2, 0.5), "share", _share("haze", haze_ps=150.0)),
    ("haze_2ns", "haze", (0.05, 0.2, 0.5), "share", _share("haze", haze_ps=2000.0)),
    ("late_halo", "halo", (0.05, 0.2, 0.5), "share", _share("late_halo")),
    ("late_narrow_halo", "halo", (0.05, 0.2, 0.5), "share",
     _share("late_halo", late_halo_std_px=3.0, late_halo_ps=300.0)),
    ("prompt_halo_3px", "halo", (0.05, 0.2, 0.5), "share", _share("halo", halo_std_px=3.0)),
    ("prompt_halo_8px", "halo", (0.05, 0.2, 0.5), "share", _share("halo", halo_std_px=8.0)),
    ("crosstalk", "halo", (0.01, 0.05, 0.2), "share", _share("crosstalk")),
    ("defocus", "halo", (0.6, 1.0, 2.0), "px", _share("spot_std_px")),
    ("veiling_glare", "glare", (0.01, 0.05, 0.2), "share", _share("glare")),
    ("glare_of_a_late_room", "glare", (0.02, 0.1, 0.3), "share",
     _share("late_halo", late_halo_std_px=60.0, late_halo_ps=3000.0)),
    ("wall_60mm", "unexplained_light", (0.03, 0.1, 0.3), "share", walled(60.0)),
    ("wall_250mm", "unexplained_light", (0.03, 0.1, 0.3), "share", walled(250.0)),
    ("lens_ghost", "unexplained_light", (0.002, 0.01, 0.05), "share", _share("ghost")),
    ("glint", "unexplained_light", (0.02, 0.1, 0.3), "share", glinting),
    ("lamp", "unexplained_light", (0.2, 0.5, 1.0), "share",
     lambda w, s: w.but(lamp=s, background_per_ps=10.0 * w.background_per_ps)),
    ("screaming_pixels", "unexplained_light", (0.01, 0.07, 0.2), "share", _share("screaming")),
    ("dead_pixels", "scatter", (0.02, 0.1, 0.3), "share", _share("dead")),
    ("dust", "scatter", (2.0, 5.0, 20.0), "times", _dust),
    ("second_pulse_3ns", "other_pulse", (0.03, 0.1, 0.5), "share",
     _share("second", second_ps=3000.0)),
    ("second_pulse_1ns", "other_pulse", (0.03, 0.1, 0.5), "share",
     _share("second", second_ps=1000.0)),
    ("pulse_before_2ns", "other_pulse", (0.03, 0.1, 0.5), "share",
     _share("second", second_ps=-2000.0)),
    ("pulse_echo_300ps", "other_pulse", (0.03, 0.1, 0.3), "share",
     _share("second", second_ps=300.0)),
    ("response_tail", "shape", (0.03, 0.1, 0.3), "share", _share("tail", tail_ps=200.0)),
    ("response_long_tail", "shape", (0.03, 0.1, 0.3), "share", _share("tail", tail_ps=700.0)),
    ("response_jitter", "shape", (0.1, 0.3, 0.6), "relative", _share("jitter")),
    ("clock_late", "clock_offset", (3.0, 10.0, 50.0), "ps", _share("offset_ps")),
    ("clock_early", "clock_offset", (-3.0, -10.0, -50.0), "ps", _share("offset_ps")),
    ("codes_longer", "clock_scale", (2e-4, 1e-3, 5e-3), "relative", _share("scale")),
    ("codes_shorter", "clock_scale", (-2e-4, -1e-3, -5e-3), "relative", _share("scale")),
    ("drift_in_one", "clock_drift", (10.0, 20.0, 50.0), "ps", _drift),
    ("drift_over_four", "clock_drift", (10.0, 20.0, 50.0), "ps", lambda w, s: _drift(w, s, 4)),
    ("walk", "walk", (3.0, 10.0, 30.0), "ps", _share("walk_ps")),
    ("walk_other_way", "walk", (-3.0, -10.0, -30.0), "ps", _share("walk_ps")),
    ("pile_up_misstated", "pile_up", (0.05, 0.2, 0.5), "occupancy", piled_up(1, 4000)),
    ("pile_up_of_ten_periods", "pile_up", (0.2, 0.5, 0.9), "occupancy", piled_up(10, 4000)),
    ("uneven_codes", "calibration", (0.02, 0.06, 0.2), "relative", _share("uneven_codes")),
    ("stale_delays", "calibration", (5.0, 20.0, 100.0), "ps", _share("stale_delay_ps")),
    ("stale_gains", "calibration", (0.01, 0.05, 0.3), "share", _stale_gains),
    ("other_camera", "calibration", (1.0, 2.0, 3.0), "camera",
     lambda w, s: another_calibration(w, 1.0, number=int(s))),
    ("camera_aside", "pose", (1.0, 2.5, 5.0), "mm", _view(lambda w, s: w.view.moved([s, 0, 0]))),
    ("camera_above", "pose", (1.0, 2.5, 5.0), "mm", _view(lambda w, s: w.view.moved([0, s, 0]))),
    ("camera_nearer", "pose", (1.0, 2.5, 5.0), "mm", _view(lambda w, s: w.view.moved([0, 0, s]))),
    ("camera_turned", "pose", (0.2, 0.5, 1.0), "deg",
     _view(lambda w, s: w.view.turned([0, math.radians(s), 0]))),
    ("camera_tipped", "pose", (0.2, 0.5, 1.0), "deg",
     _view(lambda w, s: w.view.turned([math.radians(s), 0, 0]))),
    ("camera_rolled", "pose", (0.2, 0.5, 1.0), "deg",
     _view(lambda w, s: w.view.turned([0, 0, math.radians(s)]))),
    ("focal_length_longer", "focal_length", (5e-3, 2e-2, 5e-2), "relative",
     _view(lambda w, s: w.view.zoomed(s))),
    ("field_235_not_245", "focal_length", (-0.01, -0.04, -0.1), "relative",
     _view(lambda w, s: w.view.zoomed(s))),
    ("wrong_distance", "pose", (0.01, 0.05, 0.2), "relative", wrong_distance),
    ("barrel", "distortion", (-0.3, -1.0, -3.0), "px at the corner", _lens),
    ("pincushion", "distortion", (0.3, 1.0, 3.0), "px at the corner", _lens),
    ("index", "index", (1e-3, 1e-2, 0.33), "", lambda w, s: _index(w, s, s)),
    ("index_of_the_path", "index", (1e-3, 1e-2, 0.47), "", lambda w, s: _index(w, s, 0.0)),
    ("index_to_the_camera", "index", (1e-3, 1e-2, 0.33), "", lambda w, s: _index(w, 0.0, s)),
    ("bend_in_picture", "curved_leg", (1.0, 5.0, 20.0), "mm sagitta",
     lambda w, s: bent(w, s, 0.0)),
    ("bend_in_depth", "curved_leg", (1.0, 5.0, 20.0), "mm sagitta",
     lambda w, s: bent(w, 0.0, s)),
    ("unseen_detour", "unseen_leg", (20.0, 60.0, 150.0), "mm", detoured),
    ("leg_half_out", "unseen_leg", (0.5, 1.0, 2.0), "half pictures", half_out),
    ("leg_outside", "unseen_leg", (0.1, 0.3, 1.0), "half pictures", outside),
    ("leg_count", "leg_count", (1.0, -1.0, -2.0), "legs", legs_told_wrong),
    ("metres", "units", (1.0, 2.0, 3.0), "all | source | camera", in_metres),
    ("emission_unit", "units", (1.0, 2.0, 3.0), "ns | codes | s", emission_in_other_units),
    ("swapped_field", "orientation", (1.1, 1.3, 1.6), "width / height", swapped_field),
    ("turned_picture", "orientation", (1.0, 2.0, 3.0), "transposed | 90 | 180 deg", turned_picture),
    ("mirrored_picture", "orientation", (1.0, 2.0, 3.0), "left right | up down | up down, told n",
     mirrored_picture),
    ("source_off_x", "source", (3.0, 10.0, 100.0), "mm", _source(0)),
    ("source_off_y", "source", (3.0, 10.0, 100.0), "mm", _source(1)),
    ("source_off_z", "source", (3.0, 10.0, 100.0), "mm", _source(2)),
)  # fmt: skip

DEFECTS = {row[0]: Defect(*row) for row in _TABLE}


@cache
def _held_out() -> frozenset[str]:
    ranked = sorted(DEFECTS, key=lambda name: hashlib.sha1(name.encode()).hexdigest())
    return frozenset(ranked[: math.ceil(len(ranked) / 3)])


def defects(*, held_out: bool | None = None) -> tuple[Defect, ...]:
    """All defects, or those that are (True) or are not (False) held out."""
    every = tuple(DEFECTS.values())
    return every if held_out is None else tuple(d for d in every if d.held_out == held_out)
