"""The ends of a path: where it enters and leaves the view, or where its light begins and stops.

Takes a path that is roughly right and the pulses of recordings; gives the path with its ends put
there, the planes in which they may move, and the tips of the light in the picture.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import zip_longest
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtri

from lightflight.reconstruct.fit.least_squares import OUTLIER, Solution, TimeData
from lightflight.reconstruct.fit.membership import (
    Tips,
    print_at,
    prints_of_leg,
    roughly_on_leg,
    tip_of_leg,
)
from lightflight.reconstruct.model.detour import with_detours_level
from lightflight.reconstruct.model.freedom import (
    Freedom,
    ViewEnd,
    end_in_picture,
    freedom_of_path,
    last_in_view,
    view_end,
    view_end_at,
    view_plane,
    with_tip,
)
from lightflight.reconstruct.model.geometry import PathState, footprints
from lightflight.reconstruct.model.setting import Setting
from lightflight.reconstruct.model.sighting import Sighting
from lightflight.units import SPEED_OF_LIGHT_MM_PER_PS

if TYPE_CHECKING:
    from lightflight.camera.model import Camera

Floats = NDArray[np.float64]

_DARK_PX = 1.2
"""Light whose last pixel is farther than this from the picture's edge ends in the picture, px."""
_LIT_SHARE = 0.6
"""Where a leg's light falls below this share of what it was, the leg has ended."""
_WING_PX = 3.0
"""The spot's wing beyond a tip is no longer than this, px."""
_OUTER_PX = 1.6
"""Pulses this near to the outermost of an end are judged together, px."""
_FEW_INNER = 6
"""An end is judged only by a path that rests on at least so many other pulses of its leg."""
_FALSE_CUT = 1e-4
"""Chance that an end which is whole is taken for cut."""
_USUAL_SPOT_PX = 0.4
"""Std of a usual spot, px, to compare pixels on a leg's line with pixels beside it."""


_BENT_ON = 0.25
"""Share of its length by which a bent leg is followed beyond its ends to the picture's edge: the
ends lie near there, and a polynomial runs away farther on."""
_BENT_PLACES = 801
"""That are looked at: less than a pixel apart."""


@dataclass(frozen=True, eq=False)
class Ends:
    """Planes in which the visible ends of a path move.

    Attributes
    ----------
    start_basis : array of float, shape (3, 2)
        At the entry into view (used where the source is unknown).
    end_bases : tuple of array of float, shape (3, 2)
        At the exit from view; of a path with arms at each, in the order of `PathState.last_legs`.
    tips : Tips
        Where the light begins and stops within the picture; None: it crosses the edge.
    """

    start_basis: Floats
    end_bases: tuple[Floats, ...]
    tips: Tips = (None, None)


def known_tips(one: Tips, other: Tips) -> Tips:
    """Tips of `one`, and of `other` where that knows none.

    Parameters
    ----------
    one : Tips
        Tips that count where they are known.
    other : Tips
        Tips that stand in for them.

    Returns
    -------
    Tips
        (row, col), of first and last, or None.
    """
    return tuple(a if a is not None else b for a, b in zip_longest(one, other))


def with_ends(
    state: PathState, sightings: list[Sighting], setting: Setting, std: float
) -> tuple[PathState, Ends]:
    """The state with its last vertex (unknown source: and its first) where it leaves the view.

    Parameters
    ----------
    state : PathState
        The path as it is now.
    sightings : list of Sighting
        Recordings of one flight, on the clock and with their pulses found.
    setting : Setting
        Camera, source, medium and waypoints.
    std : float
        Typical standard deviation of a pulse, ps.

    Returns
    -------
    state : PathState
        The path, its time at the start moved along with its first vertex.
    ends : Ends
        Planes in which the ends may move, and tips of the light.
    """
    state, bent = _with_bent_ends(state, sightings, setting, std), state.is_bent
    vertices, start_time = state.vertices_mm.copy(), state.start_time_ps
    ends_seen = [
        _visible_end(state, leg, sightings, setting, std, outwards=1.0) for leg in state.last_legs
    ]
    for leg, (end, _) in zip(state.last_legs, ends_seen, strict=True):
        if end is not None and not bent(np.array([leg])):
            vertices[leg + 1] = end.position_mm
    entry = None
    if setting.source.position_mm is None:
        entry, first_tip = _visible_end(state, 0, sightings, setting, std, outwards=-1.0)
        if entry is not None and not bent(np.array([0])):
            direction = vertices[1] - vertices[0]
            length = float(np.linalg.norm(direction))
            moved = float((entry.position_mm - vertices[0]) @ direction) / length
            vertices[0] = entry.position_mm
            # The first vertex slides along its leg, so the time there slides with it.
            start_time += moved * setting.medium.path_group_index / SPEED_OF_LIGHT_MM_PER_PS
    else:
        # A source in view begins the light: its pixel's footprint is cut there.
        seen = bool(setting.camera.sees(vertices[0]))
        first_tip = np.array(setting.camera.pixels_from_points(vertices[0])) if seen else None
    ends = Ends(
        _start_plane(replace(state, vertices_mm=vertices), setting.camera)
        if entry is None
        else entry.basis,
        tuple(
            _end_plane(replace(state, vertices_mm=vertices), leg, setting.camera)
            if end is None
            else end.basis
            for leg, (end, _) in zip(state.last_legs, ends_seen, strict=True)
        ),
        (first_tip, *(tip for _, tip in ends_seen)),
    )
    return replace(state, vertices_mm=vertices, start_time_ps=float(start_time)), ends


def _with_bent_ends(
    state: PathState, sightings: list[Sighting], setting: Setting, std: float
) -> PathState:
    """The same flight, with bent legs at its ends cut where they leave the view."""
    legs = [(leg, 1.0) for leg in state.last_legs]
    if setting.source.position_mm is None:
        legs.append((0, -1.0))
    for leg, outwards in legs:
        if not state.is_bent(np.array([leg])):
            continue
        lit = _last_lit_place(state, leg, sightings, setting, std, outwards)
        if lit is None:
            continue
        last = _fraction_at_edge(state, leg, lit.fraction, outwards, setting)
        if last is not None:
            state = state.prolonged(leg, last, setting.medium, at_end=outwards > 0)
    return state


def _fraction_at_edge(
    state: PathState, leg: int, inside: float, outwards: float, setting: Setting
) -> float | None:
    """Fraction of a bent leg at which it leaves the picture; None: it does not."""
    at = inside + outwards * np.linspace(0.0, 1.0 + _BENT_ON, _BENT_PLACES)
    at = at[(at > -_BENT_ON) & (at < 1.0 + _BENT_ON)]

    def place(fraction: Floats | float) -> Floats:
        found = state.points_mm(leg, np.atleast_1d(np.asarray(fraction, dtype=float)))
        return found if np.ndim(fraction) else found[0]

    return last_in_view(setting.camera, place, at)


def _end_plane(state: PathState, leg: int, camera: Camera) -> Floats:
    """(3, 2), the plane in which the end of a last leg moves: across it."""
    end = state.vertices_mm[leg + 1]
    if not state.bends:
        return view_plane(camera, end, state.starts_mm[leg])
    return view_plane(camera, end, end - state.tangents_mm(leg, np.ones(1))[0])


def _start_plane(state: PathState, camera: Camera) -> Floats:
    """(3, 2), the plane in which the start of the path moves: across its first leg."""
    start = state.vertices_mm[0]
    if not state.bends:
        return view_plane(camera, start, state.vertices_mm[1])
    return view_plane(camera, start, start + state.tangents_mm(0, np.zeros(1))[0])


def freedom_at(
    state: PathState, setting: Setting, ends: Ends | None = None, *, tips_move: bool = False
) -> Freedom:
    """Freedom of a path in a setting; `ends` None: its ends move across their own legs.

    `tips_move`: an end where the light begins or stops in the picture moves along its leg too.

    Parameters
    ----------
    state : PathState
        The path as it is now.
    setting : Setting
        Camera, source, medium and waypoints.
    ends : Ends, optional
        Ends as seen; None: they move across their own legs.
    tips_move : bool, optional
        An end where the light begins or stops in the picture moves along its leg too.

    Returns
    -------
    Freedom
        Columns that may move, and priors.

    Raises
    ------
    GeometryError
        Where a leg at an end points straight at the camera.
    """
    camera, vertices = setting.camera, state.vertices_mm
    if ends is None:
        ends = Ends(
            _start_plane(state, camera),
            tuple(_end_plane(state, leg, camera) for leg in state.last_legs),
        )
    tips: Tips = ends.tips if tips_move else (None,)
    start = ends.start_basis
    if tips[0] is not None:
        start = with_tip(start, vertices[0], state.tangents_mm(0, np.zeros(1))[0], camera)
    lasts = tuple(
        basis
        if tip_of_leg(tips, leg, state) is None
        else with_tip(basis, vertices[leg + 1], state.tangents_mm(leg, np.ones(1))[0], camera)
        for leg, basis in zip(state.last_legs, ends.end_bases, strict=True)
    )
    freedom = freedom_of_path(
        state,
        source=setting.source,
        waypoints=setting.waypoints,
        start_basis=start if setting.source.position_mm is None else None,
        end_bases=lasts,
        curves=setting.curves,
    )
    return with_detours_level(freedom, state, camera)


def cut_tips(solution: Solution, times: TimeData, floor_ps: float, setting: Setting) -> Tips:
    """Ends of the path whose outermost pulses disagree with it, as cut footprints do.

    Where light stops within a pixel's footprint, near the picture's edge or in it, the pixel's
    time is that of the lit part: by the leg's slope earlier, or later, than the whole one's.

    Parameters
    ----------
    solution : Solution
        The fit.
    times : TimeData
        The pulses it rests on.
    floor_ps : float
        Error per pulse beyond the stated ones, ps.
    setting : Setting
        Camera, source, medium and waypoints.

    Returns
    -------
    Tips
        (row, col), of the outermost pulse of an end that is cut; None: the end is whole.

    Notes
    -----
    The squared pulls of an end's outermost pulses sum to a chi-square where the end is whole; one
    so large that chance gives it once in ten thousand ends says that it is not.
    """
    state = solution.state
    found: list[Floats | None] = [None] * (1 + len(state.last_legs))
    if floor_ps > 0.0:  # errors that do not explain the middle of a leg cannot judge its ends
        return tuple(found)
    variance = times.photon_var + times.pixel_var
    # One wild pulse must not make an end look cut: it counts as an outlier's worth.
    pulls = np.minimum(solution.residual_ps**2 / variance, OUTLIER**2)
    signs = [-1.0] + [1.0] * len(state.last_legs)
    for end, (leg, sign) in enumerate(zip((0, *state.last_legs), signs, strict=True)):
        if end == 0 and setting.source.position_mm is not None:
            continue
        own = times.leg == leg if times.view is None else (times.leg == leg) & (times.view == 0)
        here = np.flatnonzero(own)
        print_ = footprints(
            state,
            camera=solution.camera,
            medium=solution.medium,
            legs=leg,
            rows=times.row[here],
            cols=times.col[here],
        )
        outwards = sign * print_.fraction * print_.px_per_leg
        # Judged together: a cut shifts all pixels of the last column, each by little.
        outer = outwards > outwards.max(initial=-np.inf) - _OUTER_PX
        if not outer.any() or np.count_nonzero(~outer) < _FEW_INNER:
            continue
        if pulls[here][outer].sum() > chdtri(np.count_nonzero(outer), _FALSE_CUT):
            outermost = here[int(np.argmax(outwards))]
            found[end] = np.array([times.row[outermost], times.col[outermost]])
    return tuple(found)


def _visible_end(
    state: PathState,
    leg: int,
    sightings: list[Sighting],
    setting: Setting,
    std: float,
    *,
    outwards: float,
) -> tuple[ViewEnd | None, Floats | None]:
    """Where a leg leaves the picture, or where its light stops within it; and the light's tip.

    The tip is None where the light reaches the edge, or is too dim to tell.
    """
    camera = setting.camera
    lit = _last_lit_place(state, leg, sightings, setting, std, outwards)
    if lit is None:
        return None, None
    inside = state.points_mm(leg, np.array([lit.fraction]))[0]
    step = state.tangents_mm(leg, np.array([lit.fraction]))[0]
    direction = step / np.linalg.norm(step)
    if state.is_bent(np.array([leg])):
        # It was cut where it leaves the view.
        last = _fraction_at_edge(state, leg, lit.fraction, outwards, setting)
        end = state.vertices_mm[leg + 1] if outwards > 0 else state.vertices_mm[0]
        edge = None if last is None else view_end_at(camera, end)
    else:
        edge = view_end(camera, inside, outwards * direction)
    tip, places, photons = lit.tip_px, lit.places_px, lit.photons
    own = [o for o in sightings if o.view == 0]
    dark = all(_recorded_beyond(o, state, setting, leg, tip, std, outwards) for o in own)
    away = np.hypot(*(places - tip).T)
    # A tip is believed only on a bright leg, lit at five places and more behind it.
    sharp = np.median(photons[away < 4.0]) > 50.0 and len(np.unique(np.rint(away[away < 6.0]))) >= 5
    if edge is not None:
        gap = float(np.hypot(*(np.array(camera.pixels_from_points(edge.position_mm)) - tip)))
        # Near the edge, or with a dim leg, the edge is the better guess of the end.
        if gap < 4.0 or not sharp:
            return edge, tip if dark and sharp and gap > _DARK_PX else None
    along = camera.pixel_jacobian(inside) @ direction
    along = along / max(float(np.hypot(*along)), 1e-9)
    across = float(-along[1]), float(along[0])
    return end_in_picture(camera, inside, across), tip if dark else None


@dataclass(frozen=True, eq=False)
class _Lit:
    """The outermost light of a leg, and its pulses.

    Attributes
    ----------
    fraction : float
        Of the leg, in view.
    tip_px : array of float, shape (2,)
        (row, col) of the outermost pulse.
    places_px : array of float, shape (n, 2)
        Of all.
    photons : array of float, shape (n,)
        Of all.
    """

    fraction: float
    tip_px: Floats
    places_px: Floats
    photons: Floats


def _last_lit_place(
    state: PathState,
    leg: int,
    sightings: list[Sighting],
    setting: Setting,
    std: float,
    outwards: float,
) -> _Lit | None:
    """The outermost light of a leg in the first camera's picture; None where there is none."""
    camera, own = setting.camera, [o for o in sightings if o.view == 0]
    seen = [_footprints_of_pulses(o, state, setting, leg, std) for o in own]
    fraction, photons, strength = (np.concatenate(column) for column in zip(*seen, strict=True))
    if not len(fraction):
        return None
    places = np.column_stack(camera.pixels_from_points(state.points_mm(leg, fraction)))
    extreme = _last_lit(places, outwards * fraction, strength)
    inside = float(fraction[extreme])
    # The outermost foot may lie a hair beyond the edge; the middle of the light is in view.
    if not bool(camera.sees(state.points_mm(leg, np.array([inside]))[0])):
        inside = float(np.median(fraction))
    return _Lit(inside, places[extreme], places, photons)


def _recorded_beyond(
    sighting: Sighting,
    state: PathState,
    setting: Setting,
    leg: int,
    tip: Floats,
    std: float,
    outwards: float,
) -> bool:
    """True where light beyond a tip would be in the recording; else its codes end there."""
    at_tip = print_at(tip, leg, state, setting)
    row, col = np.clip(np.rint(tip).astype(int), 0, np.array(setting.camera.shape) - 1).tolist()
    lower, upper = sighting.timing.code_intervals_ps([row], [col])
    period_ps = sighting.histograms.laser_period_ps
    # Codes that cover the whole period cannot end before the light does.
    if period_ps is not None and (upper - lower).sum() > 0.98 * period_ps:
        return True
    first, last = float(lower.min()), float(upper.max())
    delay = float(at_tip.arrival_ps[0] + outwards * _WING_PX * at_tip.slope_ps_per_px[0])
    delay += float(sighting.timing.skew_ps[row, col])
    if period_ps is not None:
        delay = first + (delay - first) % period_ps
    return first + 3.0 * std < delay < last - 3.0 * std


def _last_lit(places: Floats, outwards: Floats, strength: Floats) -> int:
    """The outermost pulse where the leg is as bright as before; beyond is the spot's wing alone.

    `places` (n, 2) in the picture, `outwards` (n,) how far along the leg towards its end.
    """
    order = np.argsort(-outwards)
    away = np.hypot(*(places - places[order[0]]).T)
    for this in order:
        near = np.abs(away - away[this]) < 0.5
        inner = (away > away[this] + 1.0) & (away < away[this] + 5.0)
        if away[this] > _WING_PX or np.count_nonzero(inner) < 3:
            break
        # The brightest of a position lies on the line; those beside it are dimmer for being aside.
        if strength[near].max() > _LIT_SHARE * np.median(strength[inner]):
            return int(this)
    return int(order[0])


def _footprints_of_pulses(
    sighting: Sighting, state: PathState, setting: Setting, leg: int, std: float
) -> tuple[Floats, Floats, Floats]:
    """(fraction along the leg, photons, those there would be on its line) of the leg's pulses.

    Pulses that agree with the leg in place and time; the spot is taken for a usual one.
    """
    usable = sighting.usable_pulses
    print_ = prints_of_leg(sighting, state, setting, usable, leg)
    gap = np.abs(sighting.arrival_ps[usable] - print_.arrival_ps)
    lit = (np.abs(print_.lateral_px) < 1.5) & (gap < std)
    lit &= roughly_on_leg(print_, leg, state)
    photons = sighting.arrivals.photons[usable][lit]
    on_line = photons * np.exp(0.5 * (print_.lateral_px[lit] / _USUAL_SPOT_PX) ** 2)
    return print_.fraction[lit], photons, on_line
