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
    ends_in_view,
    freedom_of_path,
    last_in_view,
    view_end,
    view_end_at,
    view_plane,
    with_tip,
)
from lightflight.reconstruct.model.geometry import Indices, PathState, footprints
from lightflight.reconstruct.model.setting import Setting
from lightflight.reconstruct.model.sighting import Sighting
from lightflight.units import SPEED_OF_LIGHT_MM_PER_PS

if TYPE_CHECKING:
    from lightflight.camera.model import Camera

Floats = NDArray[np.float64]

DARK_PX = 1.2
"""Light whose last pixel is farther than this from the picture's edge ends in the picture, px."""
_STOPS_PX = 4.0
"""Light whose last pixel is farther than this from where its leg meets the edge ends there, px."""
_LIT_SHARE = 0.6
"""Where a leg's light falls below this share of what it was, the leg has ended."""
_BESIDE_PX = 2.5
"""Pixels nearer than this are side by side, px: the wing of a spot of less than two pixels falls by
more than `_LIT_SHARE` from one to the next."""
_WING_PX = 3.0
"""The spot's wing beyond a tip is no longer than this, px."""
_OUTER_PX = 1.6
"""Pulses this near to the outermost of an end are judged together, px."""
_FEW_INNER = 6
"""An end is judged only by a path that rests on at least so many other pulses of its leg."""
_FALSE_CUT = 1e-4
"""Chance that an end which is whole is taken for cut."""
_OUTER_RAMP_PX, _MOST_BEYOND_PX = 3.0, 1.0
"""The light of so many pixels about a tip, and of as many behind, says where it is, px; to within a
pixel of the outermost pulse."""
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
        (row, col, camera), of first and last, or None.
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
        _outermost_end(state, leg, sightings, setting, std, outwards=1.0) for leg in state.last_legs
    ]
    for leg, (end, _) in zip(state.last_legs, ends_seen, strict=True):
        if end is not None and not bent(np.array([leg])):
            vertices[leg + 1] = end.position_mm
    entry = None
    if setting.source.position_mm is None:
        entry, first_tip = _outermost_end(state, 0, sightings, setting, std, outwards=-1.0)
        if entry is not None and not bent(np.array([0])):
            direction = vertices[1] - vertices[0]
            length = float(np.linalg.norm(direction))
            moved = float((entry.position_mm - vertices[0]) @ direction) / length
            vertices[0] = entry.position_mm
            # The first vertex slides along its leg, so the time there slides with it.
            start_time += moved * setting.medium.path_group_index / SPEED_OF_LIGHT_MM_PER_PS
    else:
        # A source in view begins the light: its pixel's footprint is cut there.
        view = _view_of(setting, vertices[0])
        first_tip = None if view is None else _tip(setting, vertices[0], view)
    ends = Ends(
        _start_plane(replace(state, vertices_mm=vertices), setting)
        if entry is None
        else entry.basis,
        tuple(
            _end_plane(replace(state, vertices_mm=vertices), leg, setting)
            if end is None
            else end.basis
            for leg, (end, _) in zip(state.last_legs, ends_seen, strict=True)
        ),
        (first_tip, *(tip for _, tip in ends_seen)),
    )
    return replace(state, vertices_mm=vertices, start_time_ps=float(start_time)), ends


def _view_of(setting: Setting, place: Floats) -> int | None:
    """The first camera, by number, that sees a place (3,); None: no camera does."""
    return next((n for n, camera in enumerate(setting.cameras) if camera.sees(place)), None)


def _tip(setting: Setting, place: Floats, view: int) -> Floats:
    """(row, col, camera) of a place (3,) in a camera's picture."""
    return np.array([*setting.cameras[view].pixels_from_points(place), view], dtype=float)


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
        lit = _outermost_lit(state, leg, sightings, setting, std, outwards)
        if lit is None:
            continue
        last = _fraction_at_edge(state, leg, lit.fraction, outwards, setting.at(lit.view))
        if _stops(state, leg, lit, last, setting.at(lit.view)):
            last = lit.fraction
        if last is not None:
            state = state.prolonged(leg, last, setting.medium, at_end=outwards > 0)
    return state


def _stops(state: PathState, leg: int, lit: _Lit, at_edge: float | None, setting: Setting) -> bool:
    """Whether a bent leg's light stops before the picture's edge, which is at a fraction of it."""
    if not (lit.in_view and lit.is_sharp):
        return False
    if at_edge is None:
        return True
    edge = state.points_mm(leg, np.array([at_edge]))[0]
    return lit.gap_px(edge, setting.camera) >= _STOPS_PX


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


def _end_plane(state: PathState, leg: int, setting: Setting) -> Floats:
    """(3, 2), the plane in which the end of a last leg moves: across it."""
    end = state.vertices_mm[leg + 1]
    camera = setting.cameras[_view_of(setting, end) or 0]
    if not state.bends:
        return view_plane(camera, end, state.starts_mm[leg])
    return view_plane(camera, end, end - state.tangents_mm(leg, np.ones(1))[0])


def _start_plane(state: PathState, setting: Setting) -> Floats:
    """(3, 2), the plane in which the start of the path moves: across its first leg."""
    start = state.vertices_mm[0]
    camera = setting.cameras[_view_of(setting, start) or 0]
    if not state.bends:
        return view_plane(camera, start, state.vertices_mm[1])
    return view_plane(camera, start, start + state.tangents_mm(0, np.zeros(1))[0])


def freedom_at(state: PathState, setting: Setting, ends: Ends | None = None) -> Freedom:
    """Freedom of a path in a setting; `ends` None: its ends move across their own legs.

    An end where the light is seen to begin or stop in the picture moves along its leg too.

    Parameters
    ----------
    state : PathState
        The path as it is now.
    setting : Setting
        Camera, source, medium and waypoints.
    ends : Ends, optional
        Ends as seen; None: they move across their own legs.

    Returns
    -------
    Freedom
        Columns that may move, and priors.

    Raises
    ------
    GeometryError
        Where a leg at an end points straight at the camera.
    """
    lengths = setting.lengths
    if ends is None:
        # Where legs end is not yet known, and so none of their lengths.
        lengths = ()
        ends = Ends(
            _start_plane(state, setting),
            tuple(_end_plane(state, leg, setting) for leg in state.last_legs),
        )
    tips = ends.tips

    def end_basis(basis: Floats, leg: int, at: float, tip: Floats | None) -> Floats:
        if tip is None:
            return basis
        fraction, camera = np.array([at]), setting.cameras[int(tip[2])]
        end = state.vertices_mm[leg + 1 if at else 0]
        return with_tip(basis, end, state.tangents_mm(leg, fraction)[0], camera)

    start = end_basis(ends.start_basis, 0, 0.0, tips[0])
    lasts = tuple(
        end_basis(basis, leg, 1.0, tip_of_leg(tips, leg, state))
        for leg, basis in zip(state.last_legs, ends.end_bases, strict=True)
    )
    freedom = freedom_of_path(
        state,
        source=setting.source,
        waypoints=setting.waypoints,
        start_basis=start if setting.source.position_mm is None else None,
        end_bases=lasts,
        lengths=lengths,
        curves=setting.curves,
    )
    return with_detours_level(freedom, state, setting.camera)


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
        (row, col, camera), of the outermost pulse of an end that is cut; None: the end is whole.

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
        # Where several cameras see the leg, that which sees most of its end.
        seen = [_towards_end(solution, times, leg, sign, n) for n in range(len(solution.cameras))]
        view = int(np.argmax([share for share, _, _ in seen]))
        _, here, outwards = seen[view]
        # Judged together: a cut shifts all pixels of the last column, each by little.
        outer = outwards > outwards.max(initial=-np.inf) - _OUTER_PX
        if not outer.any() or np.count_nonzero(~outer) < _FEW_INNER:
            continue
        if pulls[here][outer].sum() > chdtri(np.count_nonzero(outer), _FALSE_CUT):
            outermost = here[int(np.argmax(outwards))]
            found[end] = np.array([times.row[outermost], times.col[outermost], view])
    return tuple(found)


def _towards_end(
    solution: Solution, times: TimeData, leg: int, sign: float, view: int
) -> tuple[float, Indices, Floats]:
    """Of one camera's pulses on a leg: how far out the outermost is, which, and how far, px."""
    here = np.flatnonzero((times.leg == leg) & (times.view == view))
    print_ = footprints(
        solution.state,
        camera=solution.cameras[view],
        medium=solution.medium,
        legs=leg,
        rows=times.row[here],
        cols=times.col[here],
    )
    outermost = float((sign * print_.fraction).max(initial=-np.inf))
    return outermost, here, sign * print_.fraction * print_.px_per_leg


def _outermost_end(
    state: PathState,
    leg: int,
    sightings: list[Sighting],
    setting: Setting,
    std: float,
    *,
    outwards: float,
) -> tuple[ViewEnd | None, Floats | None]:
    """Where the camera that sees most of a leg's end sees it leave or stop; and the light's tip."""
    lit = _outermost_lit(state, leg, sightings, setting, std, outwards)
    if lit is None:
        return None, None
    own = [o for o in sightings if o.view == lit.view]
    return _visible_end(state, leg, own, setting.at(lit.view), std, lit, outwards=outwards)


def _visible_end(
    state: PathState,
    leg: int,
    sightings: list[Sighting],
    setting: Setting,
    std: float,
    lit: _Lit,
    *,
    outwards: float,
) -> tuple[ViewEnd | None, Floats | None]:
    """Where a leg leaves the picture, or where its light stops within it; and the light's tip.

    The tip is None where the light reaches the edge, or is too dim to tell.
    """
    camera = setting.camera
    inside = state.points_mm(leg, np.array([lit.fraction]))[0]
    step = state.tangents_mm(leg, np.array([lit.fraction]))[0]
    direction = step / np.linalg.norm(step)
    if state.is_bent(np.array([leg])):
        # It was cut where it leaves the view, or where its light stops.
        end = state.vertices_mm[leg + 1] if outwards > 0 else state.vertices_mm[0]
        edge = None if ends_in_view(camera, end) else view_end_at(camera, end)
    else:
        edge = view_end(camera, inside, outwards * direction)
    tip = lit.tip_px
    dark = all(_recorded_beyond(o, state, setting, leg, tip, std, outwards) for o in sightings)
    seen_tip = np.append(tip, lit.view) if dark else None
    if edge is not None:
        # Along an edge that it leaves slowly a leg has feet beyond it, of pixels that see its spot.
        if not lit.in_view:
            return edge, None
        gap = lit.gap_px(edge.position_mm, camera)
        # Near the edge, or with a dim leg, the edge is the better guess of the end.
        if not lit.is_sharp or gap < (DARK_PX if dark else _STOPS_PX):
            return edge, None
    along = camera.pixel_jacobian(inside) @ direction
    px_per_mm = max(float(np.hypot(*along)), 1e-9)
    along = along / px_per_mm
    across = float(-along[1]), float(along[0])
    if dark and lit.is_sharp:
        inside = inside + lit.beyond_px(outwards * along) / px_per_mm * outwards * direction
    return end_in_picture(camera, inside, across), seen_tip


@dataclass(frozen=True, eq=False)
class _Lit:
    """The outermost light of a leg, and its pulses.

    Attributes
    ----------
    fraction : float
        Of the leg, in view.
    in_view : bool
        Whether the foot of its outermost pulse is; else `fraction` is that of its middle.
    tip_px : array of float, shape (2,)
        (row, col) of the outermost pulse.
    places_px : array of float, shape (n, 2)
        Of all.
    photons : array of float, shape (n,)
        Of all.
    view : int
        The camera that saw it.
    """

    fraction: float
    in_view: bool
    tip_px: Floats
    places_px: Floats
    photons: Floats
    view: int

    def gap_px(self, place_mm: Floats, camera: Camera) -> float:
        """From the tip to the image of a place (3,), world, mm; px."""
        return float(np.hypot(*(np.array(camera.pixels_from_points(place_mm)) - self.tip_px)))

    def beyond_px(self, along: Floats) -> float:
        """How far beyond the foot of the outermost pulse the light ends, `along` (2,) outwards.

        Where a line as bright as it is behind would end that holds as much light: (n,) pulses with
        feet u, weighed by a ramp r, hold the light from its middle to the end.
        """
        foot = (self.places_px - self.tip_px) @ along

        def ramp(begin: float) -> Floats:
            """0 up to `begin`, 1 from two pixels on: edges would say how pixels lie."""
            return np.clip(0.5 * (foot - begin), 0.0, 1.0)

        outer = float(self.photons @ ramp(-_OUTER_RAMP_PX))
        inner = float(self.photons @ ramp(-2.0 * _OUTER_RAMP_PX)) - outer
        held = _OUTER_RAMP_PX * outer / max(inner, 1e-9)
        return float(np.clip(held - (_OUTER_RAMP_PX - 1.0), -_MOST_BEYOND_PX, _MOST_BEYOND_PX))

    @property
    def is_sharp(self) -> bool:
        """Whether a tip is believed: on a bright leg, lit at five places and more behind it."""
        away = np.hypot(*(self.places_px - self.tip_px).T)
        bright = np.median(self.photons[away < 4.0]) > 50.0
        return bool(bright and len(np.unique(np.rint(away[away < 6.0]))) >= 5)


def _outermost_lit(
    state: PathState,
    leg: int,
    sightings: list[Sighting],
    setting: Setting,
    std: float,
    outwards: float,
) -> _Lit | None:
    """The outermost light of a leg in any camera's picture; None where no camera shows any."""
    seen = (
        _last_lit_place(state, leg, sightings, setting, std, outwards, view)
        for view in range(len(setting.cameras))
    )
    return max(
        (lit for lit in seen if lit is not None),
        key=lambda lit: outwards * lit.fraction,
        default=None,
    )


def _last_lit_place(
    state: PathState,
    leg: int,
    sightings: list[Sighting],
    setting: Setting,
    std: float,
    outwards: float,
    view: int,
) -> _Lit | None:
    """The outermost light of a leg in one camera's picture; None where there is none."""
    setting = setting.at(view)
    camera, own = setting.camera, [o for o in sightings if o.view == view]
    seen = [_footprints_of_pulses(o, state, setting, leg, std) for o in own]
    fraction, photons, strength = (np.concatenate(column) for column in zip(*seen, strict=True))
    if not len(fraction):
        return None
    places = np.column_stack(camera.pixels_from_points(state.points_mm(leg, fraction)))
    extreme = _last_lit(places, outwards * fraction, strength)
    inside = float(fraction[extreme])
    in_view = bool(camera.sees(state.points_mm(leg, np.array([inside]))[0]))
    # The outermost foot may lie beyond the edge; the middle of the light is in view.
    inside = inside if in_view else float(np.median(fraction))
    return _Lit(inside, in_view, places[extreme], places, photons, view)


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
        beside = (away > away[this] + 0.5) & (away < away[this] + _BESIDE_PX)
        # A wing falls from pixel to pixel; light that was brighter farther back has not ended.
        least = min(np.median(strength[some]) for some in (inner, beside) if some.any())
        # The brightest of a position lies on the line; those beside it are dimmer for being aside.
        if strength[near].max() > _LIT_SHARE * least:
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
