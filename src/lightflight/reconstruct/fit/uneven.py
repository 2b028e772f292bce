"""What uneven light does to the times: the brightness that the joint fit's spline leaves out.

A pixel sees a stretch of its leg through the spot. Its mean time is that of its foot, later by
(variance of the spot) x (slope of the times) x (slope of the log of the light that pixels see).
The joint fit takes the light from a spline; light that changes faster than its knots lie stays in
the photons of the pulses as a scatter about it, and in their times. Here that rest is taken for a
Gaussian process along the leg, as strong as photons and times make it: its mean by the photons
corrects the times. Its errors, and those of the slopes of a spline with dense knots, are columns of
errors that pulses share.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from lightflight.reconstruct.fit.rest_of_light import (
    LightShown,
    Rest,
    SlopesShown,
    rest_of_light,
    slopes_of_rest,
)
from lightflight.reconstruct.model.geometry import Footprint, Indices, footprints
from lightflight.reconstruct.model.image_plane import undistorted_px
from lightflight.reconstruct.model.lateral import LineFit
from lightflight.reconstruct.model.leg_in_picture import LegInPicture
from lightflight.reconstruct.model.setting import Setting
from lightflight.reconstruct.model.sighting import Sighting
from lightflight.reconstruct.model.strength import slopes_of_splines, span_of_knots

if TYPE_CHECKING:
    from lightflight.reconstruct.fit.joint import JointFit

Floats = NDArray[np.float64]

_LEAST_PHOTONS = 30.0
_FEW = 8
_NEAR_STDS = 2.0
"""Beyond so many standard deviations of the spot its shape is in doubt."""
_END_PX = 1.0
"""Of a leg that has grains: so near to its end in the picture the slope of its light is unknown."""
_PATH_DEGREE = 3
"""Times that run as a polynomial of this degree along a leg are the path's to explain."""
_PATH_FREE = 30.0
"""How much of that there may be, in the largest of the times that the path leaves."""
_MOST_AT_ONCE = 300
"""Pulses of one stretch of a leg, along which the rest is alike: what is asked grows with their
third power."""
_LEAST_EFFECT = 0.1
"""Columns that make less than this, in errors of the pulses, are left out."""


@dataclass(frozen=True, eq=False)
class RestAlong:
    """The rest of the light along a stretch of a leg in one recording.

    Attributes
    ----------
    number : int
        Which recording.
    leg : int
    line : LegInPicture
        Along which places are counted.
    span_px : (float, float)
        Where the stretch begins and stops.
    rest : Rest
    """

    number: int
    leg: int
    line: LegInPicture
    span_px: tuple[float, float]
    rest: Rest


@dataclass(frozen=True, eq=False)
class Uneven:
    """Effect of the brightness that a spline leaves out.

    Attributes
    ----------
    late_ps : array of float
        (n,), by how much each pulse is late, ps.
    columns_ps : array of float
        (n, k), one-sigma errors of that, shared by neighbours, ps.
    rests : tuple of RestAlong
        What was found along legs.
    """

    late_ps: Floats
    columns_ps: Floats
    rests: tuple[RestAlong, ...] = ()


@dataclass(frozen=True, eq=False)
class PulsesOfLeg:
    """Pulses of one leg in one recording; m of the n of a fit.

    Attributes
    ----------
    number : int
        Which recording.
    leg : int
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
    leg: int
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
            line, light = picture.legs[leg], picture.fits[leg]
            yield PulsesOfLeg(number, leg, here, points, prints, line, light)


def stacked_by_leg(columns: dict[tuple[int, int], Floats], fit: JointFit) -> Floats:
    """(n, k), columns of the times of a fit, by camera and leg, side by side."""
    return np.reshape(list(columns.values()), (len(columns), len(fit.times.leg))).T


@dataclass(frozen=True, eq=False)
class _Pulses:
    """What the pulses of one leg in one recording show; (n,) each.

    Attributes
    ----------
    photons : array of float
    error_ps : array of float
        Of each alone.
    left_ps : array of float
        By how much they are later than path and spline say.
    kept : array of bool
        Those that are no outliers.
    """

    photons: Floats
    error_ps: Floats
    left_ps: Floats
    kept: NDArray[np.bool_]


def uneven_light(
    fit: JointFit, sightings: list[Sighting], setting: Setting, left_ps: Floats
) -> Uneven:
    """What the brightness that is left out does to each pulse of a joint fit.

    Parameters
    ----------
    fit : JointFit
        Of n pulses, with pictures as they are.
    sightings : list of Sighting
        The recordings, perhaps with light found that is no leg's.
    setting : Setting
        As it was found to be.
    left_ps : array of float, shape (n,)
        By how much each pulse is later than path, clock and the splines of the pictures say, ps.

    Returns
    -------
    Uneven
        Of the n pulses.
    """
    n = len(fit.times.leg)
    late, columns = np.zeros(n), [np.zeros((n, 0))]
    rests: list[RestAlong] = []
    for some in pulses_by_leg(fit, setting):
        # Noise of scaled intensities is not that of photons: what is left may be all noise.
        if not sightings[some.number].histograms.poisson or len(some.rows) < _FEW:
            continue
        here = some.rows
        pulses = _Pulses(
            sightings[some.number].arrivals.photons[fit.times.index[here]],
            np.sqrt((fit.times.photon_var + fit.times.pixel_var)[here]),
            left_ps[here],
            fit.times.weight[here] > 0,
        )
        own = _of_leg(some, pulses)
        late[here] = own.late_ps
        columns.append(_placed(here, own.columns_ps, n))
        rests.extend(own.rests)
    return Uneven(late, np.hstack(columns), tuple(rests))


def _of_leg(some: PulsesOfLeg, pulses: _Pulses) -> Uneven:
    """What it is of the n pulses of one leg."""
    line, strength, lateral_px = some.line, some.light, some.prints.lateral_px
    along, _ = line.along_across(some.points_px)
    spot = strength.spot_std_at(along)
    shape = strength.seen(along, lateral_px, line.heading_rad(along)).log_light
    low, high = span_of_knots(strength.spline.t)
    telling = (pulses.photons > _LEAST_PHOTONS) & (np.abs(lateral_px / spot) < _NEAR_STDS)
    telling &= (along > low) & (along < high)
    per_slope = spot**2 * some.prints.slope_ps_per_px
    late, of_spline = np.zeros(len(along)), slope_errors_of_spline(strength, along)
    columns: list[Floats] = []
    rests: list[RestAlong] = []
    for here in stretches(along, telling):
        seen = here[telling[here]]
        if len(seen) < _FEW:
            continue
        rest = np.log(pulses.photons[seen]) - strength.spline(along[seen]) - shape[seen]
        rest = rest - np.average(rest, weights=pulses.photons[seen])
        slopes = _slopes_by_times(along, per_slope, pulses, seen)
        noise = 1.0 / pulses.photons[seen]
        shown = LightShown(along[seen], rest, noise, strength.spline.t, slopes)
        found = rest_of_light(shown, spot_px=float(np.median(spot[here])))
        if found.is_none:
            continue
        span = float(along[here].min()), float(along[here].max())
        rests.append(RestAlong(some.number, some.leg, line, span, found))
        slope, errors = slopes_of_rest(found, shown, along[here])
        late[here] = per_slope[here] * slope
        of_spline[here] = 0.0
        columns.append(_placed(here, errors, len(along)))
        if found.patches:
            # A grain just outside is not seen, and leads the end of the spline astray.
            ends = here[(along[here] < low + _END_PX) | (along[here] > high - _END_PX)]
            unknown = np.hypot(found.steepest_per_px, strength.log_slope(along[ends]))
            columns.append(_placed(ends, np.diag(unknown), len(along)))
    scaled = (per_slope / pulses.error_ps)[:, np.newaxis] * np.hstack([of_spline, *columns])
    across, sizes, _ = np.linalg.svd(scaled, full_matrices=False)
    kept = sizes > _LEAST_EFFECT
    shared = pulses.error_ps[:, np.newaxis] * across[:, kept] * sizes[kept]
    return Uneven(late, shared, tuple(rests))


def stretches(along: Floats, telling: NDArray[np.bool_]) -> list[Indices]:
    """Pulses of a leg, stretch by stretch: of a long one each may be as uneven as it likes.

    Parameters
    ----------
    along : array of float, shape (n,)
        Places on its line, px.
    telling : array of bool, shape (n,)
        Those that are asked.

    Returns
    -------
    list of array of int
        Of each stretch its pulses, in their order along the line.
    """
    order = np.argsort(along, kind="stable")
    n = -(-np.count_nonzero(telling) // _MOST_AT_ONCE) or 1
    last = np.searchsorted(np.cumsum(telling[order]), telling.sum() * np.arange(1, n) / n)
    return np.split(order, last)


def _placed(rows: Indices, columns: Floats, n: int) -> Floats:
    """(n, k), columns of some of n rows, and nothing of the others."""
    whole = np.zeros((n, columns.shape[1]))
    whole[rows] = columns
    return whole


def _slopes_by_times(
    along: Floats, per_slope: Floats, pulses: _Pulses, telling: Indices
) -> SlopesShown:
    """What times show of the slope of the light, but for what a path not yet right leaves."""
    telling = telling[pulses.kept[telling] & (np.abs(per_slope[telling]) > 0.0)]
    places, per, left = along[telling], per_slope[telling], pulses.left_ps[telling]
    middle, scale = np.mean(along), max(float(np.ptp(along)), 1.0)
    smooth = np.polynomial.polynomial.polyvander((places - middle) / scale, _PATH_DEGREE)
    free = _PATH_FREE * np.abs(left).max(initial=0.0) * smooth
    return SlopesShown(
        places, left / per, (pulses.error_ps[telling] / per) ** 2, free / per[:, np.newaxis]
    )


def slope_errors_of_spline(strength: LineFit, along: Floats) -> Floats:
    """One-sigma columns of the errors of the spline's slopes along the line.

    They are a sixth of the pulses' own but at the ends of lines, where another leg's light may lead
    the spline astray.

    Parameters
    ----------
    strength : LineFit
        Of the leg.
    along : array of float, shape (n,)
        Places on its line, px.

    Returns
    -------
    array of float, shape (n, k)
        ln per px.
    """
    values, vectors = np.linalg.eigh(strength.spline_covariance)
    slopes = slopes_of_splines(strength.spline.t, along)
    columns: Floats = slopes @ (vectors * np.sqrt(np.maximum(values, 0)))
    return columns
