"""Glass in the beam that nobody told: light late from some place of its way on, or put aside.

A block slows the light to its group index. Behind it everything comes later by one time, ahead of
it nothing does; no corner, clock or index does that. Where along the way is looked for, so the test
is silent until the best of all places would be chance in fewer than one recording of a million.
Where glass stands askew light comes out of it aside, which two corners can be found for.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np
from numpy.typing import NDArray

from lightflight.path.light_path import LightPath
from lightflight.path.tree import starts_of
from lightflight.path.verdict import Finding, FindingName, noted
from lightflight.reconstruct.model.sizes import PLAUSIBLE
from lightflight.reconstruct.verdict.candidates import Candidate, Rows
from lightflight.reconstruct.verdict.places import best_place, evenly_many
from lightflight.units import SPEED_OF_LIGHT_MM_PER_PS
from lightflight.vectors import unit

Floats = NDArray[np.float64]

_THICKNESS_MM = 20.0
"""Way over which the light falls behind, mm: that of a usual block, two pixels of the paper's."""
_PARALLEL = 0.1
"""Of the angle by which a leg turns: so far from parallel the fit may draw the legs about it, for
the delay of glass is more than that of the way which it takes for it."""
_PARALLEL_CHI2 = 9.0
"""Of two numbers: legs before and behind glass differ by more in one recording of a hundred."""
_SURELY_PARALLEL = 0.2
"""Of that angle: how well it must be known that those two are parallel."""
_MOST_TURN_DEG = 30.0
"""Light that enters glass turns by less, deg: at 60 degrees of incidence by 25."""
_MORE_INDEX = 0.53
"""Group index of crown glass at 532 nm beyond that of air: by it a time is told in mm of glass."""


def block_candidate(
    rows: Rows, residual: Floats, left_of: Callable[[Floats], Floats]
) -> Candidate | None:
    """Light that is late from the place on where that explains most.

    Parameters
    ----------
    rows : Rows
        The model.
    residual : array of float, shape (N,)
        Whitened.
    left_of : callable
        What the fit cannot take up of columns (N, k).

    Returns
    -------
    Candidate or None
        None where light is nowhere late, or a path has arms, whose ways are several.
    """
    if rows.state.forks:
        return None
    out_mm, nothing = rows.traced.out_mm, np.zeros(len(rows.lines.leg))
    places = np.concatenate([_places(out_mm[rows.times.leg == leg]) for leg in rows.state.seen])
    if not len(places):
        return None
    size = PLAUSIBLE["block"].size
    columns = np.column_stack(
        [
            size * rows.whole(np.clip((out_mm - place) / _THICKNESS_MM, 0.0, 1.0), nothing)
            for place in places
        ]
    )
    best = best_place(left_of(columns), residual, late_only=True)
    if best is None:
        return None
    return Candidate(
        FindingName.BLOCK,
        columns[:, best : best + 1],
        (PLAUSIBLE["block"],),
        says=partial(_sentence, rows, float(places[best])),
        looked_for=2.0 * float(np.log(len(places))),
    )


def _places(out_mm: Floats) -> Floats:
    """Where light may enter glass on a leg: ways to some of its pulses, mm, but the outermost."""
    return evenly_many(np.unique(np.round(out_mm, 1))[1:-1])


def _sentence(rows: Rows, place_mm: float, sizes: Floats) -> str:
    nearest = int(np.argmin(np.abs(rows.traced.out_mm - place_mm)))
    leg = rows.times.leg[nearest : nearest + 1]
    point = rows.state.points_mm(leg, rows.traced.fraction[nearest : nearest + 1])[0]
    where = ", ".join(f"{x:.0f}" for x in point)
    late_ps = float(sizes[0]) * PLAUSIBLE["block"].size
    glass_mm = late_ps * SPEED_OF_LIGHT_MM_PER_PS / _MORE_INDEX
    return (
        f"light is {late_ps:.2g} ps late from about ({where}) mm on, as behind {glass_mm:.2g} mm "
        "of glass in the beam"
    )


def findings_of_slabs(path: LightPath) -> tuple[Finding, ...]:
    """That legs may be light in glass; () where none is like it.

    Parameters
    ----------
    path : LightPath
        Its number of legs was not told.

    Returns
    -------
    tuple of Finding
        One for each such leg.
    """
    return tuple(
        noted(
            FindingName.BLOCK,
            f"leg {leg + 1} turns by {turn_deg:.2g}° and light behind it flies on as before it: a "
            "plate or block of glass in the beam that was not told does that",
            "tell where it stands and what it is of ([block]), or how many legs there are (n_legs, "
            "--n-legs)",
        )
        for leg, turn_deg in legs_that_may_be_glass(path)
    )


def legs_that_may_be_glass(path: LightPath) -> list[tuple[int, float]]:
    """Legs which turn by little, and light goes on after them as it came: number, angle in deg.

    A slab puts light aside and makes it late; behind it light flies parallel to how it came.
    """
    found, starts = [], starts_of(path)
    for leg in sorted(legs_between_corners(path)):
        before, vertices = starts[leg] - 1, path.vertices_mm
        after = next(k for k in range(path.n_legs) if starts[k] == leg + 1)
        pieces = [(starts[k], k + 1) for k in (before, leg, after)]
        came, turned, goes_on = (unit(vertices[end] - vertices[start]) for start, end in pieces)
        turn_deg = float(np.degrees(np.arccos(np.clip(came @ turned, -1.0, 1.0))))
        # Across the flight: along it directions do not differ to first order.
        across = np.linalg.svd(came[np.newaxis])[2][1:]
        slopes = np.zeros((2, 3 * len(vertices)))
        for (start, end), sign in ((pieces[0], -1.0), (pieces[2], 1.0)):
            by_end = sign * across / np.linalg.norm(vertices[end] - vertices[start])
            slopes[:, 3 * end : 3 * end + 3] += by_end
            slopes[:, 3 * start : 3 * start + 3] -= by_end
        places = np.flatnonzero(np.arange(len(path.covariance)) % 4 != 3)
        covariance = slopes @ path.covariance[np.ix_(places, places)] @ slopes.T
        # What is known of the two to no better than the turn itself says nothing.
        turn = np.radians(turn_deg)
        known = float(np.trace(covariance)) < (_SURELY_PARALLEL * turn) ** 2
        off = across @ (goes_on - came)
        allowed = covariance + (_PARALLEL * turn) ** 2 * np.eye(2)
        parallel = float(off @ np.linalg.solve(allowed, off)) < _PARALLEL_CHI2
        if turn_deg < _MOST_TURN_DEG and known and parallel:
            found.append((leg, turn_deg))
    return found


def legs_between_corners(path: LightPath) -> set[int]:
    """Legs whose two ends are corners, that nobody told to be glass."""
    starts = starts_of(path)
    no_corners = {*path.ends, *path.open_vertices}
    straight = set(range(path.n_legs)) - {*path.unseen_legs, *path.legs_in_glass}
    return {leg for leg in straight if not {starts[leg], leg + 1} & no_corners}
