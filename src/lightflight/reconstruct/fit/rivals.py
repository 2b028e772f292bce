"""Paths that may explain a recording as well as the one that was found, each on the same data.

- A leg turned in depth: where light flies slower than it returns, two directions of a leg seem to
  run equally fast, and only the bend of its arrival curve tells which it is.
- One bent leg in place of straight ones that meet at corners which turn by little.

A rival is fitted to the very pulses, with the same errors, and the same lines in the picture as the
path, so that the two can be compared.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from lightflight.flight import twin_from_direction
from lightflight.reconstruct.fit.bent import bent_for_run, runs_of_corners
from lightflight.reconstruct.fit.ends import freedom_at
from lightflight.reconstruct.fit.joint import JointFit
from lightflight.reconstruct.fit.least_squares import Solution, fit_path
from lightflight.reconstruct.fit.marginal import log_evidence
from lightflight.reconstruct.fit.outcome import NoFit, fit_or_reason
from lightflight.reconstruct.fit.start import state_from_legs
from lightflight.reconstruct.legs.find import image_leg
from lightflight.reconstruct.model.freedom import sagitta_std_mm
from lightflight.reconstruct.model.geometry import PathState
from lightflight.reconstruct.model.setting import Setting

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
    remedy : str
        What would tell the two apart.
    is_other : Callable[[PathState], bool]
        Whether a path is still this one: a fit may lead back to the first.
    """

    state: PathState
    log_evidence: float
    says: str
    remedy: str
    is_other: Callable[[PathState], bool]


def rivals_of(fit: JointFit, setting: Setting) -> Iterator[Rival]:
    """Paths that might explain a recording instead, however well they do.

    Parameters
    ----------
    fit : JointFit
        The path as it was found, of straight legs one after the other.
    setting : Setting
        Camera, source, medium and waypoints.

    Yields
    ------
    Rival
        Where it is another path at its best.
    """
    state = fit.solution.state
    if state.forks or state.unseen or state.bends:
        return
    tried = [*_turned_legs(fit, setting), *_bent_runs(state, setting)]
    if not tried:
        return
    own = _log_evidence_of(fit, state, (), setting)
    if isinstance(own, NoFit):
        return
    for begin, corners, says, remedy, is_other in tried:
        begun = fit_or_reason(begin)
        if isinstance(begun, NoFit):
            continue
        found = _log_evidence_of(fit, begun, corners, setting)
        if not isinstance(found, NoFit) and is_other(found[0]):
            yield Rival(found[0], found[1] - own[1], says, remedy, is_other)


_Tried = tuple[Callable[[], PathState], tuple[int, ...], str, str, Callable[[PathState], bool]]
"""Where it begins, corners of the first path that it has not, words, remedy, and whether it is."""


def _turned_legs(fit: JointFit, setting: Setting) -> Iterator[_Tried]:
    """Each leg in the other direction that seems as fast."""
    medium, state = setting.medium, fit.solution.state
    if medium.return_group_index > _SLOWER * medium.path_group_index:
        return
    for leg in range(state.n_legs):
        was_steep = _is_steep(state, leg, setting)
        yield (
            partial(_turned, fit, leg, setting),
            (),
            f"leg {leg + 1} turned in depth",
            "tell when the pulse set out, or where a place of this leg is (waypoints)",
            partial(_is_turned, leg, was_steep, setting),
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
    legs = tuple(
        image_leg(first.arrivals, times.index[mine & (times.leg == k)], setting.camera)
        for k in range(state.n_legs)
    )
    twin = twin_from_direction(*_half_way(state, leg, setting), medium=setting.medium)
    return state_from_legs(
        legs, camera=setting.camera, source=setting.source, medium=setting.medium, told=(leg, twin)
    )


def _bent_runs(state: PathState, setting: Setting) -> Iterator[_Tried]:
    """One bent leg for each run of legs that turn by little."""
    # Waypoints number vertices: with legs joined, others would bear the numbers.
    if setting.waypoints:
        return
    for corners in runs_of_corners(state):
        for orders in _ORDERS:
            bent = bent_for_run(state, corners, orders, setting.camera)
            sizes = np.linalg.norm(bent.bends[0].coefficients_mm, axis=0)
            if (sizes > _MOST_SAGITTAE * _sagittae_mm(orders)).any():
                continue
            n_legs = _COUNTED[len(corners) + 1] if len(corners) < 6 else str(len(corners) + 1)
            yield (
                partial(_as_it_is, bent),
                corners,
                f"one bent leg instead of {n_legs} straight ones",
                "tell how many legs there are (n_legs, --n-legs), or that legs may bend (free, "
                "--free bend)",
                lambda found: bool(found.bends),
            )


def _as_it_is(state: PathState) -> PathState:
    return state


def _sagittae_mm(orders: int) -> Floats:
    """(orders,), prior standard deviations of the shapes of a bend, mm."""
    return np.array([sagitta_std_mm(order + 1) for order in range(orders)])


def _log_evidence_of(
    fit: JointFit, state: PathState, corners: tuple[int, ...], setting: Setting
) -> tuple[PathState, float] | NoFit:
    """Best fit of a path to the data of another, and its log evidence.

    `corners` of the other are not in it: pulses and lines of the legs that meet there are of one.
    """

    def joined(legs: NDArray[np.int64]) -> NDArray[np.int64]:
        return legs - np.sum([legs >= corner for corner in corners], axis=0, dtype=np.int64)

    def solved() -> tuple[PathState, float]:
        freedom = freedom_at(state, setting)
        solution: Solution = fit_path(
            state,
            replace(fit.times, leg=joined(fit.times.leg)),
            replace(fit.lines, leg=joined(fit.lines.leg)),
            freedom,
            cameras=setting.cameras,
            medium=setting.medium,
            floor_var=fit.floor_ps**2,
        )
        return solution.state, log_evidence(solution, freedom)

    return fit_or_reason(solved)
