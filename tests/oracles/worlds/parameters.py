"""What a world can be off by, as named numbers that are zero where it stands.

`nudged(world, name, amount)` is the world with one of them changed; `CAUSES` says which of them
each finding of issue 14 would free.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from tests.oracles.worlds.world import NODE_MM, World

POSE = ("shift_right", "shift_down", "shift_forward", "turn_right", "turn_down", "turn_forward")

_STEPS = {
    "emission": 0.5, "background": 0.05, "std_ps": 0.5, "spot_std_px": 0.005,
    "focal_length": 2e-4, "k1": 2e-3, "path_index": 2e-5, "return_index": 2e-5, "index": 2e-5,
    "offset_ps": 0.5, "scale": 2e-5, "drift_ps": 0.5, "walk_ps": 0.5,
    "wall_depth_mm": 0.05, "second_ps": 0.5,
}  # fmt: skip
_ONE_SIDED = {
    "haze": 1e-3, "halo": 1e-3, "late_halo": 1e-3, "glare": 1e-3, "crosstalk": 1e-3,
    "ghost": 1e-3,
    "second": 1e-3, "wall": 1e-3, "glint": 1e-3, "tail": 1e-3, "pile_up": 1e-3,
    "uneven_codes": 1e-3,
}  # fmt: skip
"""Shares of light and what is linear in them: counts may not become negative."""

_FAMILIES = {"x": 0.05, "y": 0.05, "z": 0.05, "bend_picture": 0.1, "bend_depth": 0.1, "jump": 0.1}

_PLAUSIBLE = {
    "x": 30.0, "y": 30.0, "z": 30.0, "bend_picture": 20.0, "bend_depth": 20.0, "jump": 200.0,
    "shift": 20.0, "turn": 0.1, "focal_length": 0.1, "k1": 1.0, "path_index": 0.5,
    "return_index": 0.5, "offset_ps": 500.0, "scale": 0.02, "drift_ps": 200.0, "walk_ps": 50.0,
    "second": 1.0, "pile_up": 1.0,
}  # fmt: skip
_PLAUSIBLE_SHARE = 0.5

SHAPES = (
    "haze_ps", "halo_std_px", "late_halo_std_px", "late_halo_ps", "second_ps", "tail_ps",
    "wall_depth_mm", "glint_mm", "glint_ps", "ghost_std_px", "ghost_ps",
)  # fmt: skip
"""What a share's own parameter does not say: taken from the world that is to be explained."""


def step_of(name: str) -> tuple[float, bool]:
    """(size of a step, whether it may be taken both ways)."""
    if name in _ONE_SIDED:
        return _ONE_SIDED[name], False
    if name in _STEPS:
        return _STEPS[name], True
    if name in POSE:
        return (0.05, True) if name.startswith("shift") else (5e-5, True)
    return _FAMILIES[name.rstrip("0123456789xyzt_") or name[0]], True


def plausible(name: str) -> float:
    """One-sigma size that a cause may have before it is no explanation."""
    family = name.partition("_")[0] if name.startswith(("shift", "turn", "jump")) else name
    late = name.startswith("jump") and name.endswith("t")
    family = family if family in _PLAUSIBLE else name.rstrip("0123456789_")
    return _PLAUSIBLE.get(family, _PLAUSIBLE_SHARE) * (5.0 if late else 1.0)


def nudged(world: World, name: str, amount: float) -> World:
    """The world with one of its numbers changed by an amount."""
    view = world.view
    if name in POSE:
        vector = np.zeros(3)
        vector[POSE.index(name) % 3] = amount
        return world.but(view=view.moved(vector) if name[0] == "s" else view.turned(vector))
    if name in _SPECIAL:
        return _SPECIAL[name](world, amount)
    if name in ("std_ps", "spot_std_px"):
        now = getattr(world, name)
        return world.but(**{name: now * math.exp(amount / now)})
    if name in _STEPS or name in _ONE_SIDED:
        return world.but(**{name: getattr(world, name) + amount})
    return _nudged_path(world, name, amount)


def _nudged_path(world: World, name: str, amount: float) -> World:
    if name[0] in "xyz":
        vertices = np.array(world.vertices, dtype=float)
        vertices[int(name[1:]), "xyz".index(name[0])] += amount
        return world.but(vertices=vertices)
    family, _, where = name.rpartition("_")
    if family == "log_flux":
        gains = np.array(world.leg_log_flux or [0.0] * world.n_legs)
        gains[int(where)] += amount
        return world.but(leg_log_flux=tuple(gains.tolist()))
    if family == "light":
        nodes = np.zeros(max(int(world.length_mm() / NODE_MM) + 3, world.log_brightness.size))
        nodes[: world.log_brightness.size] = world.log_brightness
        nodes[int(where)] += amount
        return world.but(log_brightness=nodes)
    if family == "jump":
        jumps = np.zeros((len(world.vertices), 4)) if world.jumps is None else world.jumps.copy()
        jumps[int(where[:-1]), "xyzt".index(where[-1])] += amount
        return world.but(jumps=jumps)
    bends = [list(pair) for pair in world.bends_mm or [(0.0, 0.0)] * world.n_legs]
    bends[int(where)][int(family == "bend_depth")] += amount
    return world.but(bends_mm=tuple((pair[0], pair[1]) for pair in bends))


def _index(world: World, amount: float) -> World:
    return world.but(path_index=world.path_index + amount, return_index=world.return_index + amount)


def _occupied(world: World, amount: float) -> World:
    frames = world.photons / amount if amount > 0.0 else math.inf
    return world.but(frames=frames, periods_per_frame=1)


_SPECIAL: dict[str, Callable[[World, float], World]] = {
    "emission": lambda w, a: w.but(emission_ps=w.emission_ps + a),
    "background": lambda w, a: w.but(background_per_ps=w.background_per_ps * math.exp(a)),
    "focal_length": lambda w, a: w.but(view=w.view.zoomed(a)),
    "k1": lambda w, a: w.but(view=replace(w.view, lens=(w.view.lens[0] + a, w.view.lens[1]))),
    "index": _index,
    "pile_up": _occupied,
}


def _unseen(n_legs: int) -> tuple[str, ...]:
    corners = range(1, n_legs) if n_legs > 1 else range(1)
    return tuple(f"jump_{corner}{axis}" for corner in corners for axis in "xyzt")


def causes(n_legs: int) -> dict[str, tuple[str, ...]]:
    """Parameters that each finding frees when it is asked whether it explains a recording."""
    bends = tuple(f"bend_{way}_{leg}" for leg in range(n_legs) for way in ("picture", "depth"))
    return {
        "source": ("x0", "y0", "z0"),
        "unexplained_light": ("wall", "glint"),
        "shape": ("tail",),
        "unseen_leg": _unseen(n_legs),
        "curved_leg": bends,
        "haze": ("haze",),
        "halo": ("halo", "late_halo", "crosstalk"),
        "glare": ("glare",),
        "other_pulse": ("second",),
        "index": ("path_index", "return_index"),
        "focal_length": ("focal_length",),
        "distortion": ("k1",),
        "pose": POSE,
        "clock_offset": ("offset_ps",),
        "clock_scale": ("scale",),
        "clock_drift": ("drift_ps",),
        "walk": ("walk_ps",),
        "pile_up": ("pile_up",),
        "calibration": ("uneven_codes",),
    }
