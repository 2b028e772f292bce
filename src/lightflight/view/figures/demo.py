"""One picture of a whole reconstruction: path, two clocks, what the camera saw, residuals.

Takes a LightPath and what it was made from, gives a Figure.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.text import Annotation, Text

from lightflight.path.tables import Polyline
from lightflight.path.trace import places_from_path, trace_from_path
from lightflight.path.verdict import MEANING, NOT_EXAMINED
from lightflight.view import style
from lightflight.view.figures.camera import draw_camera_picture
from lightflight.view.figures.path import draw_path_3d, legend_entries
from lightflight.view.figures.pulls import draw_pulls
from lightflight.view.figures.timing import (
    distortion_rms_ps,
    draw_residual_map,
    draw_residuals_along,
    draw_time_errors,
    draw_time_std,
    draw_times,
)
from lightflight.view.page.payload import errors_of, fit_in_words
from lightflight.view.page.tables import heading

if TYPE_CHECKING:
    from lightflight import Arrivals, LightPath

_WIDTH_MM, _HEIGHT_MM = 250.0, 186.0
_MOST_LETTERS = 118
"""Of the line below the headline: more would run into the table at its right."""


def _place(figure: Figure, left: float, top: float, width: float, height: float) -> Axes:
    """Axes at a place given in mm from the upper left corner."""
    return style.axes_in_mm(figure, (_WIDTH_MM, _HEIGHT_MM), left, top, width, height)


@style.styled
def demo_figure(
    path: LightPath,
    *,
    truth: Polyline | None = None,
    arrivals: Arrivals | None = None,
    others: Mapping[str, LightPath] | None = None,
    published: Mapping[str, tuple[float, float]] | None = None,
    headline: str | None = None,
) -> Figure:
    """A reconstruction on one page (250 x 186 mm): where, when, how well.

    Parameters
    ----------
    path : LightPath
        The path.
    truth : Polyline, optional
        What to compare with; taken from the path where it knows one.
    arrivals : Arrivals, optional
        Arrivals for the camera's picture; without them residuals are mapped instead.
    others : mapping of str to LightPath, optional
        Other estimates by name, e.g. {"paper": path_by_the_paper's_estimator}.
    published : mapping of str to (float, float), optional
        Results of others, name to (position rms mm, time rms ps).
    headline : str, optional
        None writes one.

    Returns
    -------
    Figure
        The page, to be saved or shown.
    """
    truth = getattr(path, "truth", None) if truth is None else truth
    others = dict(others or {})
    figure = style.new_figure(_WIDTH_MM, _HEIGHT_MM)
    _write_headline(figure, path, headline)
    _write_table(figure, path, truth, others, dict(published or {}))

    space = _place(figure, 6, 25, 148, 74)
    # The legend stands above in one row: in the drawing it would hide the scene.
    draw_path_3d(path, space, truth=truth, others=others, legend=False)
    _legend_below_headline(figure, space, path)

    picture = _place(figure, 170, 43, 62, 53)
    if arrivals is None:
        draw_residual_map(path, picture)
        style.title(picture, "Residuals by pixel")
    else:
        draw_camera_picture(arrivals, picture, path=path)
        picture.set_anchor("W")
        style.title(picture, "The camera saw")

    times = _place(figure, 17, 111, 131, 34)
    draw_times(path, times, truth=truth)
    style.title(times, "Two clocks")
    errors = _place(figure, 17, 152, 131, 24)
    if truth is None:
        draw_time_std(path, errors)
    else:
        draw_time_errors(path, errors, truth=truth, others=_comparable(others))
    times.tick_params(labelbottom=False)
    times.set_xlabel("")

    residuals = _place(figure, 170, 111, 57, 65)
    draw_residuals_along(path, residuals)
    style.title(residuals, "Residuals of single pulses")
    _pulls_beside(figure, path, residuals)
    return figure


def _comparable(others: Mapping[str, LightPath]) -> dict[str, Any]:
    return {name: other for name, other in others.items() if len(other.vertices_mm) > 1}


def _pulls_beside(figure: Figure, path: LightPath, residuals: Axes) -> None:
    """A narrow histogram of pulls at the right of the residuals, its numbers above it."""
    pulls = _place(figure, 228, 111, 12, 65)
    draw_pulls(path, pulls, vertical=True, note=False)
    if not pulls.axison:
        return
    pulls.yaxis.tick_right()
    pulls.yaxis.set_label_position("right")
    pulls.spines["left"].set_visible(False)
    pulls.spines["bottom"].set_visible(False)
    pulls.set_xticks([])
    pulls.set_xlabel("")
    pulls.set_ylabel("")
    places = places_from_path(path)
    spread = float(np.nanstd(places.pull[places.used], ddof=1)) if places.used.sum() > 1 else np.nan
    pulls.annotate(
        f"pulls: std {style.number(spread, 2)}", (1.0, 1.0), xycoords="axes fraction",
        xytext=(0, 6), textcoords="offset points", ha="right", va="bottom", fontsize=7.0,
        color=style.QUIET,
    )  # fmt: skip


def _write_headline(figure: Figure, path: LightPath, headline: str | None) -> None:
    length = float(sum(leg.length_mm for leg in path.legs))
    duration = float(np.max(path.vertex_times_ps) - path.vertex_times_ps[0])
    if headline is None:
        headline = heading(path)
    # The badge first: its width is the renderer's, so the headline is tied to its right edge.
    badge = _badge(figure, path)
    figure.add_artist(
        Annotation(
            style.words(headline), (1.0, 0.5), xycoords=badge, xytext=(9, 0),
            textcoords="offset points",
            fontsize=14, fontweight="bold", va="center", annotation_clip=False,
        )
    )  # fmt: skip
    x = 10 / _WIDTH_MM
    figure.text(x, 1 - 13 / _HEIGHT_MM, _why(path), fontsize=7.0, color=style.INK, va="center")
    parts = [f"{length:.0f} mm in {duration / 1000:.2f} ns", f"{path.method} estimate"]
    if getattr(path, "prior", ""):
        parts.append(path.prior)
    goodness = getattr(path, "goodness", None)
    if goodness is not None and fit_in_words(goodness):
        parts.append(fit_in_words(goodness))
    text = "  \u00b7  ".join(parts)
    figure.text(x, 1 - 16.6 / _HEIGHT_MM, text, fontsize=7.0, color=style.QUIET, va="center")


def _badge(figure: Figure, path: LightPath) -> Text:
    """The level of the verdict as a word on its colour."""
    level = str(getattr(path, "verdict", NOT_EXAMINED).level)
    ground, ink = style.VERDICT[level]
    return figure.text(
        11 / _WIDTH_MM, 1 - 7.5 / _HEIGHT_MM, level, fontsize=10, fontweight="bold", color=ink,
        va="center", bbox={"boxstyle": "round,pad=0.35", "facecolor": ground, "linewidth": 0.0},
    )  # fmt: skip


def _why(path: LightPath) -> str:
    """What the verdict rests on, in one line: share explained, and the first finding."""
    verdict = getattr(path, "verdict", NOT_EXAMINED)
    explained = getattr(path, "explained", None)
    share = "" if explained is None else f"explains {explained}  \u00b7  "
    if not verdict.findings:
        return share + MEANING[verdict.level]
    first, others = verdict.findings[0], len(verdict.findings) - 1
    clearly = f" ({first.sigma:.2g} \u03c3)" if first.sigma else ""
    more = f", and {others} more" if others else ""
    room = _MOST_LETTERS - len(share) - len(clearly) - len(more)
    said = style.words(first.sentence)
    said = said if len(said) <= room else said[: room - 1].rstrip() + "\u2026"
    return f"{share}{said}{clearly}{more}"


def _legend_below_headline(figure: Figure, space: Axes, path: LightPath) -> None:
    handles, labels = legend_entries(space, path)
    figure.legend(
        handles, labels, loc="upper left", bbox_to_anchor=(9 / _WIDTH_MM, 1 - 19 / _HEIGHT_MM),
        ncols=len(labels), columnspacing=1.1, handletextpad=0.5, borderaxespad=0.0, fontsize=6.8,
    )  # fmt: skip


def _write_table(
    figure: Figure,
    path: LightPath,
    truth: Polyline | None,
    others: Mapping[str, LightPath],
    published: Mapping[str, tuple[float, float]],
) -> None:
    """Errors against truth at the upper right, in type."""
    if truth is None:
        return
    rows = [(f"{path.method}", *errors_of(path, truth), style.EVENT)]
    rows += [(f"{name}", *errors_of(other, truth), style.INK) for name, other in others.items()]
    rows += [(name, *values, style.QUIET) for name, values in published.items()]
    # What one is wrong by who takes the picture's times for the events' own.
    exact = trace_from_path(truth, camera=path.camera, medium=path.medium)
    rows.append(("arrival time as it is", float("nan"), distortion_rms_ps(exact), style.ARRIVAL))
    left, right, top, step = 170.0, 243.0, 8.0, 4.6
    header: dict[str, Any] = {"fontsize": 7, "color": style.QUIET, "va": "center"}
    for x, text, ha in (
        (left, "rms error in view", "left"), (right - 21, "position", "right"),
        (right, "time", "right"),
    ):  # fmt: skip
        figure.text(x / _WIDTH_MM, 1 - top / _HEIGHT_MM, text, ha=ha, **header)
    for k, (name, position, time, color) in enumerate(rows, start=1):
        y = 1 - (top + 0.4 + k * step) / _HEIGHT_MM
        options: dict[str, Any] = {
            "fontsize": 8.5, "color": color, "va": "center",
            "fontweight": "bold" if k == 1 else "normal",
        }  # fmt: skip
        figure.text(left / _WIDTH_MM, y, name, **options)
        for x, value, unit in ((right - 21, position, "mm"), (right, time, "ps")):
            text = f"{_error_number(value)} {unit}" if np.isfinite(value) else "\u2013"
            figure.text(x / _WIDTH_MM, y, text, ha="right", **options)


def _error_number(value: float) -> str:
    return style.number(value, 2 if value < 0.1 else 3)
