"""Paths that fork, as light does at a beam splitter: which leg follows which, and its branches.

Every leg k ends at vertex k + 1. In a chain it begins where the leg before ends, at vertex k; a
fork (leg, vertex) says that it begins at an earlier vertex instead. One clock runs over all legs.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from lightflight.path.glass import glass_of, on_faces
from lightflight.path.tables import Polyline

if TYPE_CHECKING:
    from lightflight.path.light_path import LightPath

Forks = tuple[tuple[int, int], ...]
Indices = NDArray[np.int64]


def checked_forks(forks: object, n_legs: int) -> Forks:
    """Forks (leg, vertex), ascending by leg.

    Parameters
    ----------
    forks : object
        As given.
    n_legs : int
        Of the whole path.

    Returns
    -------
    tuple of (int, int)

    Raises
    ------
    ValueError
        Unless each names another leg, which begins at a vertex where an earlier leg ends and that
        is not the end of the very leg before.
    """
    try:
        pairs = tuple((leg, vertex) for leg, vertex in forks)  # type: ignore[attr-defined]
        # Whole numbers only: what is cut to one would hang an arm on another vertex.
        whole = all(int(x) == x and not isinstance(x, bool) for pair in pairs for x in pair)
        found = tuple(sorted((int(leg), int(vertex)) for leg, vertex in pairs))
    except (TypeError, ValueError, OverflowError):
        whole, found = False, ()
    once = len({leg for leg, _ in found}) == len(found)
    # Light comes from before: with vertices below the leg's own number there is no way in a ring.
    if not (whole and once and all(0 < vertex < leg < n_legs for leg, vertex in found)):
        raise ValueError(
            "forks must be pairs (leg, vertex): each another of the legs 2 to "
            f"{n_legs - 1}, and a vertex from 1 to below the leg's number, at which it begins; "
            f"got {forks!r:.200}"
        )
    return found


def forks_of(path: Polyline) -> Forks:
    """Forks of a path; () of a chain, and of a truth that knows of none.

    Parameters
    ----------
    path : LightPath or truth
        The path.

    Raises
    ------
    ValueError
        As `checked_forks`: a truth may come from any file.
    """
    forks = getattr(path, "forks", ())
    return checked_forks(forks, n_legs_of(path)) if len(forks) else ()


def n_legs_of(path: Polyline) -> int:
    """Number of legs of a path, on all its branches.

    Parameters
    ----------
    path : LightPath or truth
        The path.
    """
    return max(len(np.atleast_1d(np.asarray(path.vertex_times_ps))) - 1, 0)


def leg_starts(n_legs: int, forks: Forks) -> Indices:
    """The vertex at which each leg begins.

    Parameters
    ----------
    n_legs : int
        Of the whole path.
    forks : tuple of (int, int)
        Legs that begin at another vertex than the end of the leg before.

    Returns
    -------
    array of int, shape (n_legs,)
        Leg k ends at vertex k + 1.
    """
    starts = np.arange(n_legs)
    for leg, vertex in forks:
        starts[leg] = vertex
    return starts


def starts_of(path: Polyline) -> Indices:
    """(n_legs,), the vertex at which each leg of a path begins.

    Parameters
    ----------
    path : LightPath or truth
        The path.
    """
    return leg_starts(n_legs_of(path), forks_of(path))


def last_legs(starts: Indices) -> tuple[int, ...]:
    """Legs that nothing follows, ascending: the last one, and the end of every other branch.

    Parameters
    ----------
    starts : array of int, shape (n_legs,)
        The vertex at which each leg begins.
    """
    begun = set(starts.tolist())
    return tuple(k for k in range(len(starts)) if k + 1 not in begun)


def ways(starts: Indices) -> tuple[tuple[int, ...], ...]:
    """The legs of each branch, from vertex 0 to its end.

    Parameters
    ----------
    starts : array of int, shape (n_legs,)
        The vertex at which each leg begins.

    Returns
    -------
    tuple of tuple of int
        In the order of `last_legs`: one for each end of the light.
    """
    found = []
    for leg in last_legs(starts):
        way = [leg]
        while starts[way[0]] > 0:
            # The leg before is the one that ends at this vertex.
            way.insert(0, int(starts[way[0]]) - 1)
        found.append(tuple(way))
    return tuple(found)


def legs_alight(
    starts: Indices, vertex_times_ps: NDArray[np.float64], event_times_ps: NDArray[np.float64]
) -> Indices:
    """The one leg of a path that forks on which its light is at each event time.

    Parameters
    ----------
    starts : array of int, shape (n_legs,)
        The vertex at which each leg begins.
    vertex_times_ps : array of float, shape (n_legs + 1,)
        ps.
    event_times_ps : array of float, shape (n,)
        ps.

    Returns
    -------
    array of int, shape (n,)
        The first before the path, the one that ends last after it; at the very moment of a fork,
        where all its legs are at one place, the first of them.

    Raises
    ------
    ValueError
        Where light is on several legs at once.
    """
    begun, ended = vertex_times_ps[starts], vertex_times_ps[1:]
    when = event_times_ps[:, np.newaxis]
    ends = np.isin(np.arange(len(starts)), last_legs(starts))
    alight = (begun <= when) & ((when < ended) | ((when == ended) & ends))
    first = np.argmax(alight, axis=1)
    at_fork = (begun == when) & (starts == starts[first][:, np.newaxis])
    several = np.flatnonzero((alight.sum(axis=1) > 1) & (alight & ~at_fork).any(axis=1))
    if len(several):
        raise ValueError(
            f"at {event_times_ps[several[0]]:.6g} ps light is on several legs at once: say on "
            f"which way, branch=0 to {ends.sum() - 1} (path.branches)"
        )
    after = ~alight.any(axis=1) & ~(event_times_ps < vertex_times_ps[0])
    return np.where(after, int(np.argmax(ended)), first)


def way_before(starts: Indices, lengths_mm: NDArray[np.float64]) -> NDArray[np.float64]:
    """Way of the light from vertex 0 to each vertex.

    Parameters
    ----------
    starts : array of int, shape (n_legs,)
        The vertex at which each leg begins.
    lengths_mm : array of float, shape (n_legs,)
        Of each leg, mm.

    Returns
    -------
    array of float, shape (n_legs + 1,)
        mm.
    """
    # One after the other, so that a chain's ways are the same to the last bit.
    if (starts == np.arange(len(starts))).all():
        return np.concatenate(([0.0], np.cumsum(lengths_mm)))
    way = np.zeros(len(starts) + 1)
    for leg, start in enumerate(starts):
        way[leg + 1] = way[start] + lengths_mm[leg]
    return way


def outline_mm(path: Polyline) -> NDArray[np.float64]:
    """The path as one line through its vertices, to be drawn: a row of NaN where a leg forks off.

    Parameters
    ----------
    path : LightPath or truth
        The path.

    Returns
    -------
    array of float, shape (k, 3)
        World, mm; of a chain its vertices.
    """
    vertices = np.asarray(path.vertices_mm, dtype=float).reshape(-1, 3)
    rows: list[NDArray[np.float64]] = [vertices[:1]]
    for leg, start in enumerate(starts_of(path)):
        if start != leg:
            rows += [np.full((1, 3), np.nan), vertices[start : start + 1]]
        rows.append(vertices[leg + 1 : leg + 2])
    return np.concatenate(rows)


def corners_of(
    path: Polyline,
) -> tuple[tuple[int, NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]], ...]:
    """Mirrors and splitters, each with the places before and after it, to be drawn.

    Parameters
    ----------
    path : LightPath or truth
        The path.

    Returns
    -------
    tuple of (int, array of float, array of float, array of float)
        Number of the vertex; (3,) where light comes from, the vertex, and where it goes, mm: at a
        fork by the leg that turns most.
    """
    vertices = np.asarray(path.vertices_mm, dtype=float).reshape(-1, 3)
    starts, found = starts_of(path), []
    medium = getattr(path, "medium", None)
    straight = on_faces(glass_of(vertices, medium.blocks)) if medium is not None else ()
    for corner in range(1, len(vertices)):
        after = np.flatnonzero(starts == corner)
        if not len(after) or corner in straight:
            continue
        before = vertices[starts[corner - 1]]
        way = vertices[corner] - before
        steps = vertices[after + 1] - vertices[corner]
        on = steps @ way / np.linalg.norm(steps, axis=1)
        found.append((corner, before, vertices[corner], vertices[after[np.argmin(on)] + 1]))
    return tuple(found)


def branches_of(path: LightPath) -> tuple[LightPath, ...]:
    """Each way of the light from vertex 0 to an end, as a chain of its own.

    Parameters
    ----------
    path : LightPath
        A path.

    Returns
    -------
    tuple of LightPath
        In the order of their last legs; `(path,)` where nothing forks.
    """
    if not path.forks:
        return (path,)
    return tuple(_branch(path, way) for way in ways(starts_of(path)))


def _branch(path: LightPath, way: tuple[int, ...]) -> LightPath:
    """The chain of these legs: their vertices, their blocks of the covariance, their pulses."""
    vertices = [0, *(leg + 1 for leg in way)]
    rows = np.ravel([np.arange(4 * k, 4 * k + 4) for k in vertices])
    block = np.ix_(rows, rows)
    own = np.isin(path.residuals["leg"], way)
    residuals = path.residuals[own].copy()
    residuals["leg"] = np.searchsorted(way, residuals["leg"])
    return replace(
        path,
        vertices_mm=path.vertices_mm[vertices],
        vertex_times_ps=path.vertex_times_ps[vertices],
        covariance=path.covariance[block],
        covariance_parts={name: part[block] for name, part in path.covariance_parts.items()},
        residuals=residuals,
        unseen_legs=tuple(way.index(leg) for leg in path.unseen_legs if leg in way),
        forks=(),
    )
