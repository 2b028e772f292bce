"""The pixels of a recording about a path, and which of its legs light each of them, and when."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, fields, replace

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import binary_dilation

from lightflight import flags
from lightflight.errors import NothingFoundError
from lightflight.flight import Source
from lightflight.reconstruct.all_counts.counts import merged
from lightflight.reconstruct.fit.joint import JointFit
from lightflight.reconstruct.fit.membership import (
    CLAIM_REACH_PX,
    mode_columns,
    tip_of_leg,
    tips_in_view,
)
from lightflight.reconstruct.model.cells import CORE_STDS, cells_about, lag_edges
from lightflight.reconstruct.model.counted import Pixels, dark_pixels
from lightflight.reconstruct.model.expected_counts import Pulses
from lightflight.reconstruct.model.geometry import footprints
from lightflight.reconstruct.model.image_plane import undistorted_px
from lightflight.reconstruct.model.light import LEAST_SHARE
from lightflight.reconstruct.model.picture import Picture, arrival_curvature
from lightflight.reconstruct.model.pulse_shape import Shape
from lightflight.reconstruct.model.setting import Setting
from lightflight.reconstruct.model.sighting import Sighting
from lightflight.reconstruct.model.strength import span_of_knots
from lightflight.reconstruct.other_light.drawn_out import (
    flight_ps,
    kurtosis_of_flight,
    own_std_ps,
    skewness_of_flight,
    variance_of_light,
)

Floats = NDArray[np.float64]
Indices = NDArray[np.int64]

FINE_STDS, FINE_GROWTH = 0.8, 1.3
"""Width of a cell about a pulse, in its standard deviations, and growth of the next ones."""
COARSE_STDS, COARSE_GROWTH = 2.0, 1.6
"""The same where no light is expected."""
_FAINT = 0.02
"""Photons of a pixel beyond which it counts as lit, at most: those less bright are left out."""
_CLEAR_STDS, _CLEAR_PX = 3.0, 2.0
"""Pixels this near to a corner or a tip in the picture see cut footprints: in standard deviations
of the spot, and at least, px."""
_MOST_LOST = 0.5
"""Share of the path's pixels without which the rest is no picture of the path."""
_QUIET_PS = 6000.0
"""So long before the light there is none; ps."""
_BESIDE_PX = 5.0
"""Dark pixels nearer to the path than this are a class of their own, px."""


class DrawnOutError(NothingFoundError):
    """In most pixels the light of the path has not the shape of the response, or is cut."""


@dataclass(frozen=True, eq=False)
class Seen:
    """Pixels of one recording, and the legs near each.

    Attributes
    ----------
    rows, cols : array of int, shape (n,)
    leg : array of int, shape (n, s)
        The nearest legs; -1: none is near.
    arrival_ps : array of float, shape (n, s)
        When their light comes, ps on the clock; NaN: none.
    std_ps : array of float, shape (n, s)
        Standard deviation of its pulse, ps.
    flight_ps : array of float, shape (n, s)
        The part of it that flight through the footprint makes, ps.
    skewness : array of float, shape (n, s)
        Of that pulse, where time runs unevenly through the footprint.
    kurtosis : array of float, shape (n, s)
        Of it, in excess of a Gaussian's: active areas have edges, so it is negative.
    uneven : array of float, shape (n, s)
        Standard deviation of the square of `flight_ps`, of itself: light that is brighter in the
        middle of a footprint than about it takes less time through it.
    share : array of float, shape (n, s)
        Of the legs' light in the pixel, as the picture tells it.
    away_px : array of float, shape (n, s)
        Distance from its line, px.
    """

    rows: Indices
    cols: Indices
    leg: Indices
    arrival_ps: Floats
    std_ps: Floats
    flight_ps: Floats
    skewness: Floats
    kurtosis: Floats
    uneven: Floats
    share: Floats
    away_px: Floats

    def of(self, kept: Indices) -> Seen:
        """Some of the pixels."""
        return Seen(**{each.name: getattr(self, each.name)[kept] for each in fields(self)})


@dataclass(frozen=True, eq=False)
class Group:
    """Pixels of one kind, fitted.

    Attributes
    ----------
    pixels : Pixels
        Their counts and unknowns.
    points_px : array of int, shape (n, 2)
        (row, column).
    reference_ps : array of float, shape (n,)
        Arrival time at which their lags are zero, ps on the clock.
    of_class : array of int, shape (n,)
        0: bright; 1: beside the path; 2: near it; 3: far from it.
    """

    pixels: Pixels
    points_px: Indices
    reference_ps: Floats
    of_class: Indices


def alike(sightings: list[Sighting]) -> Iterator[tuple[Sighting, list[int]]]:
    """Recordings by one camera on one clock as one, and their numbers."""
    left = list(range(len(sightings)))
    while left:
        first = sightings[left[0]]
        own = [
            k
            for k in left
            if sightings[k].view == first.view and sightings[k].timing is first.timing
        ]
        yield merged([sightings[k] for k in own]), own
        left = [k for k in left if k not in own]


def pixels_about_path(
    whole: Sighting, fit: JointFit, number: int, std_ps: float, *, claimed: bool = False
) -> Seen:
    """Which legs light which pixels, and when.

    With `claimed` also those too far off for any of their light, of which the path may claim a
    pulse all the same.
    """
    rows, cols, n_cut = _pixels_asked(whole, fit, number)
    near, unseen, past = _near_legs(
        whole, fit, number, rows, cols, CLAIM_REACH_PX if claimed else 0.0
    )
    picture, lit = fit.pictures[number], near.lit
    transit = flight_ps(near.slope, near.narrow, picture)
    response = whole.timing.response
    own = response.std_ps if response is not None else own_std_ps(
        whole, rows, cols, near.arrival_ps, transit, std_ps
    )  # fmt: skip
    std = np.hypot(own, transit)
    skewness = skewness_of_flight(near.slope, near.bend, std, picture)
    kurtosis, departure = kurtosis_of_flight(near.slope, near.side, skewness, std, picture)
    light = max(float(whole.arrivals.photons[whole.usable_pulses].sum()), 1.0)
    steep = lit & (departure > max(LEAST_SHARE, light**-0.5))
    kept = ~(unseen | past | steep.any(axis=1))
    asked = lit[:, 0] | unseen
    if len(fit.solution.cameras) > 1:
        # What of a path this one does not show the others do.
        asked &= ~(unseen | past)
    _check_enough(int(np.count_nonzero(lit[:, 0] & kept)), int(np.count_nonzero(asked)) + n_cut)
    return Seen(
        rows,
        cols,
        np.where(lit, near.leg, -1),
        near.arrival_ps,
        np.where(lit, std, np.nan),
        np.where(lit, transit, np.nan),
        np.where(lit, skewness, 0.0),
        np.where(lit, kurtosis, 0.0),
        near.uneven,
        near.given / np.maximum(near.given.sum(axis=1, keepdims=True), _FAINT),
        near.away_px,
    ).of(np.flatnonzero(kept))


def _pixels_asked(whole: Sighting, fit: JointFit, number: int) -> tuple[Indices, Indices, int]:
    """Rows and columns of pixels with something to say, and how many the recorded range cuts."""
    rows, cols = (index.ravel() for index in np.indices(whole.blind.shape))
    # A pixel without a count may be dead: it has nothing to say.
    silent, cut = whole.histograms.photons.ravel() == 0, _cut(whole)
    at_ends = _at_ends(fit, fit.pictures[number].spot_std_px, whole.view, rows, cols)
    kept = ~(silent | whole.blind.ravel() | at_ends | cut)
    return rows[kept], cols[kept], int(np.count_nonzero(cut))


@dataclass(frozen=True, eq=False)
class _NearLegs:
    """Of n pixels the s nearest legs that may light them, the nearest first.

    Attributes
    ----------
    leg : array of int, shape (n, s)
    lit : array of bool, shape (n, s)
        Whether it does light the pixel; where not nothing else is of use.
    away_px, arrival_ps : array of float, shape (n, s)
        Distance from its line, and when its light comes, ps on the clock; NaN: it does not.
    slope, bend : array of float, shape (n, s)
        Of that time along the line, ps/px and ps/px^2.
    narrow, uneven : array of float, shape (n, s)
        See `variance_of_light`.
    side : array of float, shape (n, s)
        See `kurtosis_of_flight`.
    given : array of float, shape (n, s)
        Its photons there, as the picture tells them.
    """

    leg: Indices
    lit: NDArray[np.bool_]
    away_px: Floats
    arrival_ps: Floats
    slope: Floats
    bend: Floats
    narrow: Floats
    uneven: Floats
    side: Floats
    given: Floats


def _near_legs(
    whole: Sighting, fit: JointFit, number: int, rows: Indices, cols: Indices, least_px: float
) -> tuple[_NearLegs, NDArray[np.bool_], NDArray[np.bool_]]:
    """The legs near some pixels; whether a leg runs there that shows no pulse, or may run on."""
    camera, picture = fit.solution.cameras[whole.view], fit.pictures[number]
    state, medium = fit.solution.state, fit.solution.medium
    clock = replace(whole, found=fit.solution.modes[mode_columns(list(fit.sightings))[whole.view]])
    points, n_legs = undistorted_px(camera, rows, cols), len(picture.legs)
    brightest = float(np.nanmax(whole.arrivals.photons, initial=1.0))
    reach = picture.spot_std_px * np.sqrt(2.0 * np.log(max(brightest / _FAINT, 2.0)))
    reach = max(reach, least_px) + 0.3
    away, given = np.full((len(rows), n_legs), np.inf), np.zeros((len(rows), n_legs))
    arrival, slope, bend, narrow, uneven, side = np.full((6, len(rows), n_legs), np.nan)
    unseen, past = np.zeros((2, len(rows)), dtype=bool)
    for k, leg in enumerate(picture.legs):
        if leg.dark:
            continue
        along, across = leg.along_across(points)
        on_line = np.abs(across) < reach
        print_ = footprints(
            state, camera=camera, medium=medium, legs=k, rows=rows[on_line], cols=cols[on_line]
        )
        near = on_line & (along > leg.span_px[0] - reach) & (along < leg.span_px[1] + reach)
        unseen |= _runs_unseen(fit, k, print_.fraction, on_line, near)
        # A path ends where light was found; one of several cameras may see dimmer light beyond.
        if len(fit.solution.cameras) > 1:
            past |= on_line & (k == 0) & (along < leg.span_px[0] + reach)
            past |= on_line & (k in state.last_legs) & (along > leg.span_px[1] - reach)
        own = near[on_line]
        away[near, k] = np.abs(print_.lateral_px[own])
        given[near, k] = _light_given(picture, k, along[near], across[near])
        slope[near, k] = print_.slope_ps_per_px[own]
        curved = arrival_curvature(print_, state=state, camera=camera, medium=medium)
        bend[near, k] = curved[own]
        heading = leg.heading_rad(along[near])
        side[near, k] = np.cos(heading) ** 4 + np.sin(heading) ** 4
        narrow[near, k], uneven[near, k] = variance_of_light(picture.fits[k], along[near])
        arrival[near, k] = clock.as_counted(rows[near], cols[near], print_.arrival_ps[own])
    most = int(np.isfinite(away).sum(axis=1).max(initial=1))
    nearest = np.argsort(away, axis=1)[:, :most]

    def sorted_(values: Floats) -> Floats:
        return np.take_along_axis(values, nearest, axis=1)

    def told(values: Floats) -> Floats:
        return np.nan_to_num(sorted_(values))

    lit = np.isfinite(sorted_(away) + sorted_(arrival))
    legs = _NearLegs(
        leg=nearest,
        lit=lit,
        away_px=sorted_(away),
        arrival_ps=np.where(lit, sorted_(arrival), np.nan),
        slope=told(slope),
        bend=told(bend),
        narrow=told(narrow),
        uneven=told(uneven),
        side=told(side),
        given=np.where(lit, sorted_(given), 0.0),
    )
    return legs, unseen, past


def _runs_unseen(
    fit: JointFit,
    leg: int,
    fraction: Floats,
    on_line: NDArray[np.bool_],
    near: NDArray[np.bool_],
) -> NDArray[np.bool_]:
    """True where a leg is to run and no pulse shows it; `fraction` of it those `on_line` look at.

    The recorded range may have ended before. Nor does light stop where a path leaves the view:
    along an edge its wings are seen.
    """
    state = fit.solution.state
    first_seen = -np.inf if leg == 0 and fit.tips[0] is None else 0.0
    runs_out = leg in state.last_legs and tip_of_leg(fit.tips, leg, state) is None
    inside = (fraction > first_seen) & (fraction < (np.inf if runs_out else 1.0))
    unseen = np.zeros(len(on_line), dtype=bool)
    unseen[on_line] = inside & ~near[on_line]
    return unseen


def _light_given(picture: Picture, leg: int, along: Floats, across: Floats) -> Floats:
    """Photons that a leg gives pixels at such places (n,), by its line as the picture shows it."""
    line, light = picture.legs[leg], picture.fits[leg]
    # Its last pixel alone says how bright a line is at its end, and by a corner, where the light of
    # two legs runs together, that may be nothing: as bright as a step of the knots before.
    knots = light.spline.t
    first, last = span_of_knots(knots)
    step = min(knots[4] - first, 0.25 * (last - first))
    # A line off its pixels may be bright by exp(400).
    log_bright = np.minimum(light.spline(np.clip(along, first + step, last - step)), 60.0)
    beyond = (along - np.clip(along, *line.span_px)) / light.spot_std_at(along)
    across_it = light.seen(along, across, line.heading_rad(along)).log_light
    given: Floats = np.exp(log_bright + across_it - 0.5 * beyond**2)
    return given


def pulses_expected(seen: Seen, shape: Shape) -> Pulses:
    """Pulses of pixels that legs light, after the light of the nearest one."""
    late, std = seen.arrival_ps - seen.arrival_ps[:, :1], seen.std_ps
    if shape.is_gaussian:
        doubt = 0.5 * seen.uneven * (seen.flight_ps / std) ** 2
        return Pulses(late, std, shape, seen.skewness, seen.kurtosis, seen.share, doubt)
    own = np.sqrt(std**2 - seen.flight_ps**2)
    flight, ratio = 0.5 * (seen.flight_ps / own) ** 2, std / own
    return Pulses(
        late,
        own,
        shape.drawn_out(flight),
        seen.skewness * ratio**3,
        seen.kurtosis * ratio**4,
        seen.share,
        seen.uneven * flight,
    )


def lags_about_legs(seen: Seen, fine: Floats, std_ps: float) -> Floats:
    """Edges of cells for pixels that legs light, ps after the light of the nearest one.

    Parameters
    ----------
    seen : Seen
        Those pixels.
    fine : array of float, shape (m + 1,)
        Edges about one leg (`model.cells.lag_edges`).
    std_ps : float
        Typical standard deviation of a pulse, ps.

    Returns
    -------
    array of float, shape (m + 1,) or (n, m + 1)
        The same in all pixels where each sees one leg alone; else finely divided about every one:
        most of a pixel's light may be of others than the nearest.
    """
    late = seen.arrival_ps[:, 1:] - seen.arrival_ps[:, :1]
    late = np.nan_to_num(late[:, np.isfinite(late).any(axis=0)])
    if not late.size:
        return fine
    core = fine[np.abs(fine) <= CORE_STDS * std_ps * (1.0 + 1e-9)]
    further = (late[:, :, np.newaxis] + core).reshape(len(late), -1)
    # One period about all of them, wherever among them the nearest is.
    middle = 0.5 * (late.min(axis=1, initial=0.0) + late.max(axis=1, initial=0.0))[:, np.newaxis]
    low, high = middle + fine[0], middle + fine[-1]
    both = np.concatenate((np.tile(fine, (len(late), 1)), further, low, high), axis=1)
    # Edges that fall on one end of a code make no cell (`cells_about`).
    lags: Floats = np.sort(np.clip(both, low, high), axis=1)
    return lags


def _check_enough(n_left: int, n_lit: int) -> None:
    """Raises DrawnOutError where too few of the path's pixels can be held to it."""
    if n_left < (1.0 - _MOST_LOST) * n_lit:
        raise DrawnOutError(
            f"in {n_lit - n_left} of {n_lit} pixels of the path its light is cut by the recorded "
            "range, or drawn out beyond the response"
        )


def _cut(whole: Sighting) -> NDArray[np.bool_]:
    """True for pixels with a pulse that the end of the recorded range cuts."""
    cut = np.zeros(whole.blind.shape, dtype=bool)
    rows = whole.arrivals.flags & np.uint32(flags.NEAR_GATE_EDGE) > 0
    cut[whole.arrivals.row[rows].astype(int), whole.arrivals.col[rows].astype(int)] = True
    # Their neighbours' light begins within the range, too.
    grown: NDArray[np.bool_] = (
        binary_dilation(cut, np.ones((5, 5), dtype=bool)) if cut.any() else cut
    )
    return grown.ravel()


def _at_ends(
    fit: JointFit, spot_px: float, view: int, rows: Indices, cols: Indices
) -> NDArray[np.bool_]:
    """True for pixels about a corner or a tip in the picture: they see cut footprints."""
    state, cameras = fit.solution.state, fit.solution.cameras
    corners = np.delete(state.vertices_mm, state.ends, axis=0)
    places = _tips_seen(fit, view)
    if len(corners):
        row, col = cameras[view].pixels_from_points(corners)
        places += list(np.column_stack((row, col)))
    near = np.zeros(len(rows), dtype=bool)
    for row, col in places:
        near |= np.hypot(rows - row, cols - col) < max(_CLEAR_PX, _CLEAR_STDS * spot_px)
    return near


def _tips_seen(fit: JointFit, view: int) -> list[Floats]:
    """(row, col) of each tip in one camera's picture, those of other cameras if they lie in it."""
    cameras = fit.solution.cameras
    seen = Setting(cameras[0], Source(), fit.solution.medium, others=cameras[1:])
    tips = tips_in_view(fit.tips, fit.solution.state, seen, view)
    most = np.array(cameras[view].shape) - 0.5
    return [
        tip[:2]
        for tip, found in zip(tips, fit.tips, strict=True)
        if tip is not None and found is not None
        if int(found[2]) == view or bool(((tip[:2] > -0.5) & (tip[:2] < most)).all())
    ]


def dark_group(
    whole: Sighting, seen: Seen, near: Indices, far: Indices, std_ps: float, nominal: bool
) -> Group | None:
    """Pixels that no leg lights, held about the time of the nearest that one does."""
    if not len(far):
        return None
    points = np.column_stack((seen.rows, seen.cols)).astype(float)
    lit, dark = points[near], points[far]
    squared = np.sum(dark**2, axis=1)[:, np.newaxis] - 2.0 * dark @ lit.T + np.sum(lit**2, axis=1)
    nearest = np.argmin(squared, axis=1)
    reference = seen.arrival_ps[near, 0][nearest]
    lags = lag_edges(std_ps, COARSE_STDS * std_ps, COARSE_GROWTH, whole.histograms.laser_period_ps)
    cells = cells_about(whole, seen.rows[far], seen.cols[far], reference, lags, nominal=nominal)
    distance = np.sqrt(np.maximum(squared[np.arange(len(far)), nearest], 0.0))
    return Group(dark_pixels(cells), dark.astype(np.int64), reference, 2 + (distance > _BESIDE_PX))


def dispersion_of(pixels: Pixels) -> float:
    """Variance of quiet cells over Poisson's, where it is larger than chance brings."""
    quiet = pixels.cells.live & (pixels.cells.edges_ps[:, 1:] < -_QUIET_PS)
    quiet &= pixels.weight > 0.0
    n = int(quiet.sum())
    if not n:
        return 1.0
    squared = (pixels.cells.counts - pixels.mean)[quiet] ** 2 * pixels.weight[quiet]
    # Poisson's own fourth moment: few counts scatter more than many.
    chance = np.sqrt(float(np.sum(2.0 + 1.0 / np.maximum(pixels.mean[quiet], 1e-9)))) / n
    ratio = float(squared.sum()) / n
    return ratio if ratio > 1.0 + 3.0 * chance else 1.0
