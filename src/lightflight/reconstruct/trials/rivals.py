"""Paths that may explain a recording as well as the one that was found, each on the same data.

- A leg turned in depth: where light flies slower than it returns, two directions of a leg seem to
  run equally fast, and only the bend of its arrival curve tells which it is.
- One bent leg in place of straight ones that meet at corners which turn by little.
- Two straight legs in place of a bent one.
- The same path by the other of two pulses, where both are about as bright.

A rival is fitted to the very pulses, with the same errors, and the same lines in the picture as the
path, so that the two can be compared.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray
from scipy.special import log_ndtr

from lightflight.errors import GeometryError
from lightflight.flight import twin_from_direction
from lightflight.reconstruct.fit.bent import bent_for_run, runs_of_corners
from lightflight.reconstruct.fit.ends import freedom_at
from lightflight.reconstruct.fit.joint import JointFit
from lightflight.reconstruct.fit.least_squares import fit_path
from lightflight.reconstruct.fit.result import second_pulse_of_fit
from lightflight.reconstruct.fit.start import state_from_legs
from lightflight.reconstruct.legs.find import image_leg
from lightflight.reconstruct.model.freedom import sagitta_std_mm
from lightflight.reconstruct.model.geometry import Indices, PathState
from lightflight.reconstruct.model.image_plane import undistorted_px
from lightflight.reconstruct.model.setting import Setting
from lightflight.reconstruct.trials.marginal import log_evidence
from lightflight.reconstruct.trials.outcome import NoFit, fit_or_reason
from lightflight.reconstruct.trials.revise import refitted

Floats = NDArray[np.float64]

_SLOWER = 0.99
"""Index back over index out from which on no leg is turned: light that seems the fastest would fly
within 8 degrees of the ray to the camera, where a leg is a spot in the picture."""
_ORDERS = (1, 2)
"""Shapes of one bent leg that is tried for straight ones."""
_MOST_SAGITTAE = 4.0
"""Prior standard deviations of a bend beyond which it is not tried: that alone costs e^8."""
_COUNTED = ("no", "one", "two", "three", "four", "five", "six")


@dataclass(frozen=True, eq=False)
class Rival:
    """Another path, and how much likelier than the first the recording is under it.

    Attributes
    ----------
    state : PathState
        Its best fit to the data of the first.
    log_evidence : float
        Natural log of the ratio of evidences.
    says : str
        What is different.
    is_other : Callable[[PathState], bool]
        Whether a path is still this one: a fit may lead back to the first.
    bends_lines : bool
        Whether its legs have other shapes, of which the counts may show kinks.
    """

    state: PathState
    log_evidence: float
    says: str
    is_other: Callable[[PathState], bool]
    bends_lines: bool = True


@dataclass(frozen=True, eq=False)
class _Trial:
    """A path to be tried.

    Attributes
    ----------
    begin : callable
        Gives it, roughly right.
    relabelled : callable
        Legs (n,) of that path from those of the first, which showed at places (n, 2), undistorted
        px, to a camera.
    says, is_other
        As of a `Rival`.
    """

    begin: Callable[[], PathState]
    relabelled: Callable[[PathState, Indices, Floats, int], Indices]
    says: str
    is_other: Callable[[PathState], bool]


def rivals_of(fit: JointFit, setting: Setting) -> Iterator[Rival]:
    """Paths that might explain a recording instead, however well they do.

    Parameters
    ----------
    fit : JointFit
        The path as it was found, of legs one after the other, all of them seen, none in glass.
    setting : Setting
        Camera, source, medium and waypoints.

    Yields
    ------
    Rival
        Where it is another path at its best.
    """
    state = fit.solution.state
    if state.forks or state.unseen or setting.medium.blocks:
        return
    trials = [*_turned_legs(fit, setting), *_bent_runs(state, setting), *_cornered(fit, setting)]
    if not trials:
        return
    own = fit_or_reason(partial(_best, fit, state, fit.times.leg, fit.lines.leg, setting))
    if isinstance(own, NoFit):
        return
    for trial in trials:
        found = fit_or_reason(partial(_fitted, fit, trial, setting))
        if not isinstance(found, NoFit) and trial.is_other(found[0]):
            more = found[1] - own[1]
            yield Rival(found[0], more, trial.says, trial.is_other)


def by_other_pulse(fit: JointFit, setting: Setting) -> Iterator[Rival]:
    """The path of the other of two pulses, where the user does not tell when the first set out.

    The brighter one is the path's: which that is, the share and its error tell.

    Parameters
    ----------
    fit : JointFit
        The path as it was found.
    setting : Setting
        Camera, source, medium and waypoints.

    Yields
    ------
    Rival
        The same path, as much earlier or later as the pulses are apart.
    """
    second = second_pulse_of_fit(fit)
    if second is None or setting.source.emission_time_ps is not None:
        return
    state, delay = fit.solution.state, second.delay_ps
    brighter = (second.share - 1.0) / max(second.share_std, 1e-9)
    yield Rival(
        replace(state, start_time_ps=state.start_time_ps + delay),
        float(log_ndtr(brighter) - log_ndtr(-brighter)),
        f"the other of two pulses, {abs(delay):.0f} ps {'later' if delay > 0.0 else 'earlier'}",
        partial(_is_nearer, state.start_time_ps + delay, 0.5 * abs(delay)),
        bends_lines=False,
    )


def _is_nearer(start_ps: float, within_ps: float, state: PathState) -> bool:
    return abs(state.start_time_ps - start_ps) < within_ps


def _fitted(fit: JointFit, trial: _Trial, setting: Setting) -> tuple[PathState, float]:
    """Best fit of a trial to the data of a path, and its log evidence."""
    state, times, lines = trial.begin(), fit.times, fit.lines
    of_times, of_lines = times.leg.copy(), lines.leg.copy()
    for view, camera in enumerate(setting.cameras):
        here = np.flatnonzero(times.view == view)
        places = undistorted_px(camera, times.row[here], times.col[here])
        of_times[here] = trial.relabelled(state, times.leg[here], places, view)
        here = np.flatnonzero(lines.view == view)
        of_lines[here] = trial.relabelled(state, lines.leg[here], lines.anchors[here], view)
    return _best(fit, state, of_times, of_lines, setting)


def _best(
    fit: JointFit, state: PathState, of_times: Indices, of_lines: Indices, setting: Setting
) -> tuple[PathState, float]:
    """Best fit to the data of a path, whose legs are these, and its log evidence."""
    freedom = freedom_at(state, setting)
    solution = fit_path(
        state,
        replace(fit.times, leg=of_times),
        replace(fit.lines, leg=of_lines),
        freedom,
        setting,
        floor_var=fit.floor_ps**2,
    )
    return solution.state, log_evidence(solution, freedom)


def _turned_legs(fit: JointFit, setting: Setting) -> Iterator[_Trial]:
    """Each straight leg in the other direction that seems as fast."""
    medium, state = setting.medium, fit.solution.state
    if state.bends or medium.return_group_index > _SLOWER * medium.path_group_index:
        return
    for leg in range(state.n_legs):
        yield _Trial(
            partial(_turned, fit, leg, setting),
            lambda _, legs, *__: legs,
            f"leg {leg + 1} turned in depth",
            partial(_is_turned, leg, _is_steep(state, leg, setting), setting),
        )


def _is_turned(leg: int, was_steep: bool, setting: Setting, state: PathState) -> bool:
    return _is_steep(state, leg, setting) is not was_steep


def _is_steep(state: PathState, leg: int, setting: Setting) -> bool:
    """Whether a leg flies nearer towards the camera than light that seems the fastest."""
    direction, towards = _half_way(state, leg, setting)
    medium = setting.medium
    return bool(medium.path_group_index * (direction @ towards) > medium.return_group_index)


def _half_way(state: PathState, leg: int, setting: Setting) -> tuple[Floats, Floats]:
    """Unit directions (3,) of flight and back to the camera, half-way along a leg; world."""
    middle = state.points_mm(leg, np.array([0.5]))[0]
    step = state.steps_mm[leg]
    return step / np.linalg.norm(step), -setting.camera.sight_directions(middle)


def _turned(fit: JointFit, leg: int, setting: Setting) -> PathState:
    """The path from its legs as the picture shows them, one of them turned in depth."""
    first, times, state = fit.sightings[0], fit.times, fit.solution.state
    mine = (times.weight > 0) & (fit.sighting_of == 0)
    # In one piece, as the fit has them: a flight may run over the end of the laser's period.
    arrivals = replace(first.arrivals, arrival_ps=first.arrival_ps)
    legs = tuple(
        image_leg(arrivals, times.index[mine & (times.leg == k)], setting.camera)
        for k in range(state.n_legs)
    )
    twin = twin_from_direction(*_half_way(state, leg, setting), medium=setting.medium)
    return state_from_legs(
        legs, camera=setting.camera, source=setting.source, medium=setting.medium, told=(leg, twin)
    )


def _bent_runs(state: PathState, setting: Setting) -> Iterator[_Trial]:
    """One bent leg for each run of straight legs that turn by little."""
    # Waypoints number vertices: with legs joined, others would bear the numbers.
    if state.bends or setting.told_vertices:
        return
    for corners in runs_of_corners(state):
        for orders in _ORDERS:
            bent = bent_for_run(state, corners, orders, setting.camera)
            sizes = np.linalg.norm(bent.bends[0].coefficients_mm, axis=0)
            usual = [sagitta_std_mm(order + 1) for order in range(orders)]
            if (sizes > _MOST_SAGITTAE * np.array(usual)).any():
                continue
            yield _Trial(
                partial(_as_it_is, bent),
                partial(_joined, corners),
                f"one bent leg instead of {_counted(len(corners) + 1)} straight ones",
                lambda one: bool(one.bends),
            )


def _counted(n: int) -> str:
    return _COUNTED[n] if n < len(_COUNTED) else str(n)


def _as_it_is(state: PathState) -> PathState:
    return state


def _joined(corners: tuple[int, ...], _: PathState, legs: Indices, *__: object) -> Indices:
    """Numbers of legs once corners are gone."""
    numbers: Indices = legs - np.sum([legs >= corner for corner in corners], axis=0)
    return numbers


def _cornered(fit: JointFit, setting: Setting) -> Iterator[_Trial]:
    """Two straight legs for each bent one."""
    if setting.told_vertices:
        return
    bends = fit.solution.state.bends
    for bend in bends:
        yield _Trial(
            partial(_with_corner, fit, bend.leg, setting),
            partial(_parted, bend.leg, setting),
            "two straight legs instead of a bent one",
            lambda one: len(one.bends) < len(bends),
        )


def _with_corner(fit: JointFit, leg: int, setting: Setting) -> PathState:
    """The path with two straight legs for a bent one, where the recording has its corner."""
    state = fit.solution.state
    corner = state.points_mm(leg, np.array([0.5]))[0]
    # Fitted anew: pulses know their leg only once the corner is known.
    found = refitted(list(fit.sightings), state.with_corner(leg, corner), setting)
    if isinstance(found, NoFit):
        raise GeometryError("no two straight legs follow this one")
    return found.solution.state


def _parted(
    leg: int, setting: Setting, state: PathState, legs: Indices, places: Floats, view: int
) -> Indices:
    """Numbers of legs with a corner more, at the end of one: places beyond it are of the next."""
    camera = setting.cameras[view]
    corner = state.vertices_mm[leg + 1]
    ahead = corner + 1e-3 * (state.vertices_mm[leg + 2] - state.vertices_mm[leg])
    seen, along = undistorted_px(camera, *camera.pixels_from_points(np.stack((corner, ahead))))
    beyond = (places - seen) @ (along - seen) > 0.0
    numbers: Indices = legs + ((legs > leg) | ((legs == leg) & beyond))
    return numbers
