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
from lightflight.reconstruct.fit.membership import mode_columns, tip_of_leg, tips_in_view
from lightflight.reconstruct.model.cells import CORE_STDS, cells_about, lag_edges
from lightflight.reconstruct.model.counted import Pixels, Pulses, dark_pixels
from lightflight.reconstruct.model.geometry import footprints
from lightflight.reconstruct.model.image_plane import undistorted_px
from lightflight.reconstruct.model.lateral import LineFit
from lightflight.reconstruct.model.light import LEAST_SHARE
from lightflight.reconstruct.model.picture import Picture, arrival_curvature
from lightflight.reconstruct.model.pulse_shape import Shape
from lightflight.reconstruct.model.setting import Setting
from lightflight.reconstruct.model.sighting import Sighting
from lightflight.reconstruct.model.strength import span_of_knots

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
_EVEN_STD = 0.2
"""Of the variance that flight through a footprint adds to a pulse: nobody knows it better."""
_MOST_UNEVEN = 0.7
"""The same, at most, and how much less or more of it light may make that is not even."""
_SURE = 2.0
"""Standard deviations of what counts say of that area."""
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


def pixels_about_path(whole: Sighting, fit: JointFit, number: int, std_ps: float) -> Seen:
    """Which legs light which pixels, and when."""
    camera = fit.solution.cameras[whole.view]
    picture, state, medium = fit.pictures[number], fit.solution.state, fit.solution.medium
    clock = replace(whole, found=fit.solution.modes[mode_columns(list(fit.sightings))[whole.view]])
    several = len(fit.solution.cameras) > 1
    rows, cols = (index.ravel() for index in np.indices(camera.shape))
    # A pixel without a count may be dead: it has nothing to say.
    silent = whole.histograms.photons.ravel() == 0
    kept = ~(
        silent | whole.blind.ravel() | _at_ends(fit, picture.spot_std_px, whole.view, rows, cols)
    )
    cut = _cut(whole)
    kept &= ~cut
    rows, cols = rows[kept], cols[kept]
    points, n_legs = undistorted_px(camera, rows, cols), len(picture.legs)
    brightest = float(np.nanmax(whole.arrivals.photons, initial=1.0))
    reach = picture.spot_std_px * np.sqrt(2.0 * np.log(max(brightest / _FAINT, 2.0))) + 0.3
    away = np.full((len(rows), n_legs), np.inf)
    arrival, slope, bend, narrow, uneven, side = np.full((6, len(rows), n_legs), np.nan)
    given = np.zeros((len(rows), n_legs))
    beyond = np.zeros(len(rows), dtype=bool)
    for k, leg in enumerate(picture.legs):
        if leg.dark:
            continue
        along, across = leg.along_across(points)
        first, last = leg.span_px
        on_line = np.abs(across) < reach
        near = on_line & (along > first - reach) & (along < last + reach)
        print_ = footprints(
            state, camera=camera, medium=medium, legs=k, rows=rows[on_line], cols=cols[on_line]
        )
        # The path runs there and no pulse was found: the recorded range may have ended before.
        # Nor does light stop where a path leaves the view: along an edge its wings are seen.
        first_seen = -np.inf if k == 0 and fit.tips[0] is None else 0.0
        runs_out = k in state.last_legs and tip_of_leg(fit.tips, k, state) is None
        inside = (print_.fraction > first_seen) & (print_.fraction < (np.inf if runs_out else 1.0))
        beyond[on_line] |= inside & ~near[on_line]
        own = near[on_line]
        away[near, k] = np.abs(print_.lateral_px[own])
        given[near, k] = _light_given(picture, k, along[near], across[near])
        slope[near, k] = print_.slope_ps_per_px[own]
        curved = arrival_curvature(print_, state=state, camera=camera, medium=medium)
        bend[near, k] = curved[own]
        heading = leg.heading_rad(along[near])
        side[near, k] = np.cos(heading) ** 4 + np.sin(heading) ** 4
        narrow[near, k], uneven[near, k] = _variance_of_light(picture.fits[k], along[near])
        arrival[near, k] = clock.as_counted(rows[near], cols[near], print_.arrival_ps[own])
        # A path ends where light was found; one of several cameras may see dimmer light beyond.
        if several and k == 0:
            beyond |= on_line & (along < first + reach)
        if several and k in state.last_legs:
            beyond |= on_line & (along > last - reach)
    most = int(np.isfinite(away).sum(axis=1).max(initial=1))
    nearest = np.argsort(away, axis=1)[:, :most]
    lit = np.isfinite(np.take_along_axis(away, nearest, axis=1))
    lit &= np.isfinite(np.take_along_axis(arrival, nearest, axis=1))
    slope, bend, narrow, uneven, side = (
        np.nan_to_num(np.take_along_axis(x, nearest, axis=1))
        for x in (slope, bend, narrow, uneven, side)
    )
    given = np.where(lit, np.take_along_axis(given, nearest, axis=1), 0.0)
    transit = np.abs(slope) * picture.spot_std_px * np.sqrt(narrow)
    response = whole.timing.response
    own = response.std_ps if response is not None else _own_std_ps(
        whole, rows, cols, np.where(lit, np.take_along_axis(arrival, nearest, axis=1), np.nan),
        transit, std_ps,
    )  # fmt: skip
    light = float(whole.arrivals.photons[whole.usable_pulses].sum())
    std = np.hypot(own, transit)
    skewness = _skewness(slope, bend, std, picture)
    kurtosis, departure = _kurtosis(slope, side, skewness, std, picture)
    steep = departure > max(LEAST_SHARE, light**-0.5)
    steep &= lit
    kept = ~(beyond | steep.any(axis=1))
    n_lit = int(np.count_nonzero(lit[:, 0] | beyond) + np.count_nonzero(cut))
    _check_enough(int(np.count_nonzero(lit[:, 0] & kept)), n_lit)
    return Seen(
        rows[kept],
        cols[kept],
        np.where(lit, nearest, -1)[kept],
        np.where(lit, np.take_along_axis(arrival, nearest, axis=1), np.nan)[kept],
        np.where(lit, std, np.nan)[kept],
        np.where(lit, transit, np.nan)[kept],
        np.where(lit, skewness, 0.0)[kept],
        np.where(lit, kurtosis, 0.0)[kept],
        uneven[kept],
        (given / np.maximum(given.sum(axis=1, keepdims=True), _FAINT))[kept],
        np.take_along_axis(away, nearest, axis=1)[kept],
    )


def _light_given(picture: Picture, leg: int, along: Floats, across: Floats) -> Floats:
    """Photons that a leg gives pixels at such places (n,), by its line as the picture shows it."""
    line, light = picture.legs[leg], picture.fits[leg]
    # A line off its pixels may be bright by exp(400).
    log_bright = np.minimum(light.spline(np.clip(along, *span_of_knots(light.spline.t))), 60.0)
    beyond = (along - np.clip(along, *line.span_px)) / light.spot_std_at(along)
    across_it = light.seen(along, across, line.heading_rad(along)).log_light
    given: Floats = np.exp(log_bright + across_it - 0.5 * beyond**2)
    return given


def _variance_of_light(light: LineFit, along_px: Floats) -> tuple[Floats, Floats]:
    """Of a leg's light within pixels (n,), along it, in the spot's own; and its standard deviation.

    Of light seen through a Gaussian spot s^2 (1 + s^2 (ln I)''), I as pixels see it. The spline
    leaves out what is as uneven as what it shows, at most.
    """
    spot, bend = light.spot_std_at(along_px), light.spline.derivative(2)
    low, high = span_of_knots(light.spline.t)
    everywhere = np.linspace(low, high, 1 + int(np.ceil(high - low)))
    usual = np.sqrt(np.mean((light.spot_std_at(everywhere) ** 2 * bend(everywhere)) ** 2))
    own = spot**2 * bend(along_px) * ((along_px > low) & (along_px < high))
    doubt = np.full(len(along_px), min(float(usual), _MOST_UNEVEN))
    return np.clip(1.0 + own, 1.0 - _MOST_UNEVEN, 1.0 + _MOST_UNEVEN), np.hypot(_EVEN_STD, doubt)


def _skewness(slope_ps: Floats, bend_ps: Floats, std_ps: Floats, picture: Picture) -> Floats:
    """Of light drawn out through a pixel by a time that does not run evenly along its spot."""
    third: Floats = 3.0 * slope_ps**2 * bend_ps * picture.spot_std_px**4
    return third / std_ps**3


def _kurtosis(
    slope_ps: Floats, side: Floats, skewness: Floats, std_ps: Floats, picture: Picture
) -> tuple[Floats, Floats]:
    """Of light drawn out through a pixel, and by how much its pulse departs from what that tells.

    A square active area a has the cumulants -a^4 (c^4 + s^4) / 120 and a^6 (c^6 + s^6) / 252 along
    a line that runs at an angle of cosine c and sine s; `side` is c^4 + s^4. The departure is that
    of a Gaussian of third, fourth and sixth cumulant g, k and h from its Gram-Charlier series to
    the fourth order, k off by d: d He_4 / 24 + g^2 He_6 / 72 + h He_6 / 720, rms, as a share of it.
    """
    fourth, off = _fourth_of_active_px(picture)
    per_fourth = -side * (slope_ps / std_ps) ** 4 / 120.0
    sixth = 0.5 * (3.0 * side - 1.0) * fourth**1.5 * (slope_ps / std_ps) ** 6 / 252.0
    departure: Floats = np.sqrt(
        (off * per_fourth) ** 2 / 24.0 + 720.0 * (skewness**2 / 72.0 + sixth / 720.0) ** 2
    )
    return fourth * per_fourth, departure


def _fourth_of_active_px(picture: Picture) -> tuple[float, float]:
    """Fourth power of the side of the active area, and how far it may be off; no more than pitch.

    Half of that where nothing tells.
    """
    areas = [
        light.area for leg, light in zip(picture.legs, picture.fits, strict=True) if not leg.dark
    ]
    told = [area for area in areas if area.fourth_std > 0.0]
    if not told:
        return 0.5, 0.5
    least = min(max(area.side_px**4 - _SURE * area.fourth_std, 0.0) for area in told)
    most = max(min(area.side_px**4 + _SURE * area.fourth_std, 1.0) for area in told)
    return 0.5 * (least + most), 0.5 * (most - least)


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


def _own_std_ps(
    whole: Sighting,
    rows: Indices,
    cols: Indices,
    arrival_ps: Floats,
    transit_ps: Floats,
    std_ps: float,
) -> float:
    """Standard deviation of laser and detector, ps: of pulses without what flight adds to each.

    Pixels (n,), whose legs' light (n, s) comes at `arrival_ps`; NaN: there is none. `std_ps` is
    that of pulses as they are recorded, where none is found there.
    """
    arrivals, own = whole.arrivals, whole.usable_pulses
    place = np.full(whole.blind.shape, -1)
    place[rows, cols] = np.arange(len(rows))
    pixel = place[arrivals.row[own], arrivals.col[own]]
    own, pixel = own[pixel >= 0], pixel[pixel >= 0]
    gap = np.abs(whole.arrival_ps[own, np.newaxis] - arrival_ps[pixel])
    slot = np.argmin(np.where(np.isnan(gap), np.inf, gap), axis=1)
    at = np.arange(len(own)), slot
    near = gap[at] < std_ps
    squared = (arrivals.std_ps[own] ** 2 - transit_ps[pixel, slot] ** 2)[near]
    if not len(squared):
        return std_ps
    order = np.argsort(squared)
    below = np.cumsum(arrivals.photons[own][near][order])
    middle = squared[order][np.searchsorted(below, 0.5 * below[-1])]
    return float(np.sqrt(max(middle, 0.1 * std_ps**2)))


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
