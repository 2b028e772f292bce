"""What is told of single vertices and legs: mirrors measured with a ruler, a fibre of known length.

Users count vertices and legs as they know them; where a search parts a leg, or joins two, what was
told goes along.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from lightflight.arguments import POSITIVE, finite_number, finite_numbers, shown
from lightflight.reconstruct.model.state import PathState

Floats = NDArray[np.float64]

Waypoint = tuple[int, ArrayLike, float]
"""(vertex index, position_mm (3,), one-sigma error in mm): a mirror measured with a ruler."""


def checked_waypoints(waypoints: Sequence[Waypoint], n_legs: int | None) -> tuple[Waypoint, ...]:
    """Waypoints as plain numbers.

    Parameters
    ----------
    waypoints : sequence of (int, array_like, float)
        (vertex index, position_mm, std_mm) each.
    n_legs : int or None
        How many legs there are, where the user knows it; None: as many as the data show.

    Returns
    -------
    tuple of (int, array_like, float)
        Indices whole, positions (3,) arrays.

    Raises
    ------
    ValueError
        For a vertex that no path can have, or a position or error that makes no sense.
    """
    checked: list[Waypoint] = []
    given: object = waypoints
    try:
        listed = None if isinstance(given, str) else list(waypoints)
    except TypeError:
        listed = None
    if listed is None:
        raise ValueError(
            "waypoints must be a list of (vertex index, position_mm, std_mm), got "
            f"{shown(waypoints)}"
        )
    for waypoint in listed:
        vertex, index, position_mm, std_mm = _numbered(
            waypoint, "a waypoint must be (vertex index, position_mm, std_mm)"
        )
        if index != vertex or index < 1 or (n_legs is not None and index > n_legs):
            last = "" if n_legs is None else f" to {n_legs}"
            raise ValueError(
                f"waypoint of vertex {vertex}: give a corner or the end, 1{last} (vertex 0 is the "
                "source: give its position_mm and position_std_mm)"
            )
        name, must = f"waypoint of vertex {index}: position_mm", "be three finite numbers"
        position = finite_numbers(name, position_mm, must, shapes=[(3,)])
        name, must = f"waypoint of vertex {index}: std_mm", "be positive and finite"
        std = finite_number(name, std_mm, must, low=POSITIVE)
        checked.append((index, position, std))
    return tuple(checked)


def _numbered(row: Any, must: str) -> tuple[Any, int, Any, Any]:
    """The number that a row of three begins with, the same whole, and the other two, as given."""
    try:
        number, value, std = row
        return number, int(number), value, std
    except (TypeError, ValueError, OverflowError) as problem:
        raise ValueError(f"{must}, got {shown(row)}") from problem


class ToldLength(NamedTuple):
    """Way of the light along one leg."""

    leg: int
    """Counted as told, from 0."""
    length_mm: float
    std_mm: float
    """One-sigma error, mm."""


class ToldRow(NamedTuple):
    """One prior of a path that a waypoint or a length is."""

    words: str
    """What is told, for messages."""
    row: int
    """Its number among the priors."""
    std_mm: float


def checked_lengths(lengths: object, n_legs: int | None) -> tuple[ToldLength, ...]:
    """Told lengths of legs.

    Parameters
    ----------
    lengths : object
        As given: a list of (leg, length_mm, std_mm), legs counted from 0.
    n_legs : int or None
        How many legs there are, where the user knows it; None: as many as the data show.

    Returns
    -------
    tuple of ToldLength
        One for each.

    Raises
    ------
    ValueError
        For a leg that no path can have or that is told twice, or a length or error that makes no
        sense.
    """
    if not isinstance(lengths, list | tuple):
        raise ValueError(
            f"lengths must be a list of (leg, length_mm, std_mm), got {shown(lengths)}"
        )
    found: list[ToldLength] = []
    for each in lengths:
        leg, number, length_mm, std_mm = _numbered(
            each, "a length must be (leg, length_mm, std_mm)"
        )
        if number != leg or number < 0 or (n_legs is not None and number >= n_legs):
            last = "" if n_legs is None else f" to {n_legs - 1}"
            raise ValueError(f"length of leg {leg}: give a leg from 0{last}")
        if number in {one.leg for one in found}:
            raise ValueError(f"length of leg {number}: it is told twice")
        must = "be positive and finite, in mm"
        length, std = (
            finite_number(f"length of leg {number}: {name}", told, must, low=POSITIVE)
            for name, told in (("length_mm", length_mm), ("std_mm", std_mm))
        )
        found.append(ToldLength(number, length, std))
    return tuple(found)


def pieces_of(state: PathState, told: ToldLength) -> list[int]:
    """The pieces of a path that a told length is of: more than one where a leg crosses glass."""
    return [k for k in range(state.n_legs) if state.as_told(k) == told.leg]


def refuse_unmeasured(state: PathState, told: ToldLength, loose: Collection[int]) -> None:
    """Refuse the length of a leg that is not there, or one of whose ends nothing shows.

    Parameters
    ----------
    state : PathState
        The path.
    told : ToldLength
        Of one of its legs.
    loose : collection of int
        Vertices where the path only enters or leaves the picture.

    Raises
    ------
    ValueError
        With what to do.
    """
    if told.leg >= state.n_told:
        raise ValueError(
            f"length of leg {told.leg}, but the path found has legs 0 to {state.n_told - 1}: "
            "give n_legs, or leave the length out"
        )
    pieces = pieces_of(state, told)
    if {int(state.leg_starts[pieces[0]]), pieces[-1] + 1} & set(loose):
        raise ValueError(
            f"length of leg {told.leg}: the picture's edge cuts that leg, so nothing shows where "
            "it ends; leave its length out"
        )


def way_along(state: PathState, legs: Sequence[int]) -> tuple[float, Floats]:
    """Way of the light along legs, mm, and its derivatives by the state.

    Parameters
    ----------
    state : PathState
        The path; its legs may be bent.
    legs : sequence of int
        Which of them.

    Returns
    -------
    way_mm : float
    by_state : array of float, shape (size,)
        mm per mm; 0 for the start time.
    """
    by_state = np.zeros(state.size)
    bent = {course.leg: (course, own) for course, own in state.courses}
    for leg in legs:
        if leg in bent:
            course, own = bent[leg]
            _, by_step, by_bend = course.ways_and_slopes(np.ones(1))
            unit, by_state[own] = by_step[0], by_bend[0]
        else:
            unit = state.steps_mm[leg] / state.lengths_mm[leg]
        start, end = 3 * int(state.leg_starts[leg]), 3 * (leg + 1)
        by_state[start : start + 3] -= unit
        by_state[end : end + 3] += unit
    return float(state.lengths_mm[list(legs)].sum()), by_state


def statements_of_lengths(lengths: Sequence[ToldLength]) -> tuple[str, ...]:
    """Which legs' lengths were told, one sentence each."""
    return tuple(
        f"Leg {one.leg + 1} was told to be {one.length_mm:.6g} ± {one.std_mm:.2g} mm long."
        for one in lengths
    )
