"""A campaign at a glance: angles against set-points, what is left of them, pulls of the repeats.

Takes groups of repeats (`lightflight.batch.table.Repeats`) and Axes.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from lightflight.view import style
from lightflight.view.figures.pulls import draw_unit_normal, write_note
from lightflight.view.types import Floats

if TYPE_CHECKING:
    from lightflight.batch.table import Repeats


_ALL = "\u03b1 (deg)"
_MOST_NAMES = 12
_SPREAD = 0.5
"""Part of the distance between two groups over which the repeats of one are spread."""


def _places(groups: Sequence[Repeats]) -> tuple[Floats, bool]:
    """Where each group stands on the axis: its set-point, or its number where any has none."""
    told = [group.set_point_deg for group in groups]
    # One axis for all groups: a set-point that some lack is no abscissa.
    if None in told:
        return np.arange(1.0, len(groups) + 1), False
    return np.array(told, dtype=float), True


def _spread(places: Floats, groups: Sequence[Repeats]) -> list[Floats]:
    """Abscissa of every repeat: side by side about the place of its group."""
    gaps = np.diff(np.unique(places))
    # Repeats lie side by side, and stay clear of the next group.
    width = _SPREAD * (float(gaps.min()) if gaps.size else 1.0)
    found = []
    for place, group in zip(places, groups, strict=True):
        n = group.angle_deg.size
        step = np.arange(n) - (n - 1) / 2 if n > 1 else np.zeros(n)
        found.append(place + width * step / max(1, n - 1))
    return found


def _label_places(ax: Axes, groups: Sequence[Repeats], places: Floats, *, told: bool) -> None:
    if told:
        ax.set_xlabel("set-point (deg)")
        return
    ax.set_xlabel("group")
    if len(groups) <= _MOST_NAMES:
        ax.set_xticks(
            places, [style.words(group.name) or str(k + 1) for k, group in enumerate(groups)]
        )


@style.styled
def draw_set_points(groups: Sequence[Repeats], ax: Axes | None = None) -> Axes:
    """Mean elevation of each group against its set-point; the line is where they are equal.

    Parameters
    ----------
    groups : sequence of Repeats
        Repeats, one entry per scene (`CampaignTable.repeats`).
    ax : Axes, optional
        Where to draw; None makes a figure of its own.

    Returns
    -------
    Axes
        The axes drawn on.
    """
    ax = style.axes_or_new(ax, 90, 80)
    places, told = _places(groups)
    means = np.array([group.mean_deg for group in groups])
    errors = np.array([group.mean_std_deg for group in groups])
    if not np.isfinite(means).any():
        return style.message(ax, "no recording gave a path")
    if told:
        pad = 0.05 * max(float(np.ptp(places)), 1.0)
        ends = np.array([places.min() - pad, places.max() + pad])
        ax.plot(ends, ends, color=style.QUIET, lw=0.8, zorder=1)
    ax.errorbar(
        places, means, yerr=errors, ls="none", marker="o", ms=3.0, color=style.EVENT,
        ecolor=style.EVENT, elinewidth=0.8, zorder=3,
    )  # fmt: skip
    _label_places(ax, groups, places, told=told)
    ax.set_ylabel(f"elevation {_ALL}")
    return ax


@style.styled
def draw_set_point_errors(groups: Sequence[Repeats], ax: Axes | None = None) -> Axes:
    """Every repeat minus its set-point (without one: minus the mean of its group).

    Thick error bars: what differs from repeat to repeat; thin ones: with what they share.

    Parameters
    ----------
    groups : sequence of Repeats
        Repeats, one entry per scene (`CampaignTable.repeats`).
    ax : Axes, optional
        Where to draw; None makes a figure of its own.

    Returns
    -------
    Axes
        The axes drawn on.
    """
    ax = style.axes_or_new(ax, 120, 60)
    places, told = _places(groups)
    if not any(group.angle_deg.size for group in groups):
        return style.message(ax, "no recording gave a path")
    ax.axhline(0.0, color=style.QUIET, lw=0.8, zorder=1)
    for x, group in zip(_spread(places, groups), groups, strict=True):
        origin = group.mean_deg if group.set_point_deg is None or not told else group.set_point_deg
        y = group.angle_deg - origin
        thin: dict[str, Any] = {"ls": "none", "ecolor": "#aab1bb", "elinewidth": 0.6, "zorder": 2}
        ax.errorbar(x, y, yerr=group.std_deg, **thin)
        ax.errorbar(
            x, y, yerr=group.photon_std_deg, ls="none", marker="o", ms=2.2, color=style.ARRIVAL,
            ecolor=style.ARRIVAL, elinewidth=1.3, zorder=3,
        )  # fmt: skip
    _label_places(ax, groups, places, told=told)
    ax.set_ylabel("\u03b1 \u2212 set-point (deg)" if told else "\u03b1 \u2212 mean (deg)")
    return ax


@style.styled
def draw_repeat_pulls(groups: Sequence[Repeats], ax: Axes | None = None) -> Axes:
    """Histogram of the repeats' distances from their means over the stated photon errors.

    Fewer than ten are dots.

    Parameters
    ----------
    groups : sequence of Repeats
        Repeats, one entry per scene (`CampaignTable.repeats`).
    ax : Axes, optional
        Where to draw; None makes a figure of its own.

    Returns
    -------
    Axes
        The axes drawn on.
    """
    ax = style.axes_or_new(ax, 70, 60)
    parts = [group.pulls for group in groups]
    pulls = np.concatenate(parts) if parts else np.empty(0)
    if pulls.size == 0:
        return style.message(ax, "no group has two repeats: no pulls")
    draw_unit_normal(ax, pulls, what="repeats")
    rms = style.number(float(np.sqrt(np.mean(pulls**2))), 3)
    write_note(ax, f"n = {pulls.size}", f"rms {rms}")
    ax.set_xlabel("(\u03b1 \u2212 mean of repeats) / its error")
    return ax


@style.styled
def campaign_figure(
    groups: Sequence[Repeats], *, title: str = "", verdicts: Mapping[str, int] | None = None
) -> Figure:
    """One page about a campaign.

    Parameters
    ----------
    groups : sequence of Repeats
        Repeats, one entry per scene (`CampaignTable.repeats`).
    title : str, optional
        Heading; empty: the number of recordings.
    verdicts : mapping of str to int, optional
        Paths by the level of their verdict (`CampaignTable.n_by_verdict`), told in the heading.

    Returns
    -------
    Figure
        The page, to be saved or shown.
    """
    figure = style.new_figure(180, 120, layout="constrained")
    grid = figure.add_gridspec(2, 2, width_ratios=(1.4, 1.0), height_ratios=(1.2, 1.0))
    above, below = figure.add_subplot(grid[0, 0]), figure.add_subplot(grid[1, :])
    draw_set_points(groups, above)
    draw_repeat_pulls(groups, figure.add_subplot(grid[0, 1]))
    draw_set_point_errors(groups, below)
    n = sum(group.angle_deg.size for group in groups)
    scenes = "scene" if len(groups) == 1 else "scenes"
    heading = title or f"{n} {'path' if n == 1 else 'paths'} of {len(groups)} {scenes}"
    told = ", ".join(f"{n} {level}" for level, n in (verdicts or {}).items() if n)
    heading = f"{heading}: {told}" if told else heading
    figure.suptitle(style.words(heading), x=0.01, ha="left", fontsize=10, fontweight="bold")
    if groups and _places(groups)[1]:
        style.title(above, "Against the set-point", "line: equal")
    else:
        style.title(above, "Elevation of each group")
    style.title(figure.axes[1], "Repeats")
    style.title(below, "What is left", "thick: photons; thin: with what repeats share")
    return figure
