"""The counts of one camera, on their way to a climb.

Repeats become one recording, without pixels that disagree with a rough path; then the light in the
picture, the pixels near it and the codes of these.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import BSpline

from lightflight.errors import GeometryError, NothingFoundError
from lightflight.path.light_path import LightPath
from lightflight.reconstruct.all_counts.climb import Climb, View, uneven_pixels
from lightflight.reconstruct.all_counts.corners import pixels_of_uneven_corners
from lightflight.reconstruct.all_counts.rest_in_counts import with_rest_of_light
from lightflight.reconstruct.all_counts.strangers import (
    counts_of_pulses,
    further_pulses,
    pulses_of_no_leg,
    strange_pulses,
    whole_pulses,
)
from lightflight.reconstruct.fit.membership import (
    Tips,
    roughly_on_leg,
    tips_in_view,
)
from lightflight.reconstruct.fit.pictures import as_shown, lit_untold, state_in_view
from lightflight.reconstruct.fit.slanted_spots import with_leaning_times
from lightflight.reconstruct.model.forward import CodeCounts, Pixels
from lightflight.reconstruct.model.geometry import (
    PathState,
    footprints,
    state_of_path,
)
from lightflight.reconstruct.model.glass import beside_glass
from lightflight.reconstruct.model.image_plane import inside_edges_px, undistorted_px
from lightflight.reconstruct.model.leg_in_picture import lit_by_legs
from lightflight.reconstruct.model.light import Diffuse
from lightflight.reconstruct.model.picture import Picture, measure_picture
from lightflight.reconstruct.model.pulse_shape import tables_for_counts
from lightflight.reconstruct.model.second_path import SecondPath
from lightflight.reconstruct.model.second_pulse import Echo
from lightflight.reconstruct.model.setting import Setting
from lightflight.reconstruct.model.sighting import Sighting, clock_errors, pixel_counts
from lightflight.reconstruct.model.strength import span_of_knots, strength_spline
from lightflight.reconstruct.model.thick_beam import BEAM_SHARE_STD, OWN_SHARE, clear_of_corners_px
from lightflight.reconstruct.model.unknowns import Light
from lightflight.timing.pulses.pile_up import open_share_of

if TYPE_CHECKING:
    from lightflight.camera.model import Camera
    from lightflight.reconstruct.fit.uneven import RestAlong

Floats = NDArray[np.float64]

LIKELIHOOD_REACH_PX = 2.5
"""A pixel this near to a leg's line takes part in the likelihood, px, and its pulse must agree."""
_ALIKE = 0.98
"""Variances of spots whose ratio is more than this are alike: what is the beam's of the rest moves
times by 0.02 ps."""
_DISTURBING = 12.0
"""A strange pulse this many standard deviations from a leg's reaches into its light."""
_AT_TIP_PX = 2.5
"""Pixels this near to where the light begins or stops are not judged by their times, px."""


def merged(sightings: list[Sighting]) -> Sighting:
    """Repeats as one recording: counts of the same codes add, which loses nothing for one clock.

    Parameters
    ----------
    sightings : list of Sighting
        Recordings of one flight, on the clock and with their pulses found.

    Returns
    -------
    Sighting
        The first, with the counts of all, its pulses as bright as in all, and the pixels blind that
        are blind in any.
    """
    if len(sightings) == 1:
        return sightings[0]
    first = sightings[0]
    counts = np.sum([o.histograms.counts.astype(np.int64) for o in sightings], axis=0)
    blind = np.logical_or.reduce([o.blind for o in sightings])
    frames = [o.histograms.n_frames for o in sightings]
    # One unknown number of frames leaves the sum unknown.
    known = [n for n in frames if n is not None]
    whole = replace(
        first.histograms,
        counts=counts.astype(np.uint64),
        n_frames=sum(known) if len(known) == len(frames) else None,
    )
    # What was found in the first is so much brighter in all of them.
    factor = float(counts.sum()) / max(float(first.histograms.photons.sum()), 1.0)
    arrivals = replace(first.arrivals, photons=factor * first.arrivals.photons)
    diffuse = None if first.diffuse is None else first.diffuse.times(factor)
    return replace(first, histograms=whole, arrivals=arrivals, blind=blind, diffuse=diffuse)


def without_outliers(
    sighting: Sighting, rough: LightPath, std_ps: float, tips: Tips, setting: Setting
) -> Sighting:
    """The recording with the pixels that disagree with the rough path blinded.

    Parameters
    ----------
    sighting : Sighting
        The recording, on the clock and with its pulses found.
    rough : LightPath
        A path that is roughly right, with the residuals of its pulses.
    std_ps : float
        Typical standard deviation of a pulse, ps.
    tips : Tips
        (row, col, camera) where the light begins and stops in the picture; None: it does not.
    setting : Setting
        Camera, source, medium and waypoints.

    Returns
    -------
    Sighting
        The same counts, `blind` extended.
    """
    blind = sighting.blind.copy()
    if sighting.view == 0:
        # What the joint fit left out as an outlier is no light of the path at that time; its table
        # tells of the first camera's pulses.
        wrong = rough.residuals[~rough.residuals["used"]]
        blind[wrong["row"], wrong["col"]] = True
    if sighting.diffuse is not None:
        # Light that is not told, or only guessed, beyond the chance of the counts.
        blind |= _not_told(sighting, sighting.diffuse) > np.sqrt(sighting.histograms.photons)
    if len(rough.residuals):
        blind |= pixels_off_the_path(sighting, rough, std_ps, tips, setting)
    return replace(sighting, blind=blind)


def _not_told(sighting: Sighting, diffuse: Diffuse) -> Floats:
    """(rows, cols), photons of other light that may be there, and that nobody tells of.

    Images of what nobody saw may be twice as bright as told, or none; and where no pulse of the
    path was measured (within 2 px of a corner, say) what of it is late is not expected.
    """
    arrivals, share = sighting.arrivals, abs(sum(share for share, _ in diffuse.strengths.tails))
    late = np.zeros(sighting.blind.shape)
    np.add.at(late, (arrivals.row, arrivals.col), share * np.nan_to_num(arrivals.photons))
    late[diffuse.rows, diffuse.cols] = 0.0
    return late + diffuse.second.guessed() if isinstance(diffuse.second, SecondPath) else late


def pixels_off_the_path(
    sighting: Sighting, rough: LightPath, std_ps: float, tips: Tips, setting: Setting
) -> NDArray[np.bool_]:
    """(rows, cols), True where a pixel on the path has a pulse beside the path's time.

    Such a pixel's clock is wrong, or other light sits under the leg's: the likelihood of its
    counts would pull the path. `joint` leaves such pulses out by the same gate. A pulse between
    the times of two legs is their mixed light and stays.

    Parameters
    ----------
    sighting : Sighting
        The recording, on the clock and with its pulses found.
    rough : LightPath
        A path that is roughly right, with the residuals of its pulses.
    std_ps : float
        Typical standard deviation of a pulse, ps.
    tips : Tips
        (row, col, camera) where the light begins and stops in the picture; None: it does not.
    setting : Setting
        Camera, source, medium and waypoints.

    Returns
    -------
    array of bool, shape (rows, cols)
    """
    arrivals = sighting.arrivals
    pulses = sighting.usable_pulses
    state = state_of_path(rough)
    gap = np.full((len(pulses), state.n_legs), np.nan)
    for k in state.seen:
        print_ = footprints(
            state,
            camera=setting.camera,
            medium=rough.medium,
            legs=k,
            rows=arrivals.row[pulses],
            cols=arrivals.col[pulses],
        )
        near = np.abs(print_.lateral_px) < LIKELIHOOD_REACH_PX
        near &= roughly_on_leg(print_, k, state)
        gap[near, k] = (sighting.arrival_ps[pulses] - print_.arrival_ps)[near]
    # Where the light begins or stops, a pixel's time is that of the lit part of its footprint.
    for tip in (tip for tip in tips if tip is not None):
        away = np.hypot(arrivals.row[pulses] - tip[0], arrivals.col[pulses] - tip[1])
        gap[away < _AT_TIP_PX] = np.nan
    on_path = np.isfinite(gap).any(axis=1)
    pulses, gap = pulses[on_path], gap[on_path]
    if not len(pulses):
        return np.zeros(arrivals.shape, dtype=bool)
    nearest = gap[np.arange(len(gap)), np.nanargmin(np.abs(gap), axis=1)]
    close = np.abs(nearest) < 2.0 * std_ps
    # Errors that all pulses share (clock scale, pose) are no fault of a pixel.
    shared = float(np.median(nearest[close])) if close.any() else 0.0
    errors = arrivals.independent_std_ps[pulses]
    gate = np.maximum(6.0 * np.hypot(errors, rough.goodness.error_floor_ps), 0.5 * std_ps)
    mixed = (np.nanmin(gap, axis=1) < 0) & (np.nanmax(gap, axis=1) > 0)
    off = (np.abs(nearest - shared) > gate) & (np.abs(nearest) < _DISTURBING * std_ps) & ~mixed
    # Beside a pulse that is the leg's, one that was fitted apart is a light of its own.
    drawn = np.isin(pulses, pulses_of_no_leg(sighting, state, setting, std_ps), invert=True)
    off &= drawn | ~further_pulses(sighting, pulses, np.abs(nearest - shared) <= gate)
    wrong = np.zeros(arrivals.shape, dtype=bool)
    wrong[arrivals.row[pulses[off]], arrivals.col[pulses[off]]] = True
    return wrong


def light_from_picture(picture: Picture, std_ps: float) -> Light:
    """Start of the brightness: the picture's splines, re-knotted over all that is in view.

    Parameters
    ----------
    picture : Picture
        Lines, brightness and spot of the legs, as the counts showed them.
    std_ps : float
        Typical standard deviation of a pulse, ps.

    Returns
    -------
    Light
        Strength per leg, spot and width.
    """
    knots, coefficients = [], []
    for leg, fit in zip(picture.legs, picture.fits, strict=True):
        if leg.dark:
            knots.append(np.empty(0))
            coefficients.append(np.empty(0))
            continue

        def measured(along: Floats, spline: BSpline = fit.spline) -> Floats:
            seen = spline(np.clip(along, *span_of_knots(spline.t)))
            # Where nothing lit the leg the spline may fall without end: e^-12 is dark enough.
            lit: Floats = np.maximum(seen, seen.max() - 12.0)
            return lit

        knot, coefficient = strength_spline(*leg.span_px, measured, spacing_px=fit.knot_spacing_px)
        knots.append(knot)
        coefficients.append(coefficient)
    return Light(
        picture.legs,
        tuple(knots),
        tuple(coefficients),
        float(np.log(picture.spot_std_px)),
        float(np.log(std_ps)),
        tuple(fit.log_scatter for fit in picture.fits),
        spots=tuple(fit.spot for fit in picture.fits),
        active_px=max(fit.area.side_px for fit in picture.fits),
    )


def pixels_near_path(
    light: Light, setting: Setting, sighting: Sighting, state: PathState
) -> Pixels:
    """Pixels that a leg's light can reach, with what the calibration says of them.

    Parameters
    ----------
    light : Light
        Brightness, spot and pulse width.
    setting : Setting
        Camera, source, medium and waypoints.
    sighting : Sighting
        The recording, on the clock and with its pulses found.
    state : PathState
        The path as it is now.

    Returns
    -------
    Pixels
        Blind pixels left out.
    """
    camera = setting.camera
    rows, cols = (index.ravel() for index in np.indices(camera.shape))
    points = undistorted_px(camera, rows, cols)
    # Pixels beyond reach would only add background, which tells nothing of the path.
    spot_px, beyond_px = float(np.exp(light.log_spot_px)), None
    if light.beam_share is not None:
        beyond_px = [
            clear_of_corners_px(state, k, camera, spot_px, share=BEAM_SHARE_STD)
            for k in range(len(light.lines))
        ]
    near = lit_by_legs(light.lines, points, spot_px=spot_px, beyond_px=beyond_px)
    keep = near.any(axis=1) & ~sighting.blind.ravel()
    rows, cols, near, points = rows[keep], cols[keep], near[keep], points[keep]
    timing = sighting.timing
    pixel_var, modes_ps = clock_errors(timing, rows, cols, near, state, camera, setting.medium)
    if sighting.diffuse is not None:
        more = sighting.diffuse.modes_of_legs(rows, cols, camera.shape, near.shape[1])
        modes_ps = np.concatenate((modes_ps, more), axis=2)
    return Pixels(
        rows=rows,
        cols=cols,
        near=near,
        points_px=points,
        skew_ps=timing.skew_ps[rows, cols],
        pixel_var=pixel_var,
        modes_ps=modes_ps,
    )


def _widest_ps(sighting: Sighting) -> float:
    """Standard deviation of the widest pulses of a recording, ps; few are wild."""
    pulses = sighting.usable_pulses
    return float(np.quantile(sighting.arrivals.std_ps[pulses], 0.98)) if len(pulses) else 0.0


def codes_of_pixels(
    pixels: Pixels, sighting: Sighting, state: PathState, setting: Setting, std_ps: float
) -> CodeCounts:
    """Counts and code intervals, with what is expected of light that is no leg's.

    Parameters
    ----------
    pixels : Pixels
        The pixels that take part.
    sighting : Sighting
        The recording, on the clock and with its pulses found.
    state : PathState
        The path as it is now.
    setting : Setting
        Camera, source, medium and waypoints.
    std_ps : float
        Typical standard deviation of a pulse, ps.

    Returns
    -------
    CodeCounts
        (n, codes) each.
    """
    found = pixel_counts(sighting, pixels.rows, pixels.cols)
    other, second = np.empty((0, 0)), None
    skew = found.skew_ps[:, np.newaxis]
    intervals = found.lower_ps - skew, found.upper_ps - skew
    open_share = open_share_of(
        sighting.histograms, pixels.rows, pixels.cols, (found.lower_ps, found.upper_ps)
    )
    if sighting.diffuse is not None:
        period_ps = float(sighting.histograms.laser_period_ps or 0.0)
        other = _counted_first(
            sighting.diffuse.counts(
                pixels.rows, pixels.cols, intervals, period_ps, setting.camera.shape
            ),
            open_share,
        )
        if isinstance(sighting.diffuse.second, Echo):
            second = sighting.diffuse.second.share, sighting.diffuse.second.delay_ps
    pulses = strange_pulses(sighting, state, setting, std_ps)
    whole = whole_pulses(sighting, pulses)
    if whole.any():
        more = counts_of_pulses(sighting, pulses[whole], pixels.rows, pixels.cols, intervals)
        more *= open_share
        other = more if not other.size else other + more
    # What is not known well enough to be expected would be fitted as background.
    strange = np.zeros(setting.camera.shape, dtype=bool)
    strange[sighting.arrivals.row[pulses[~whole]], sighting.arrivals.col[pulses[~whole]]] = True
    return CodeCounts(
        counts=found.counts,
        lower_ps=found.lower_ps,
        upper_ps=found.upper_ps,
        period_ps=float(sighting.histograms.laser_period_ps or 0.0),
        use_outside=~strange[pixels.rows, pixels.cols],
        open_share=open_share,
        shape=tables_for_counts(sighting.timing.response, _widest_ps(sighting)),
        other=other,
        second=second,
    )


def _counted_first(counts: Floats, open_share: Floats) -> Floats:
    """What is counted of other light: as in its cells, of photons of which the first counts."""
    first: Floats = counts * (open_share / open_share.max(axis=1, keepdims=True))
    return first


def other_light_otherwise(
    sighting: Sighting, pixels: Pixels, codes: CodeCounts
) -> list[CodeCounts]:
    """The same counts with light about the path that is off by a standard deviation, one by one.

    Parameters
    ----------
    sighting : Sighting
        The recording, with the diffuse light found in it.
    pixels : Pixels
        The pixels that take part.
    codes : CodeCounts
        What they count, with other light as it was told.

    Returns
    -------
    list of CodeCounts
        One for each error of that light; none where there is too little of it.
    """
    diffuse = sighting.diffuse
    if diffuse is None or not diffuse.has_halo or codes.open_share is None:
        return []
    skew = pixels.skew_ps[:, np.newaxis]
    intervals = codes.lower_ps - skew, codes.upper_ps - skew
    about = pixels.rows, pixels.cols, intervals, codes.period_ps, sighting.blind.shape
    told, open_share = diffuse.counts(*about), codes.open_share
    more = (_counted_first(one.counts(*about) - told, open_share) for one in diffuse.otherwise())
    return [replace(codes, other=codes.other + one) for one in more]


@dataclass(frozen=True, eq=False)
class Counts:
    """The recordings of one camera between climbs.

    Attributes
    ----------
    whole : Sighting
        As one recording.
    intrinsic_ps : float
        Standard deviation of its pulses, ps, as last climbed.
    uneven : array of bool, shape (rows, cols, L)
        True where a pixel's light was seen to depart from its leg's.
    active_px : float or None
        Side of the pixels' active area; None: what each picture says of it.
    corners : tuple of int
        Vertices whose pixels are left out, since what they count is no light of legs alone.
    rests : tuple of RestAlong
        How uneven light is along its legs beyond splines.
    slanted : bool
        Whether spots may be no circles.
    """

    whole: Sighting
    intrinsic_ps: float
    uneven: NDArray[np.bool_]
    active_px: float | None = None
    corners: tuple[int, ...] = ()
    rests: tuple[RestAlong, ...] = ()
    slanted: bool = False


def clean_counts(
    sightings: list[Sighting], rough: LightPath, std_ps: float, tips: Tips, setting: Setting
) -> list[Sighting]:
    """Of each camera one recording, without the pixels that disagree with the rough path.

    Parameters
    ----------
    sightings : list of Sighting
        Recordings of one flight, on the clock and with their pulses found.
    rough : LightPath
        A path that is roughly right, with the residuals of the first camera's pulses.
    std_ps : float
        Typical standard deviation of a pulse, ps.
    tips : Tips
        (row, col, camera) where the light begins and stops in a picture; None: it does not.
    setting : Setting
        Cameras, source, medium and waypoints.

    Returns
    -------
    list of Sighting
        In the order of the cameras.
    """
    wholes, state = [], state_of_path(rough)
    for view in sorted({one.view for one in sightings}):
        whole = merged([one for one in sightings if one.view == view])
        seen = tips_in_view(tips, state, setting, view)
        wholes.append(without_outliers(whole, rough, std_ps, seen, setting.at(view)))
    return wholes


def view_of_counts(
    counts: Counts,
    state: PathState,
    seen: Setting,
    cut_ends: tuple[bool, ...],
    std_ps: float,
    floor_ps: float,
) -> View | None:
    """What one camera's counts bring to a climb from a path.

    Parameters
    ----------
    counts : Counts
        Of that camera.
    state : PathState
        The path as it is now.
    seen : Setting
        Cameras and medium as they were found so far.
    cut_ends : tuple of bool
        Whether the light begins at the path's first vertex, and stops at its last.
    std_ps : float
        Typical standard deviation of a pulse, ps.
    floor_ps : float
        Error per pulse beyond the stated ones, ps.

    Returns
    -------
    View or None
        For `climb`; None where its picture tells of no leg.

    Raises
    ------
    NothingFoundError
        Where its picture loses the path, or hardly a pixel lies near it.
    """
    whole, own = counts.whole, seen.at(counts.whole.view)
    in_view = state_in_view(state, seen, whole.view)
    try:
        picture = measure_picture(
            in_view, whole, camera=own.camera, medium=own.medium, std_ps=counts.intrinsic_ps,
            fine=True, active_px=counts.active_px,
            may_miss=in_view.seen if seen.others else beside_glass(in_view),
        )  # fmt: skip
    except GeometryError as lost:
        raise NothingFoundError(
            "too little light: the counts lose the path from the picture; record longer, or "
            "give a starting path (start=)"
        ) from lost
    lens_px2, widest_px2 = picture.spot_variances_px2
    n_varying = in_view.n_legs if lens_px2 < _ALIKE * widest_px2 else 0
    light = replace(
        light_from_picture(picture, counts.intrinsic_ps), cut_ends=cut_ends,
        beam_share=0.0 if _shows_cuts(in_view, cut_ends, own.camera) else None,
        own_shares=((OWN_SHARE, OWN_SHARE),) * n_varying,
        lens_var_px2=lens_px2,
    )  # fmt: skip
    # Light of a leg that the picture says too little of is not expected: its pixels are left out.
    hidden = lit_untold(in_view, own.camera, picture)
    if hidden is not None:
        whole = replace(whole, blind=whole.blind | hidden)
    state = as_shown(in_view, picture)
    if not state.seen:
        return None
    pixels = pixels_near_path(light, own, whole, state)
    # The floor that the pulses asked for is a clock error of each pixel.
    pixels = replace(pixels, pixel_var=pixels.pixel_var + floor_ps**2)
    if len(pixels.rows) < 3 and not seen.others:
        raise NothingFoundError("fewer than three usable pixels lie near the path")
    bare = [k for k in state.seen if not pixels.near[:, k].any()]
    if bare:
        raise NothingFoundError(
            f"no usable pixel lies near leg {bare[0] + 1} of the path: give a smaller n_legs or "
            "another start"
        )
    if counts.slanted:
        pixels = with_leaning_times(pixels, light, state, own)
    if counts.rests:
        pixels = with_rest_of_light(pixels, counts.rests, light, state, own.camera, own.medium)
    codes = codes_of_pixels(pixels, whole, state, own, std_ps)
    uneven = counts.uneven[pixels.rows, pixels.cols]
    return View(whole.view, light, pixels, codes, uneven, state.dark)


def _shows_cuts(state: PathState, cut_ends: tuple[bool, ...], camera: Camera) -> bool:
    """Whether the end of a leg is in the picture, where a thick beam looks otherwise."""
    corners = [leg + 1 for leg in state.seen if leg not in state.last_legs]
    places = camera.pixels_from_points(state.vertices_mm[corners])
    inside = np.nan_to_num(inside_edges_px(*places, camera.shape), nan=-np.inf)
    return any(cut_ends) or bool((inside.min(axis=1) > -_AT_TIP_PX).any())


def with_uneven(counts: list[Counts], ended: Climb) -> tuple[list[Counts], bool]:
    """The recordings with pixels that a climb showed to be uneven.

    Parameters
    ----------
    counts : list of Counts
        As they went in.
    ended : Climb
        Of their views, in the same order.

    Returns
    -------
    counts : list of Counts
        With what was found of pixels and of the pulses' width.
    new : bool
        True where some pixels are.
    """
    after, new = [], False
    for own, view, at, told in zip(counts, ended.views, ended.points, ended.told, strict=True):
        found = uneven_pixels(view, at, told)
        new |= bool((found & ~view.uneven).any())
        rows, cols = view.pixels.rows, view.pixels.cols
        uneven, near = own.uneven.copy(), np.zeros_like(own.uneven)
        uneven[rows, cols] |= found
        near[rows, cols] = view.pixels.near
        left_out, corners = pixels_of_uneven_corners(
            uneven, near, ended.state, ended.seen.at(view.number).camera,
            float(np.exp(at.light.log_spot_px)),
        )  # fmt: skip
        whole = replace(own.whole, blind=own.whole.blind | left_out)
        std_ps = float(np.exp(at.light.log_std_ps))
        after.append(
            replace(
                own, whole=whole, intrinsic_ps=std_ps, uneven=uneven,
                corners=(*own.corners, *corners),
            )
        )  # fmt: skip
    return after, new
