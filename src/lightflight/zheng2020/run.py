"""Every result of the paper, by name: what must be done for it, and the record it becomes."""

from __future__ import annotations

import os
from collections.abc import Sequence
from typing import Any

from lightflight.zheng2020 import (
    contributions,
    discussion,
    fig2,
    fig4,
    fig5a,
    fig5b,
    fig5c,
    fig6,
)
from lightflight.zheng2020.work import Progress, Unit, results_of_units

MODULES: dict[str, Any] = {
    "fig4": fig4,
    "fig5a": fig5a,
    "fig5b": fig5b,
    "fig5c": fig5c,
    "fig6": fig6,
    "contributions": contributions,
    "discussion": discussion,
}
"""Results that are made from units of work; `fig2` is made at once."""

FIGURES = ("fig2", *MODULES)
"""Everything there is a figure of."""

CHOICES: dict[str, tuple[str, ...]] = {
    "all": FIGURES,
    "fig2": ("fig2",),
    "fig4": ("fig4",),
    "fig5a": ("fig5a",),
    "fig5b": ("fig5b",),
    "fig5c": ("fig5c",),
    "fig6": ("fig6", "contributions"),
    "discussion": ("discussion",),
    "table": ("fig5a", "fig5c", "fig6", "contributions", "discussion"),
}
"""What a user may ask for, and the results it takes."""


def units_of_results(names: Sequence[str], *, quick: bool) -> tuple[Unit, ...]:
    """Every unit of work the results need, each once, the longest first."""
    units = {u.name: u for n in names if n in MODULES for u in MODULES[n].units(quick=quick)}
    return tuple(sorted(units.values(), key=_is_short))


def _is_short(unit: Unit) -> int:
    """Long units are started first, so that no process waits for one at the end."""
    return 0 if unit.name.startswith(("array", "cavity", "legs")) else 1


def records_of_results(
    names: Sequence[str],
    folder: str | os.PathLike[str],
    *,
    quick: bool,
    seed: int = 0,
    workers: int = 1,
    fresh: bool = False,
    progress: Progress | None = None,
) -> dict[str, Any]:
    """Records by name; units that the folder holds already are not done again.

    Parameters
    ----------
    names : of `FIGURES`.
    folder : where finished units are kept.
    quick : fewer angles, recordings and pixels: a minute instead of half an hour.
    seed, workers, fresh, progress : as in `results_of_units`.
    """
    units = units_of_results(names, quick=quick)
    results = results_of_units(
        units, folder, seed=seed, workers=workers, fresh=fresh, progress=progress
    )
    records = {}
    for name in names:
        if name in MODULES:
            own = [results[unit.name] for unit in MODULES[name].units(quick=quick)]
            records[name] = MODULES[name].record_from_results(own)
        else:
            records[name] = fig2.record(seed=seed)
    return records
