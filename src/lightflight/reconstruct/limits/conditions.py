"""How a path is recorded, as far as its bound cares, and the light that follows from it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import BSpline

from lightflight.arguments import finite_number
from lightflight.display import Shown
from lightflight.flight import Medium, Source
from lightflight.reconstruct.model.forward import CodeCounts, Local, Pixels
from lightflight.reconstruct.model.geometry import PathState, footprints
from lightflight.reconstruct.model.glass import looks_at_blocks
from lightflight.reconstruct.model.image_plane import pixels_of_undistorted, undistorted_px
from lightflight.reconstruct.model.leg_in_picture import (
    DARK_LEG,
    LegInPicture,
    leg_in_picture,
    lit_by_legs,
)
from lightflight.reconstruct.model.pulse_shape import tables_for_counts
from lightflight.reconstruct.model.sighting import clock_errors
from lightflight.reconstruct.model.strength import strength_spline
from lightflight.reconstruct.model.unknowns import Light
from lightflight.timing.clock.response import Response
from lightflight.units import std_from_fwhm

if TYPE_CHECKING:
    from lightflight.camera.model import Camera
    from lightflight.timing.clock.code_clock import CodeClock

Floats = NDArray[np.float64]

_REACH_STDS = 12.0
"""Codes cover the flight, and this many stds of a pulse before and after it."""

_LEAST, _MOST = 1e-6, 1e12
"""Photons, ps or pixels: what lies beyond is no recording, and its matrices are singular."""


@dataclass(frozen=True, eq=False, repr=False)
class Conditions(Shown):
    """How a path is recorded, as far as the bound cares.

    Attributes
    ----------
    photons_per_pixel : float
        Expected signal photons in the brightest pixel.
    spot_std_px : float
        Optics and active area, px.
    pulse_std_ps : float
        Laser pulse and response, tail and all, ps.
    response : Response or None
        Shape of a recorded pulse, stretched to that width; None: a Gaussian.
    code_width_ps : float
        Width of a code, ps.
    background_per_ps : float
        Background counts per pixel and ps.
    pixel_std_ps : float
        Calibration error of each pixel, ps.
    timing : CodeClock or None
        A clock whose errors count beside that.
    strength : Callable[[array of float, int], array of float] or None
        Scattering strength per mm at path lengths on a leg; None: even.
    """

    photons_per_pixel: float
    spot_std_px: float
    pulse_std_ps: float
    response: Response | None
    code_width_ps: float
    background_per_ps: float
    pixel_std_ps: float
    timing: CodeClock | None
    strength: Callable[[Floats, int], Floats] | None


def spot_std_of(subject: object, *, finer: float = 1.0) -> float:
    """Std of optics and active area, px; among pixels `finer` times as many the lens blurs more."""
    detector = getattr(subject, "detector", None)
    optics = getattr(detector, "psf_std_px", None)
    if optics is None:
        return 0.35 * finer
    return float(np.hypot(optics * finer, getattr(detector, "active_width_px", 0.0) / np.sqrt(12)))


def conditions_of(
    subject: object,
    source: Source,
    *,
    photons_per_pixel: float,
    spot_std_px: float | None,
    pulse_std_ps: float | None,
    response: Response | None,
    code_width_ps: float | None,
    background_per_code: float | None,
    pixel_std_ps: float,
    timing: CodeClock | None,
) -> Conditions:
    """What the call says of the recording; what it leaves open, the subject, else the paper's.

    Parameters and their defaults are those of `bounds`.
    """
    must = f"be positive, from {_LEAST:g} to {_MOST:g}"
    finite_number("photons_per_pixel", photons_per_pixel, must, low=_LEAST, high=_MOST)
    widths = {
        "spot_std_px": spot_std_px, "pulse_std_ps": pulse_std_ps, "code_width_ps": code_width_ps,
    }  # fmt: skip
    for name, value in widths.items():
        if value is not None:
            finite_number(name, value, must, low=_LEAST, high=_MOST)
    must = f"be from 0 to {_MOST:g}"
    finite_number("pixel_std_ps", pixel_std_ps, must, low=0.0, high=_MOST)
    if background_per_code is not None:
        finite_number("background_per_code", background_per_code, must, low=0.0, high=_MOST)
    detector = getattr(subject, "detector", None)
    width = code_width_ps or getattr(detector, "bin_width_ps", None) or 55.0
    if spot_std_px is None:
        spot_std_px = spot_std_of(subject)
    response = response or _response_of(subject, source)
    if pulse_std_ps is None:
        pulse_std_ps = _core_std_ps(subject, source) if response is None else response.std_ps
    if background_per_code is None:
        period = getattr(detector, "laser_period_ps", None) or 50_000.0
        whole = getattr(subject, "background", None)
        background_per_code = 0.02 if whole is None else float(np.mean(whole)) * width / period
    return Conditions(
        photons_per_pixel=float(photons_per_pixel),
        spot_std_px=float(spot_std_px),
        pulse_std_ps=float(pulse_std_ps),
        response=response,
        code_width_ps=float(width),
        background_per_ps=max(float(background_per_code), 1e-9) / float(width),
        pixel_std_ps=pixel_std_ps,
        timing=timing,
        strength=getattr(subject, "strength", None),
    )


def _core_std_ps(subject: object, source: Source) -> float:
    """Std of laser pulse, trigger and response without its tail, ps."""
    detector = getattr(subject, "detector", None)
    laser = source.pulse_fwhm_ps or getattr(subject, "pulse_fwhm_ps", None) or 68.0
    own = getattr(detector, "response_fwhm_ps", 150.0)
    jitter = getattr(detector, "trigger_jitter_fwhm_ps", 0.0)
    return float(std_from_fwhm(float(np.sqrt(laser**2 + own**2 + jitter**2))))


def _response_of(subject: object, source: Source) -> Response | None:
    """Shape of what the subject's detector records; None where that has no tail."""
    detector = getattr(subject, "detector", None)
    share = getattr(detector, "response_tail_fraction", 0.0)
    tail_ps = getattr(detector, "response_tail_ps", 0.0)
    if not (share > 0 and tail_ps > 0):
        return None
    core_ps = _core_std_ps(subject, source)
    return Response.with_tail(std_ps=core_ps, tail_ps=tail_ps, tail_share=share)


def light_and_pixels(
    state: PathState,
    whole: PathState,
    cut_ends: tuple[bool, ...],
    conditions: Conditions,
    camera: Camera,
    medium: Medium,
) -> tuple[Light, Pixels]:
    """Light of the legs in the picture, and the pixels that it reaches, with their clocks' errors.

    Parameters
    ----------
    state, whole : PathState
        The path cut to the view, and all of it.
    cut_ends : tuple of bool
        Whether its light begins within the view, and whether each branch stops there.
    conditions : Conditions
        How it is recorded.
    camera : Camera
        Sees it.
    medium : Medium
        Light runs through.

    Returns
    -------
    light : Light
        Brightest pixel: `conditions.photons_per_pixel` expected photons.
    pixels : Pixels
        Those near a leg.
    """
    lines = tuple(
        leg_in_picture(state, k, camera) if k in state.seen else DARK_LEG
        for k in range(state.n_legs)
    )
    rows, cols = (index.ravel() for index in np.indices(camera.shape))
    points = undistorted_px(camera, rows, cols)
    near = lit_by_legs(lines, points, spot_px=conditions.spot_std_px)
    if medium.blocks:
        near[looks_at_blocks(camera, medium.blocks).ravel()] = False
    light = _light(lines, points, near, state, whole, cut_ends, conditions, camera, medium)
    keep = near.any(axis=1)
    n = int(keep.sum())
    pixels = Pixels(
        rows=rows[keep],
        cols=cols[keep],
        near=near[keep],
        points_px=points[keep],
        skew_ps=np.zeros(n),
        pixel_var=np.full(n, conditions.pixel_std_ps**2),
        modes_ps=np.zeros((n, len(lines), 0)),
    )
    if conditions.timing is not None:
        own, modes = clock_errors(
            conditions.timing, pixels.rows, pixels.cols, pixels.near, state, camera, medium
        )
        pixels = replace(pixels, pixel_var=pixels.pixel_var + own, modes_ps=modes)
    return light, pixels


def _light(
    lines: tuple[LegInPicture, ...],
    points: Floats,
    near: NDArray[np.bool_],
    state: PathState,
    whole: PathState,
    cut_ends: tuple[bool, ...],
    conditions: Conditions,
    camera: Camera,
    medium: Medium,
) -> Light:
    knots, coefficients, brightest = [], [], 0.0
    starts = whole.travelled_mm[whole.leg_starts]
    for k, leg in enumerate(lines):
        if k not in state.seen:
            knots.append(np.empty(0))
            coefficients.append(np.empty(0))
            continue
        along, across = leg.along_across(points)
        low, high = leg.span_px

        def expected(grid: Floats, leg: LegInPicture = leg, k: int = k) -> Floats:
            return _log_strength(grid, leg, k, state, whole, starts, conditions, camera, medium)

        knot, coefficient = strength_spline(low, high, expected)
        in_view = near[:, k] & (along >= low) & (along <= high)
        signal = np.exp(
            BSpline(knot, coefficient, 3)(np.clip(along[in_view], low, high))
            - 0.5 * (across[in_view] / conditions.spot_std_px) ** 2
        )
        brightest = max(brightest, float(signal.max(initial=0.0)))
        knots.append(knot)
        coefficients.append(coefficient)
    # The light level is stated for the brightest pixel: all legs are scaled by one factor.
    scale = np.log(conditions.photons_per_pixel / brightest)
    return Light(
        lines,
        tuple(knots),
        tuple(c + scale for c in coefficients),
        float(np.log(conditions.spot_std_px)),
        float(np.log(conditions.pulse_std_ps)),
        (0.0,) * len(lines),
        cut_ends,
    )


def _log_strength(
    grid: Floats,
    leg: LegInPicture,
    k: int,
    state: PathState,
    whole: PathState,
    starts: Floats,
    conditions: Conditions,
    camera: Camera,
    medium: Medium,
) -> Floats:
    """ln(light per px of picture) along a leg: strength per mm, dwell, and 1/r^2."""
    row, col = pixels_of_undistorted(camera, leg.points_px(grid))
    print_ = footprints(
        state,
        camera=camera,
        medium=medium,
        legs=k,
        rows=np.asarray(row, dtype=float),
        cols=np.asarray(col, dtype=float),
    )
    length = np.linalg.norm(state.tangents_mm(k, print_.fraction), axis=1)
    value: Floats = np.log(length / print_.px_per_leg) - 2 * np.log(print_.distance_mm)
    if conditions.strength is not None:
        # Strength is told from the leg's true start, which may lie before the entry into view.
        skipped = float(np.linalg.norm(state.starts_mm[k] - whole.starts_mm[k]))
        along = starts[k] + skipped + state.ways_mm(k, np.clip(print_.fraction, 0, 1))
        with np.errstate(divide="ignore"):
            strength = np.log(np.asarray(conditions.strength(along, k), dtype=float))
        # A dark stretch has no logarithm: e^-12 of the brightest is dark enough.
        value = value + np.maximum(strength, strength.max() - 12.0)
    return value


def expected_codes(local: Local, conditions: Conditions) -> CodeCounts:
    """Even codes that cover the whole flight; counts are not needed for expected information."""
    n, most_ps = len(local.arrival_ps), float(local.std_ps.max(initial=0.0))
    low = float(np.nanmin(local.arrival_ps)) - _REACH_STDS * conditions.pulse_std_ps
    high = float(np.nanmax(local.arrival_ps)) + _REACH_STDS * conditions.pulse_std_ps
    k = int(np.ceil((high - low) / conditions.code_width_ps))
    edges = low + conditions.code_width_ps * np.arange(k + 1)
    shape = (n, k)
    return CodeCounts(
        counts=np.zeros(shape),
        lower_ps=np.broadcast_to(edges[:-1], shape).copy(),
        upper_ps=np.broadcast_to(edges[1:], shape).copy(),
        period_ps=0.0,
        use_outside=np.ones(n, dtype=bool),
        shape=tables_for_counts(conditions.response, most_ps),
    )
