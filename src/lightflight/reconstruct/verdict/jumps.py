"""Clocks that jump: from one row, column or count on, all times are off by one time.

Halves of an array that are read out by themselves, a buffer between two rows, a stage of a delay
line that is longer than the others: no slow change across the picture or over the codes makes a
step. Where it is, is looked for, so the test is silent until the best of all places would be chance
in fewer than one recording of a million.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from functools import partial

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr

from lightflight.path.verdict import FindingName
from lightflight.reconstruct.model.sizes import PLAUSIBLE
from lightflight.reconstruct.verdict.candidates import Candidate, Rows
from lightflight.reconstruct.verdict.places import best_place, evenly_many

Floats = NDArray[np.float64]

_LEAST_PULSES = 3
"""A jump has so many pulses on either side: fewer are pixels that err by themselves."""


def jump_candidate(
    rows: Rows,
    residual: Floats,
    left_of: Callable[[Floats], Floats],
    *,
    counted_ps: Floats,
    stds_ps: Sequence[float],
) -> Candidate | None:
    """The jump between two rows, two columns or two counts of one camera that explains most.

    Parameters
    ----------
    rows : Rows
        The model.
    residual : array of float, shape (N,)
        Whitened.
    left_of : callable
        What the fit cannot take up of columns (N, k).
    counted_ps : array of float, shape (n,)
        What the clock of each pulse's pixel counted, signed as arrival times are.
    stds_ps : sequence of float
        Standard deviation of each camera's pulses: of one that lies across a jump a part is late.

    Returns
    -------
    Candidate or None
        None where no place explains anything.
    """
    jumps = [
        (where, late)
        for view in range(len(rows.cameras))
        for where, late in _jumps(rows, view, counted_ps, stds_ps[view])
    ]
    if not jumps:
        return None
    size, nothing = PLAUSIBLE["jump"].size, np.zeros(len(rows.lines.leg))
    columns = np.column_stack([size * rows.whole(late, nothing) for _, late in jumps])
    best = best_place(left_of(columns), residual, late_only=False)
    if best is None:
        return None
    return Candidate(
        FindingName.CALIBRATION,
        columns[:, best : best + 1],
        (PLAUSIBLE["jump"],),
        says=partial(_sentence, jumps[best][0]),
        looked_for=2.0 * float(np.log(len(jumps))),
    )


def _jumps(
    rows: Rows, view: int, counted_ps: Floats, std_ps: float
) -> Iterator[tuple[str, Floats]]:
    """Each place of one camera where its clock may jump, in words, and what comes late (n,)."""
    times = rows.times
    here = np.flatnonzero(times.view == view)
    whose = f" of camera {view + 1}" if len(rows.cameras) > 1 else ""
    for what, places in (("row", times.row[here]), ("column", times.col[here])):
        for first in np.unique(places)[1:]:
            late = np.zeros(len(times.leg))
            late[here] = places >= first
            if _both_sides(late[here]):
                yield f"from {what} {first:.0f} on{whose}", late
    told = here[np.isfinite(counted_ps[here])]
    for count in evenly_many(np.unique(np.round(counted_ps[told]))):
        late = np.zeros(len(times.leg))
        late[told] = ndtr((counted_ps[told] - count) / max(std_ps, 1e-3))
        if _both_sides(late[told]):
            yield f"where the clock{whose} has counted {abs(count):.0f} ps", late


def _both_sides(late: Floats) -> bool:
    """Whether a jump has pulses enough before and behind it."""
    return min(float(late.sum()), float((1.0 - late).sum())) >= _LEAST_PULSES


def _sentence(where: str, sizes: Floats) -> str:
    return f"times jump by {float(sizes[0]) * PLAUSIBLE['jump'].size:.2g} ps {where}"
