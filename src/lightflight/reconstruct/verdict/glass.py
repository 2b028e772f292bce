"""Glass in the beam that nobody told: light that is late from some place of its way on.

A block slows the light to its group index. Behind it everything comes later by one time, ahead of
it nothing does; no corner, clock or index does that. Where along the way is looked for, so the test
is silent until the best of all places would be chance in fewer than one recording of a million.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np
from numpy.typing import NDArray

from lightflight.path.verdict import FindingName
from lightflight.reconstruct.model.sizes import PLAUSIBLE
from lightflight.reconstruct.verdict.candidates import Candidate, Rows
from lightflight.reconstruct.verdict.places import best_place, evenly_many
from lightflight.units import SPEED_OF_LIGHT_MM_PER_PS

Floats = NDArray[np.float64]

_THICKNESS_MM = 20.0
"""Way over which the light falls behind, mm: that of a usual block, two pixels of the paper's."""
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
