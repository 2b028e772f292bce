"""Every result of the paper: what is measured for it, the record it becomes, how it is drawn."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from matplotlib.figure import Figure

from studies.zheng2020 import (
    contributions,
    discussion,
    fig2,
    fig4,
    fig5a,
    fig5b,
    fig5c,
    fig6,
    figures,
)
from studies.zheng2020.work import Progress, Unit, results_of_units


@dataclass(frozen=True)
class Experiment:
    """How one result is made."""

    draw: Callable[[Any], Figure]
    """Figure of its record."""
    record: Callable[[Sequence[Mapping[str, Any]], int], Any]
    """Record from the results of its units and the seed."""
    units: Callable[[bool], tuple[Unit, ...]]
    """Units of work it is made from, by whether the run is a quick one; none: made at once."""


def _measured(
    draw: Callable[[Any], Figure],
    record: Callable[[Sequence[Mapping[str, Any]]], Any],
    units: Callable[[bool], tuple[Unit, ...]],
) -> Experiment:
    """A result of units alone: the seed is theirs."""
    return Experiment(draw, lambda results, _seed: record(results), units)


EXPERIMENTS: Mapping[str, Experiment] = {
    "fig2": Experiment(
        figures.fig2_figure, lambda _results, seed: fig2.record(seed=seed), lambda _quick: ()
    ),
    "fig4": _measured(figures.fig4_figure, fig4.record_from_results, fig4.units),
    "fig5a": _measured(figures.fig5a_figure, fig5a.record_from_results, fig5a.units),
    "fig5b": _measured(figures.fig5b_figure, fig5b.record_from_results, fig5b.units),
    "fig5c": _measured(figures.fig5c_figure, fig5c.record_from_results, fig5c.units),
    "fig6": _measured(figures.fig6_figure, fig6.record_from_results, fig6.units),
    "contributions": _measured(
        figures.contributions_figure, contributions.record_from_results, contributions.units
    ),
    "discussion": _measured(
        figures.discussion_figure, discussion.record_from_results, discussion.units
    ),
}
"""Everything there is a figure of."""

CHOICES: Mapping[str, tuple[str, ...]] = {
    "all": tuple(EXPERIMENTS),
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
    units = {unit.name: unit for name in names for unit in EXPERIMENTS[name].units(quick)}
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
    names : of `EXPERIMENTS`.
    folder : where finished units are kept.
    quick : fewer angles, recordings and pixels: a minute instead of half an hour.
    seed, workers, fresh, progress : as in `results_of_units`.
    """
    results = results_of_units(
        units_of_results(names, quick=quick),
        folder,
        seed=seed,
        workers=workers,
        fresh=fresh,
        progress=progress,
    )
    return {
        name: EXPERIMENTS[name].record(
            [results[unit.name] for unit in EXPERIMENTS[name].units(quick)], seed
        )
        for name in names
    }
