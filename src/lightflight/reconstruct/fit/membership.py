"""Which pulse belongs to which leg, and the tables of times and lines that a fit is given.

Takes the pulses of recordings and a path that is roughly right; gives `TimeData` and
`LineDataInPicture`, of all recordings and cameras in one.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import block_diag
from scipy.special import ndtr

from lightflight import flags
from lightflight.reconstruct.fit.least_squares import TimeData
from lightflight.reconstruct.model.geometry import Footprint, Indices, PathState, footprints
from lightflight.reconstruct.model.picture import (
    LineDataInPicture,
    Picture,
    footprint_corrections,
)
from lightflight.reconstruct.model.setting import Setting
from lightflight.reconstruct.model.sighting import Sighting
from lightflight.reconstruct.model.thick_beam import clear_of_corners_px, share_beyond_lens

if TYPE_CHECKING:
    from lightflight.timing.pulses.arrivals import Arrivals

Floats = NDArray[np.float64]

Tips = tuple[Floats | None, ...]
"""(row, col, camera) where the light of a path begins, and where it stops, within the picture of a
camera by number; None: it does not. A path with arms has an end for each, in the order of
`PathState.last_legs`.

In the picture, not in space: how deep a path lies may still move a lot when its ends are known."""

CLAIM_REACH_PX = 2.2
"""Pulses this near to a leg's line may be claimed by it, px: five stds of a usual
spot; a wider spot widens the gate."""
_WING_STDS = 4.5
"""So many spots beside it the brightest of lines still gives a pulse: two photons of 50,000."""
_APART_STDS = 4.5
"""Two pulses nearer than this, in their standard deviations, may have been fitted as one."""
CLAIM_STDS = 6.0
"""A pulse may be claimed by a leg whose time lies within this many of its errors."""
MOST_SHIFT = 0.1
"""Light of another leg, or an end of its own within the spot, may move a pulse by no more, of its
error."""
_FAR_STDS = 6.0
"""Ends farther from a foot cut nothing of a spot; beyond an end there is no light from there on."""
_TIP_PX = 1.2
"""Pixels this near to where the light begins or stops see a cut footprint, px."""


def tip_of_leg(tips: Tips, leg: int, state: PathState) -> Floats | None:
    """(row, col) where the light of a leg stops in the picture; None: it does not, or goes on.

    Parameters
    ----------
    tips : Tips
        Of the path.
    leg : int
        Index of the leg.
    state : PathState
        The path.
    """
    return dict(zip(state.last_legs, tips[1:], strict=False)).get(leg)


def mode_columns(sightings: list[Sighting]) -> dict[int, slice]:
    """Columns of the shared clock errors of each view: repeats share them, cameras do not.

    Parameters
    ----------
    sightings : list of Sighting
        Recordings of one flight, on the clock and with their pulses found.

    Returns
    -------
    dict of int to slice
        By view; together as many columns as there are shared errors.
    """
    columns: dict[int, slice] = {}
    first = 0
    for o in sightings:
        if o.view not in columns:
            size = o.arrivals.shared_modes_ps.shape[1]
            columns[o.view] = slice(first, first + size)
            first += size
    return columns


def time_data(sighting: Sighting, index: Indices, leg: Indices, footprint_ps: Floats) -> TimeData:
    """Rows `index` (n,) of a recording's arrivals, said to belong to the legs `leg` (n,).

    Parameters
    ----------
    sighting : Sighting
        The recording, on the clock and with its pulses found.
    index : array of int, shape (n,)
        Rows of its arrivals.
    leg : array of int, shape (n,)
        The leg each belongs to.
    footprint_ps : array of float, shape (n,)
        Mean time over the footprint minus that at its foot, ps.

    Returns
    -------
    TimeData
        (n,) each, all with weight 1.
    """
    arrivals = sighting.arrivals
    return TimeData(
        leg=leg,
        row=arrivals.row[index].astype(float),
        col=arrivals.col[index].astype(float),
        arrival_ps=sighting.arrival_ps[index],
        footprint_ps=footprint_ps,
        photon_var=arrivals.photon_std_ps[index] ** 2,
        pixel_var=arrivals.pixel_std_ps[index] ** 2,
        modes_ps=arrivals.shared_modes_ps[index],
        weight=np.ones(len(index)),
        index=index,
        view=np.full(len(index), sighting.view),
    )


def prints_of_leg(
    sighting: Sighting, state: PathState, setting: Setting, rows: Indices, leg: int
) -> Footprint:
    """Footprints on one leg of the pulses in `rows` (n,) of a recording's arrivals.

    Parameters
    ----------
    sighting : Sighting
        The recording, on the clock and with its pulses found.
    state : PathState
        The path as it is now.
    setting : Setting
        Camera, source, medium and waypoints.
    rows : array of int, shape (n,)
        Rows of its arrivals.
    leg : int
        Index of the leg.

    Returns
    -------
    Footprint
        (n,) each.
    """
    return footprints(
        state,
        camera=setting.camera,
        medium=setting.medium,
        legs=leg,
        rows=sighting.arrivals.row[rows],
        cols=sighting.arrivals.col[rows],
    )


def assigned(
    sighting: Sighting,
    state: PathState,
    setting: Setting,
    picture: Picture,
    std: float,
    floor_ps: float,
    members: Indices | None,
    tips: Tips = (None, None),
) -> TimeData:
    """Pulses that belong to a leg, with their footprint corrections.

    `members` (n,) says which leg the picture gave each pulse to (-1: none): such a pulse stays
    with its leg even where the corner of the moment would cut it off, so that a misplaced
    corner is pulled back instead of eating its leg.

    Parameters
    ----------
    sighting : Sighting
        The recording, on the clock and with its pulses found.
    state : PathState
        The path as it is now.
    setting : Setting
        Camera, source, medium and waypoints.
    picture : Picture
        Lines, brightness and spot of the legs, as the counts showed them.
    std : float
        Typical standard deviation of a pulse, ps.
    floor_ps : float
        Error per pulse beyond the stated ones, ps.
    members : array of int, shape (n,) or None
        The leg that the picture gave each pulse to (-1: none); such a pulse stays with its leg even
        where the corner of the moment would cut it off, so that a misplaced corner is pulled back
        instead of eating its leg. None: the path alone says.
    tips : Tips, optional
        (row, col, camera) where the light begins and stops in the picture; None: it does not.

    Returns
    -------
    TimeData
        Those that no second leg's light may have shifted, with their footprint corrections.
    """
    arrivals = sighting.arrivals
    usable = sighting.usable_pulses
    n, n_legs = len(usable), state.n_legs
    gap = np.full((n, n_legs), np.inf)
    expected = np.zeros((n, n_legs))
    modelled = np.full((n, n_legs), np.nan)
    spot_px = picture.spot_std_px
    for k in state.seen:
        print_ = prints_of_leg(sighting, state, setting, usable, k)
        near = np.abs(print_.lateral_px) < max(CLAIM_REACH_PX, 3.0 * spot_px)
        # Where two legs light a pixel its one time is neither's.
        clear_px = clear_of_corners_px(
            state, k, setting.camera, spot_px, share=share_beyond_lens(spot_px)
        )
        own = None if members is None else members[usable]
        near &= _clear_of_corners(print_, k, state, own, clear_px)
        near &= clear_of_tips(print_, k, state, tips, setting)
        correction = footprint_corrections(
            picture,
            print_,
            rows=arrivals.row[usable].astype(float),
            cols=arrivals.col[usable].astype(float),
            camera=setting.camera,
            state=state,
            medium=setting.medium,
        )
        modelled[:, k] = print_.arrival_ps + correction
        gap[near, k] = np.abs(sighting.arrival_ps[usable] - modelled[:, k])[near]
        beyond = np.minimum(_within_px(print_, k, state, tips, setting), 0.0)
        expected[:, k] = np.exp(-0.5 * (print_.lateral_px**2 + beyond**2) / spot_px**2)
    best = np.argmin(gap, axis=1)
    total = np.hypot(arrivals.independent_std_ps[usable], floor_ps)
    # Or half a pulse while the path is rough.
    mine = gap[np.arange(n), best] < np.maximum(CLAIM_STDS * total, 0.5 * std)
    shift = _shift_by_others_ps(modelled, expected, best, arrivals, usable, std)
    mine &= shift < MOST_SHIFT * total
    chosen = np.flatnonzero(mine)
    index, leg_of = usable[chosen], best[chosen]
    print_ = footprints(
        state,
        camera=setting.camera,
        medium=setting.medium,
        legs=leg_of,
        rows=arrivals.row[index],
        cols=arrivals.col[index],
    )
    footprint_ps = modelled[chosen, leg_of] - print_.arrival_ps
    return time_data(sighting, index, leg_of, footprint_ps)


def shift_by_ends_ps(
    print_: Footprint, leg: int, spot_px: float, state: PathState, tips: Tips, setting: Setting
) -> Floats:
    """By how much an end of a leg's light within the spot moves the mean time of a pulse, (n,), ps.

    What is left of a Gaussian that ends at d has its mean where d is large at s f(d / s), f the
    density and s the spot: times the slope of the time.

    Parameters
    ----------
    print_ : Footprint
        Where each pixel looks along the leg.
    leg : int
        Index of the leg.
    spot_px : float
        Standard deviation of the spot, px.
    state : PathState
        The path.
    tips : Tips
        Where its light begins and stops in the picture.
    setting : Setting
        The camera that sees it.
    """
    away = _within_px(print_, leg, state, tips, setting) / spot_px
    density = np.exp(-0.5 * away**2) / np.sqrt(2.0 * np.pi)
    shift: Floats = np.abs(print_.slope_ps_per_px) * spot_px * density
    return shift


def mean_of_cut_light_ps(
    print_: Footprint, leg: int, spot_px: float, state: PathState, tips: Tips, setting: Setting
) -> Floats:
    """Mean time of a leg's light in pixels whose spot its ends cut, after that of their feet, ps.

    Of a Gaussian between a and b of its standard deviations from the foot (f(a) - f(b)) / (F(b) -
    F(a)) of these, f the density and F its integral; parameters as in `shift_by_ends_ps`, (n,).
    """
    first, last = _ends_of_light(leg, state, tips, setting)
    scale = print_.px_per_leg / spot_px
    low, high = (
        np.clip((end - print_.fraction) * scale, -_FAR_STDS, _FAR_STDS) for end in (first, last)
    )
    density = [np.exp(-0.5 * end**2) / np.sqrt(2.0 * np.pi) for end in (low, high)]
    share = np.maximum(ndtr(high) - ndtr(low), 1e-12)
    shift: Floats = print_.slope_ps_per_px * spot_px * (density[0] - density[1]) / share
    return shift


def on_leg(
    print_: Footprint, leg: int, state: PathState, *, margin_px: float | tuple[float, float]
) -> NDArray[np.bool_]:
    """True where a pixel's foot lies on the leg, or at most `margin_px` beyond its corners.

    A negative margin keeps clear of the corners. The ends of the path are not corners.

    Parameters
    ----------
    print_ : Footprint
        Where each pixel looks along its leg.
    leg : int
        Index of the leg.
    state : PathState
        The path as it is now.
    margin_px : float or (float, float)
        How far beyond a corner still counts, px; negative: how clear of it. Two: at the leg's start
        and at its end.

    Returns
    -------
    array of bool, shape (n,)
    """
    first, last = margin_px if isinstance(margin_px, tuple) else (margin_px, margin_px)
    low = -first / print_.px_per_leg if leg > 0 else -np.inf
    high = np.inf if leg in state.last_legs else 1.0 + last / print_.px_per_leg
    inside: NDArray[np.bool_] = (print_.fraction > low) & (print_.fraction < high)
    return inside


def roughly_on_leg(print_: Footprint, leg: int, state: PathState) -> NDArray[np.bool_]:
    """True where a pixel's foot lies on the leg or a fiftieth of it beyond its corners."""
    low = -0.02 if leg > 0 else -np.inf
    high = np.inf if leg in state.last_legs else 1.02
    inside: NDArray[np.bool_] = (print_.fraction > low) & (print_.fraction < high)
    return inside


def _clear_of_corners(
    print_: Footprint,
    leg: int,
    state: PathState,
    members: Indices | None,
    clear_px: tuple[float, float],
) -> NDArray[np.bool_]:
    """True where a pixel's foot is on the leg and no corner is within the spot."""
    clear = on_leg(print_, leg, state, margin_px=(-clear_px[0], -clear_px[1]))
    if members is None:
        return clear
    beyond = ~on_leg(print_, leg, state, margin_px=clear_px)
    clear |= beyond & (members == leg)
    return clear


def off_light_ps(
    sighting: Sighting,
    state: PathState,
    setting: Setting,
    spot_px: float,
    std: float,
    rows: Indices,
) -> Floats:
    """How far pulses that take no part in a fit are from the time of the legs' light, ps.

    Where two legs meet or cross a pixel's one time is neither's, but it lies between them, if they
    are too near to each other to be seen apart; and the wing of a bright leg's spot runs farther
    than what it claims.

    Parameters
    ----------
    sighting : Sighting
        The recording, on the clock as found.
    state : PathState
        The path.
    setting : Setting
        The camera that sees it, and the medium.
    spot_px : float
        Standard deviation of the spot, px.
    std : float
        Typical standard deviation of a pulse, ps.
    rows : array of int, shape (n,)
        Rows of its arrivals.

    Returns
    -------
    array of float, shape (n,)
        0 between two such; infinite where no leg's light is in the pixel.
    """
    arrival = sighting.arrival_ps[rows]
    before, after = np.full(len(rows), -np.inf), np.full(len(rows), np.inf)
    for k in state.seen:
        print_ = prints_of_leg(sighting, state, setting, rows, k)
        lit = np.abs(print_.lateral_px) < max(CLAIM_REACH_PX, _WING_STDS * spot_px)
        # Beyond a corner a leg sheds no light but what the spot spreads.
        lit &= on_leg(print_, k, state, margin_px=spot_px)
        time = print_.arrival_ps
        before = np.where(lit & (time <= arrival), np.maximum(before, time), before)
        after = np.where(lit & (time >= arrival), np.minimum(after, time), after)
    nearest = np.minimum(arrival - before, after - arrival)
    return np.where(after - before < _APART_STDS * std, 0.0, nearest)


def clear_of_tips(
    print_: Footprint, leg: int, state: PathState, tips: Tips, setting: Setting
) -> NDArray[np.bool_]:
    """True where a pixel's whole footprint on a leg is lit: not where the light begins or stops.

    A footprint that is cut has another mean time, by as much as the leg is steep.

    Parameters
    ----------
    print_ : Footprint
        Where each pixel looks along its leg.
    leg : int
        Index of the leg.
    state : PathState
        The path as it is now.
    tips : Tips
        (row, col, camera) where the light begins and stops in the picture; None: it does not.
    setting : Setting
        Camera, source, medium and waypoints.

    Returns
    -------
    array of bool, shape (n,)
    """
    # The gate is in px, the foot in fractions of the leg.
    margin = _TIP_PX / print_.px_per_leg
    clear = np.ones(len(print_.fraction), dtype=bool)
    first, last = _tips_on_leg(leg, state, tips, setting)
    if first is not None:
        clear &= print_.fraction > first + margin
    if last is not None:
        clear &= print_.fraction < last - margin
    return clear


def _tips_on_leg(
    leg: int, state: PathState, tips: Tips, setting: Setting
) -> tuple[float | None, float | None]:
    """Fractions of a leg where light begins and stops in the picture; None: it does not."""
    found = tips[0] if leg == 0 else None, tip_of_leg(tips, leg, state)
    first, last = (None if tip is None else fraction_at(tip, leg, state, setting) for tip in found)
    return first, last


def _within_px(
    print_: Footprint, leg: int, state: PathState, tips: Tips, setting: Setting
) -> Floats:
    """How far within the ends of its light on a leg each pixel's foot lies, px; negative: beyond.

    Where light comes into view or leaves it there is no end.
    """
    first, last = _ends_of_light(leg, state, tips, setting)
    within: Floats = np.minimum(print_.fraction - first, last - print_.fraction)
    return within * print_.px_per_leg


def _ends_of_light(leg: int, state: PathState, tips: Tips, setting: Setting) -> tuple[float, float]:
    """Fractions of a leg between which it gives light; infinite where that is cut by no end."""
    first, last = _tips_on_leg(leg, state, tips, setting)
    if first is None:
        first = 0.0 if leg > 0 else -np.inf
    if last is None:
        last = np.inf if leg in state.last_legs else 1.0
    return first, last


def print_at(pixel: Floats, leg: int, state: PathState, setting: Setting) -> Footprint:
    """Footprint on a leg of one place (row, col, ...) of the picture."""
    return footprints(
        state,
        camera=setting.camera,
        medium=setting.medium,
        legs=leg,
        rows=pixel[:1],
        cols=pixel[1:2],
    )


def tips_in_view(tips: Tips, state: PathState, setting: Setting, view: int) -> Tips:
    """The tips in the picture of one of several cameras, whichever saw them.

    Parameters
    ----------
    tips : Tips
        Of the path.
    state : PathState
        The path.
    setting : Setting
        Cameras, source, medium and waypoints.
    view : int
        The camera, by number.

    Returns
    -------
    Tips
        Perhaps beside the picture; None where that camera sees no such place.
    """
    if not setting.others:
        return tips
    found: list[Floats | None] = []
    for tip, leg in zip(tips, (0, *state.last_legs), strict=False):
        if tip is None or int(tip[2]) == view:
            found.append(tip)
            continue
        share = fraction_at(tip, leg, state, setting.at(int(tip[2])))
        place = state.points_mm(leg, np.array([share]))[0]
        there = np.array([*setting.cameras[view].pixels_from_points(place), view], dtype=float)
        found.append(there if np.isfinite(there).all() else None)
    return tuple(found)


def fraction_at(pixel: Floats, leg: int, state: PathState, setting: Setting) -> float:
    """Fraction of a leg that a place (row, col) of the picture sees."""
    return float(print_at(pixel, leg, state, setting).fraction[0])


def _shift_by_others_ps(
    modelled: Floats,
    expected: Floats,
    best: Indices,
    arrivals: Arrivals,
    usable: Indices,
    std: float,
) -> Floats:
    """By how much a second leg's light that sits unresolved under a pulse may move it, ps."""
    n, n_legs = modelled.shape
    rows = np.arange(n)
    # Two pulses that were fitted apart must only be far enough for both to be true.
    single = (arrivals.flags[usable] & np.uint32(flags.MULTIPLE_PULSES)) == 0
    shift = np.zeros(n)
    own = np.maximum(expected[rows, best], 1e-12)
    for k in range(n_legs):
        separation = np.nan_to_num(np.abs(modelled[:, k] - modelled[rows, best]), nan=np.inf)
        close = (separation < np.where(single, _APART_STDS, 1.5) * std) & (best != k)
        shift += np.where(close, expected[:, k] / own * np.where(close, separation, 0.0), 0.0)
    return shift


def stacked(parts: list[TimeData], columns: dict[int, slice]) -> TimeData:
    """Pulses of all recordings in one table, shared errors in the columns of their camera.

    Parameters
    ----------
    parts : list of TimeData
        One table per recording.
    columns : dict of int to slice
        By `mode_columns`.

    Returns
    -------
    TimeData
        One table, parts in their order.
    """
    n_modes = max((own.stop for own in columns.values()), default=0)
    spread = []
    for part in parts:
        modes = np.zeros((len(part.leg), n_modes))
        view = int(part.view[0]) if len(part.view) else 0
        modes[:, columns[view]] = part.modes_ps
        spread.append(replace(part, modes_ps=modes))
    if len(spread) == 1:
        return spread[0]
    return TimeData(
        **{
            name: np.concatenate([getattr(part, name) for part in spread])
            for name in TimeData.__dataclass_fields__
        }
    )


def stacked_lines(parts: list[LineDataInPicture]) -> LineDataInPicture:
    """Lines of all recordings in one table, each in its camera's picture.

    Parameters
    ----------
    parts : list of LineDataInPicture
        Lines of each recording.

    Returns
    -------
    LineDataInPicture
        Lines of all; errors of different recordings are independent.
    """
    return LineDataInPicture(
        leg=np.concatenate([p.leg for p in parts]),
        anchors=np.concatenate([p.anchors for p in parts]),
        whitening=block_diag(*(p.whitening for p in parts)),
        view=np.concatenate([p.view for p in parts]),
    )
