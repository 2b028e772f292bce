"""A world: all that decides how many photons each code of each pixel expects, and what is told.

Shares (haze, halos, glare, tail, crosstalk) move light from where it belongs and keep its total;
additions (second pulse, wall, glint) bring their own. Zero everywhere is the undisturbed world.
mm, ps, pixel, counts.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

import numpy as np

from tests.oracles.worlds.clock import PERFECT, Clock
from tests.oracles.worlds.view import View

C = 299_792_458.0 * 1e3 / 1e12
AIR = 1.00027
NODE_MM = 5.0
"""Distance of the brightness nodes along the path."""


@dataclass(frozen=True)
class Prior:
    """One-sigma errors that the user states; 0: told as exact, inf: unknown."""

    source_mm: float = 0.0
    emission_ps: float = 0.0
    position_mm: float = 0.0
    rotation_deg: float = 0.0
    focal_share: float = 0.0
    lens: float = 0.0
    index: float = 0.0
    offset_ps: float = 0.0
    scale: float = 0.0


KNOWN = Prior()
LAB = Prior(source_mm=1.0, emission_ps=math.inf)
HONEST = Prior(
    position_mm=0.5, rotation_deg=0.1, focal_share=2e-3, lens=5e-3, index=1e-4, offset_ps=5.0,
    scale=2e-4,
)  # fmt: skip
PRIORS = {"known": KNOWN, "lab": LAB, "honest": HONEST}


@dataclass(frozen=True, eq=False)
class Arm:
    """Light that leaves the beam at a splitter and goes a way of its own."""

    vertices: np.ndarray
    """(k, 3), from the splitter on, mm."""
    share: float
    """Of the light before the splitter."""
    start_ps: float
    """Event time at the splitter."""


@dataclass(frozen=True, eq=False)
class Told:
    """What the user states; the truth where nothing is wrong, or within the prior of it."""

    view: View
    source_mm: np.ndarray
    emission_ps: float
    clock: Clock = PERFECT
    """The clock that was calibrated."""
    prior: Prior = KNOWN
    path_index: float = AIR
    return_index: float = AIR
    pulse_fwhm_ps: float = 68.0
    n_legs: int | None = None
    n_frames: int | None = None
    periods_per_frame: int | None = None


@dataclass(frozen=True, eq=False)
class World:
    """The truth of one recording, and what the user says of it."""

    vertices: np.ndarray
    """(m, 3), mm."""
    view: View
    told: Told
    emission_ps: float = 26_000.0
    path_index: float = AIR
    return_index: float = AIR
    bends_mm: tuple[tuple[float, float], ...] = ()
    """Sagitta of each leg in the picture and in depth; (): straight."""
    jumps: np.ndarray | None = None
    """(m, 4), where the next leg starts relative to each vertex (mm, and ps later)."""

    flux: float = 1.0
    """Photons that a pixel of area one (px²) would get per mm of path from a mm away."""
    photons: float = 40_000.0
    """Signal that the brightest pixel was meant to expect when the flux was set."""
    log_brightness: np.ndarray = field(default_factory=lambda: np.zeros(0))
    """Log of the light along the path, a node every `NODE_MM` from the source; (): even."""
    leg_log_flux: tuple[float, ...] = ()
    """Log of what the mirrors leave of the light on each leg; (): all of it."""
    brightness_std: float = 0.0
    """Of the prior that the nodes were drawn from (correlated over 10 mm)."""
    spot_std_px: float = 0.35
    spot_tilt_ln: float = 0.0
    """Log of the spot at the picture's right edge over that in its middle."""
    defocus_px_per_mm: float = 0.0
    """How the spot's blur grows with the distance from the plane in focus (added in squares)."""
    focus_mm: float = 535.0
    """Distance of that plane from the pupil, along the axis."""
    efficiency_std: float = 0.0
    """Relative spread of the pixels' efficiencies."""
    active_side_px: float = 0.122
    std_ps: float = 70.0
    """Laser and detector together."""
    tail: float = 0.0
    tail_ps: float = 200.0
    jitter: float = 0.0
    """Relative spread of `std_ps` between pixels."""

    haze: float = 0.0
    haze_ps: float = 500.0
    halo: float = 0.0
    halo_std_px: float = 3.0
    late_halo: float = 0.0
    late_halo_std_px: float = 8.0
    late_halo_ps: float = 600.0
    glare: float = 0.0
    ghost: float = 0.0
    """Of a lens between whose faces light goes to and fro: the picture turned about its middle."""
    ghost_std_px: float = 1.0
    ghost_ps: float = 30.0
    crosstalk: float = 0.0
    second: float = 0.0
    second_ps: float = 3000.0
    wall: float = 0.0
    wall_depth_mm: float = 1000.0
    """Of the mirror image's plane, square to the optical axis, from the pupil."""
    arms: tuple[Arm, ...] = ()
    """What splitters send elsewhere; `leg_log_flux` says what they leave."""
    glint: float = 0.0
    """Light of a bright thing beside the path, as a share of all that the picture sees."""
    glint_mm: np.ndarray = field(default_factory=lambda: np.zeros(3))
    glint_ps: float = 0.0
    """When light leaves it, on the clock of event times."""

    background_per_ps: float = 0.0
    lamp: float = 0.0
    """Relative change of the background from the picture's left to its right."""
    dead: float = 0.0
    screaming: float = 0.0
    stale_delay_ps: float = 0.0
    """Spread of pixel delays that nobody calibrated."""
    skew_ps: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Delays that nobody calibrated, of the last row and column against the middle, and of the rim
    (ends of the longer side), which grows with the square."""
    pixel_seed: int = 0

    clock: Clock = PERFECT
    offset_ps: float = 0.0
    scale: float = 0.0
    uneven_codes: float = 0.0
    slow_codes_ps: float = 0.0
    """By how much codes run ahead and fall behind, in turn, of those that were calibrated."""
    slow_codes_period_ps: float = 3000.0
    drift_ps: float = 0.0
    """Delay gained from the first photon of the recording (of all repeats) to the last."""
    repeats: int = 1
    walk_ps: float = 0.0
    """How much earlier a pixel as bright as `photons` is seen than a dark one."""
    frames: float = math.inf
    """inf: a camera that can see every photon; else the first of each frame counts."""
    periods_per_frame: int = 4000
    picture: str = "as seen"
    """Of the recording: "transposed", "left right", "up down", "turned 90", "turned 180"."""

    @property
    def n_legs(self) -> int:
        return len(self.vertices) - 1

    @property
    def n_pixels(self) -> int:
        return self.view.shape[0] * self.view.shape[1]

    def length_mm(self) -> float:
        return float(np.linalg.norm(np.diff(self.vertices, axis=0), axis=1).sum())

    def vertex_times_ps(self) -> np.ndarray:
        steps = np.linalg.norm(np.diff(self.vertices, axis=0), axis=1)
        return self.emission_ps + self.path_index * np.append(0.0, np.cumsum(steps)) / C

    def but(self, **changes: object) -> World:
        return replace(self, **changes)  # type: ignore[arg-type]

    def told_but(self, **changes: object) -> World:
        return replace(self, told=replace(self.told, **changes))  # type: ignore[arg-type]
