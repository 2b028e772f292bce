"""What uneven light does to the times: the brightness that the joint fit's spline leaves out.

A pixel sees a stretch of its leg through the spot. Its mean time is that of its foot, later by
(variance of the spot) x (slope of the times) x (slope of the log of the light that pixels see).
The joint fit takes the light from a spline; light that changes faster than its knots lie stays in
the photons of the pulses as a scatter about it. Here that rest is taken for a Gaussian process
along the leg, as strong as the photons show it: its mean corrects the times. Its errors, and those
of the slopes of a spline with dense knots, are columns of errors that pulses share.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import BSpline

from lightflight.reconstruct.fit.rest_of_light import (
    rest_of_light,
    slopes_of_rest,
)
from lightflight.reconstruct.model.geometry import Footprint, Indices, footprints
from lightflight.reconstruct.model.image_plane import undistorted_px
from lightflight.reconstruct.model.lateral import LineFit
from lightflight.reconstruct.model.leg_in_picture import LegInPicture
from lightflight.reconstruct.model.setting import Setting
from lightflight.reconstruct.model.sighting import Sighting
from lightflight.reconstruct.model.strength import KNOT_SPACING_PX, span_of_knots

if TYPE_CHECKING:
    from lightflight.reconstruct.fit.joint import JointFit

Floats = NDArray[np.float64]

_ALIKE_PX = 1.0
"""Over so much of the picture the rest is alike: knots at the usual distance leave waves of up to
6 px, a spot hides those shorter than 3 px; px."""
_LEAST_PHOTONS = 30.0
_FEW = 8
_NEAR_STDS = 2.0
"""Beyond so many standard deviations of the spot its shape is in doubt."""
_END_PX = 1.0
"""Of a leg that has grains: so near to its end in the picture the slope of its light is unknown."""
_LEAST_EFFECT = 0.1
"""Columns that make less than this, in errors of the pulses, are left out."""


@dataclass(frozen=True, eq=False)
class Uneven:
    """Effect of the brightness that a spline leaves out.

    Attributes
    ----------
    late_ps : array of float
        (n,), by how much each pulse is late, ps.
    columns_ps : array of float
        (n, k), one-sigma errors of that, shared by neighbours, ps.
    """

    late_ps: Floats
    columns_ps: Floats


@dataclass(frozen=True, eq=False)
class PulsesOfLeg:
    """Pulses of one leg in one recording; m of the n of a fit.

    Attributes
    ----------
    number : int
        Which recording.
    rows : array of int, shape (m,)
        Which of the n.
    points_px : array of float, shape (m, 2)
        Their pixels, undistorted.
    prints : Footprint
        Where those look at the leg.
    line : LegInPicture
        Its line there.
    light : LineFit
        Its brightness and spot.
    """

    number: int
    rows: Indices
    points_px: Floats
    prints: Footprint
    line: LegInPicture
    light: LineFit


def pulses_by_leg(fit: JointFit, setting: Setting) -> Iterator[PulsesOfLeg]:
    """The pulses of a joint fit by recording and leg, where there are any."""
    for number, (picture, sighting) in enumerate(zip(fit.pictures, fit.sightings, strict=True)):
        camera = fit.solution.cameras[sighting.view]
        for leg in range(fit.solution.state.n_legs):
            here = np.flatnonzero((fit.sighting_of == number) & (fit.times.leg == leg))
            if not len(here):
                continue
            rows, cols = fit.times.row[here], fit.times.col[here]
            prints = footprints(
                fit.solution.state, camera=camera, medium=setting.medium, legs=leg, rows=rows,
                cols=cols,
            )  # fmt: skip
            points = undistorted_px(camera, rows, cols)
            yield PulsesOfLeg(number, here, points, prints, picture.legs[leg], picture.fits[leg])


def uneven_light(fit: JointFit, sightings: list[Sighting], setting: Setting) -> Uneven:
    """What the brightness that is left out does to each pulse of a joint fit."""
    n = len(fit.times.leg)
    late, columns = np.zeros(n), [np.zeros((n, 0))]
    for some in pulses_by_leg(fit, setting):
        # Noise of scaled intensities is not that of photons: what is left may be all noise.
        if not sightings[some.number].histograms.poisson or len(some.rows) < _FEW:
            continue
        here = some.rows
        error = np.sqrt((fit.times.photon_var + fit.times.pixel_var)[here])
        own, shared = _of_leg(
            some.line,
            some.light,
            some.prints,
            some.points_px,
            sightings[some.number].arrivals.photons[fit.times.index[here]],
            error,
        )
        late[here] = own
        whole = np.zeros((n, shared.shape[1]))
        whole[here] = shared
        columns.append(whole)
    return Uneven(late, np.hstack(columns))


def _of_leg(
    line: LegInPicture,
    strength: LineFit,
    print_: Footprint,
    points: Floats,
    photons: Floats,
    error_ps: Floats,
) -> tuple[Floats, Floats]:
    """Lateness (n,) and its columns (n, k) of the pulses of one leg."""
    along, _ = line.along_across(points)
    spot = strength.spot_std_at(along)
    shape = strength.seen(along, print_.lateral_px, line.heading_rad(along)).log_light
    lateral = print_.lateral_px / spot
    low, high = span_of_knots(strength.spline.t)
    telling = (photons > _LEAST_PHOTONS) & (np.abs(lateral) < _NEAR_STDS)
    telling &= (along > low) & (along < high)
    per_slope = spot**2 * print_.slope_ps_per_px
    late = np.zeros(len(along))
    errors = _slope_errors_of_spline(strength, along)
    if np.count_nonzero(telling) >= _FEW:
        seen = along[telling]
        rest = np.log(photons[telling]) - strength.spline(seen) - shape[telling]
        rest = rest - np.average(rest, weights=photons[telling])
        # Denser knots leave shorter waves.
        alike = _ALIKE_PX * strength.knot_spacing_px / KNOT_SPACING_PX
        found = rest_of_light(
            seen, rest, 1.0 / photons[telling], alike_px=alike, spot_px=float(np.median(spot))
        )
        if found is not None:
            mean, more = slopes_of_rest(*found, rest, seen, along)
            late, errors = per_slope * mean, np.hstack((errors, more))
            if found[0].patches:
                # A grain just outside is not seen, and leads the end of the spline astray.
                ends = np.flatnonzero((along < low + _END_PX) | (along > high - _END_PX))
                unknown = np.hypot(found[0].steepest_per_px, strength.log_slope(along[ends]))
                errors = np.hstack((errors, np.eye(len(along))[:, ends] * unknown))
    scaled = (per_slope / error_ps)[:, np.newaxis] * errors
    across, sizes, _ = np.linalg.svd(scaled, full_matrices=False)
    kept = sizes > _LEAST_EFFECT
    return late, error_ps[:, np.newaxis] * across[:, kept] * sizes[kept]


def _slope_errors_of_spline(strength: LineFit, along: Floats) -> Floats:
    """One-sigma columns (n, k) of the errors of the spline's slopes along the line, per px.

    They are a sixth of the pulses' own but at the ends of lines, where another leg's light may lead
    the spline astray.
    """
    knots = strength.spline.t
    low, high = span_of_knots(knots)
    slopes = BSpline(knots, np.eye(len(strength.spline.c)), 3).derivative()
    inside = (along >= low) & (along <= high)
    values, vectors = np.linalg.eigh(strength.spline_covariance)
    columns: Floats = slopes(np.clip(along, low, high)) @ (vectors * np.sqrt(np.maximum(values, 0)))
    return columns * inside[:, np.newaxis]
