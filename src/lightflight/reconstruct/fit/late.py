"""How much of all pulses is late, and by how long, from pixels that each show their own pulse."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from lightflight.errors import NothingFoundError
from lightflight.path.verdict import FindingName
from lightflight.reconstruct.model import light
from lightflight.reconstruct.model.cells import Cells
from lightflight.reconstruct.model.counted import Pixels, Pulses, Tails, lit_pixels
from lightflight.reconstruct.model.sizes import PLAUSIBLE

Floats = NDArray[np.float64]

_MOST_ROUNDS = 30
"""Typically 3 without late light, 12 where two waits share one tail."""
_LINEAR = 0.01
"""Shares of light below this are none."""
_LONGEST = 0.3
"""Most that one unknown moves in a round: far from its value a step in proportion is too long."""
_LEAST_STEP = 0.25
"""Of a whole step."""
_STILL = 0.02
"""A round that moves no share by more was the last: legs are found with it, no time is measured."""
_WAIT_STD = 0.6
"""How far mean waits may be from those of the table, ln: half of the way to the next one."""
_NUDGE = 1e-3
"""Step of a mean wait for its derivative, ln."""


def tails_of(cells: Cells, pulses: Pulses) -> tuple[Tails, Pixels]:
    """Shares that are late, with their mean waits, and the pixels as they were fitted last.

    Parameters
    ----------
    cells : Cells
        Counts of pixels with one pulse each.
    pulses : Pulses
        Where it is, roughly.

    Returns
    -------
    tails : Tails
    pixels : Pixels

    Raises
    ------
    NothingFoundError
        Where no tails explain the counts.
    """
    n = light.N_LATE
    prior = np.repeat([PLAUSIBLE[FindingName.HAZE].size, _WAIT_STD], n) ** -2.0
    value: Floats = np.zeros(2 * n)
    before, damping = value, 1.0
    for _ in range(_MOST_ROUNDS):
        shares, waits = value[:n], np.array(light.LATE_PS) * np.exp(value[n:])
        tails = tuple(zip(shares.tolist(), waits.tolist(), strict=True))
        pixels = lit_pixels(cells, pulses, tails=tails)
        late = light.late_light(pixels, waits.tolist())
        later = light.late_light(pixels, (np.exp(_NUDGE) * waits).tolist())
        columns = np.concatenate((late, shares / _NUDGE * (later - late)), axis=2)
        score, information, _ = pixels.said_of(columns)
        total = information + np.diag(prior)
        step: Floats = np.linalg.solve(total, score - prior * value).astype(np.float64, copy=False)
        # A shape's width and what flight adds to it sway about each other: half as far, then.
        swayed = before @ total @ step < 0.0
        damping = max(0.5 * damping, _LEAST_STEP) if swayed else min(1.4 * damping, 1.0)
        before = step
        step = damping * step / max(1.0, float(np.abs(step).max()) / _LONGEST)
        value = value + step
        if np.abs(step[:n]).max() < _STILL or np.abs(value[:n]).max() < _LINEAR:
            waits = np.array(light.LATE_PS) * np.exp(value[n:])
            return tuple(zip(value[:n].tolist(), waits.tolist(), strict=True)), pixels
        # Of pulses with tails the width of a Gaussian is not that of their core.
        wider = float(np.log(np.nanmedian((pixels.std_ps / pulses.std_ps)[:, 0])))
        std = pulses.std_ps * np.exp(damping * wider)
        pulses = replace(pulses, late_ps=pixels.late_ps, std_ps=std)
    raise NothingFoundError("the shares of late light do not settle")
