"""Arms of a beam splitter: light that leaves a path at one of its places, on the path's clock.

Takes a path and the pulses that it does not explain. A leg among those whose line in the picture
meets the path's may be an arm: it starts where they meet, when the light is there, like a path of
its own from a source that is known; or the last leg of an arm turns into it there. Where a path
turns, light may also go straight on: its pulses lie on the prolonged leg, and a fit may have taken
them for that leg's own.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from lightflight.errors import GeometryError
from lightflight.flight import Source
from lightflight.reconstruct.fit.joint import JointFit
from lightflight.reconstruct.fit.start import state_from_legs
from lightflight.reconstruct.legs.find import ImageLeg
from lightflight.reconstruct.model.freedom import view_end
from lightflight.reconstruct.model.geometry import PathState
from lightflight.reconstruct.model.image_plane import along_across, undistorted_px
from lightflight.reconstruct.model.setting import Setting
from lightflight.reconstruct.model.sighting import Sighting
from lightflight.reconstruct.trials.outcome import NoFit
from lightflight.reconstruct.trials.revise import refitted, setting_with_corner
from lightflight.reconstruct.trials.unclaimed import legs_among, unclaimed_by_path

Floats = NDArray[np.float64]

_PLACES = 401
"""Of a leg that are asked how far an arm's line runs from them: a tenth of a pixel apart."""
_REACH_PX = 2.5
"""An arm's line meets a path that it comes this near to, px: an arm of few pixels points no
better."""
_AT_VERTEX_PX = 2.5
"""An arm that leaves this near to a corner may leave at the corner, px."""
_MOST_LEGS = 8
"""Light on more legs than these is other light: three arms that mirrors in view turn once are six.
Beside a path that explains a third of a real recording there were 76, and a fit for each start."""


@dataclass(frozen=True, eq=False)
class Armed:
    """A path with one arm more.

    Attributes
    ----------
    fit : JointFit
        The path.
    parted : int or None
        The leg that is one with the next: the arm parts it. None where it leaves at a corner.
    """

    fit: JointFit
    parted: int | None = None


@dataclass(frozen=True, eq=False)
class _Start:
    """Where the fit of such a path begins; `parted` as its."""

    state: PathState
    setting: Setting
    parted: int | None = None


def fits_with_arm(sightings: list[Sighting], fit: JointFit, setting: Setting) -> list[Armed]:
    """Joint fits of a path with one arm more, from light that the path leaves.

    Parameters
    ----------
    sightings : list of Sighting
        Recordings of one flight, on the clock and with their pulses found.
    fit : JointFit
        The path without.
    setting : Setting
        Camera, source, medium and waypoints.

    Returns
    -------
    list of Armed
        One of each place at which a leg among the other light may leave the path.
    """
    starts: list[_Start] = []
    for view in range(len(setting.cameras)):
        first, seen = next(o for o in sightings if o.view == view), setting.at(view)
        left = unclaimed_by_path(first, fit, setting)
        legs = legs_among(first, left, seen)
        for leg in legs if len(legs) <= _MOST_LEGS else ():
            begun = list(_starts(fit.solution.state, leg, setting, view))
            starts += begun
            # One whose light is another leg's from a mirror in view on is not right by itself.
            starts += [
                replace(turned, parted=one.parted)
                for one in begun
                for next_leg in legs
                for turned in _turned(one.state, one.state.n_legs - 1, next_leg, one.setting, view)
            ]
        starts += [_Start(state, setting) for state in _straight_on(fit.solution.state, seen)]
    found = []
    for start in starts:
        # One told to end on a window's very face has no line of sight: its fit is no number.
        with np.errstate(invalid="ignore"):
            trial = refitted(sightings, start.state, start.setting)
        if not isinstance(trial, NoFit):
            found.append(Armed(trial, start.parted))
    return found


def _straight_on(state: PathState, setting: Setting) -> Iterator[PathState]:
    """Paths with an arm that goes straight on where the path turns, if that is in the picture."""
    for corner in state.corners_seen:
        step = state.steps_mm[corner - 1]
        way = step / np.linalg.norm(step)
        place = state.vertices_mm[corner]
        if not setting.camera.sees(place[np.newaxis])[0]:
            continue
        edge = view_end(setting.camera, place, way)
        if edge is not None:
            yield _with_end(state, corner, edge.position_mm)


def _starts(state: PathState, arm: ImageLeg, setting: Setting, view: int) -> Iterator[_Start]:
    """Paths with an arm wherever its line in one picture meets the path.

    Each with a setting whose waypoints are numbered anew.
    """
    vertices, seen = set(), setting.at(view)
    for leg in state.seen:
        place = _meeting(state, leg, arm, seen)
        if place is None:
            continue
        share, near = place
        vertices |= near
        if not near:
            corner = state.points_mm(leg, np.array([share]))[0]
            longer = _with_arm(state.with_corner(leg, corner), leg + 1, arm, seen)
            if longer is not None:
                yield _Start(longer, setting_with_corner(setting, leg), parted=leg)
        if leg in state.last_legs and state.forks:
            yield from _turned(state, leg, arm, setting, view)
    # Two legs may meet the arm at the vertex that they share; light splits at none of the ends.
    for vertex in sorted(vertices - set(state.ends)):
        longer = _with_arm(state, vertex, arm, seen)
        if longer is not None:
            yield _Start(longer, setting)


def _meeting(
    state: PathState, leg: int, arm: ImageLeg, setting: Setting
) -> tuple[float, set[int]] | None:
    """Share of a leg where an arm's line meets it, and its ends near there; None: it does not."""
    share = np.linspace(0.0, 1.0, _PLACES)
    points = state.points_mm(leg, share)
    places = undistorted_px(setting.camera, *setting.camera.pixels_from_points(points))
    along, across = along_across(places, arm.origin_px, arm.direction_px)
    # Light comes to an arm's start before it runs along it.
    away = np.where(along < arm.extent_px[0] + _REACH_PX, np.abs(across), np.inf)
    if not np.nanmin(away, initial=np.inf) < _REACH_PX:
        return None
    at = int(np.nanargmin(away))
    near = np.hypot(*(places[[0, -1]] - places[at]).T) < _AT_VERTEX_PX
    both = np.array([state.leg_starts[leg], leg + 1])
    return float(share[at]), set(both[near].tolist())


def _with_arm(state: PathState, vertex: int, arm: ImageLeg, setting: Setting) -> PathState | None:
    """The path with an arm from one of its vertices; None where light cannot run so."""
    end = _end_of_arm(state, vertex, arm, setting)
    return None if end is None else _with_end(state, vertex, end)


def _end_of_arm(state: PathState, vertex: int, arm: ImageLeg, setting: Setting) -> Floats | None:
    """(3,), where an arm from a vertex ends, world, mm; None where light cannot run so."""
    place, time = state.vertices_mm[vertex], state.vertex_times_ps(setting.medium)[vertex]
    source = Source(tuple(place.tolist()), emission_time_ps=float(time))
    try:
        alone = state_from_legs((arm,), camera=setting.camera, source=source, medium=setting.medium)
    except GeometryError:
        return None
    end = alone.vertices_mm[-1]
    return end if np.isfinite(end).all() else None


def _turned(
    state: PathState, leg: int, arm: ImageLeg, setting: Setting, view: int
) -> Iterator[_Start]:
    """The path whose last leg on some branch turns into an arm where both meet, if they do.

    Only of one that forks: the legs of a chain are looked for together.
    """
    seen = setting.at(view)
    meeting = _meeting(state, leg, arm, seen)
    if meeting is None:
        return
    cut = state.with_corner(leg, state.points_mm(leg, np.array([meeting[0]]))[0])
    end = _end_of_arm(cut, leg + 1, arm, seen)
    if end is not None:
        vertices = cut.vertices_mm.copy()
        vertices[leg + 2] = end
        yield _Start(replace(cut, vertices_mm=vertices), setting_with_corner(setting, leg))


def _with_end(state: PathState, vertex: int, end_mm: Floats) -> PathState:
    """The path with one leg more, from one of its vertices to a place (3,), mm."""
    return replace(
        state,
        vertices_mm=np.vstack((state.vertices_mm, end_mm)),
        forks=(*state.forks, (state.n_legs, vertex)),
    )
