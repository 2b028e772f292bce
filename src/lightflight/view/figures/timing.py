"""Time along the path: the two clocks (paper Fig. 6b), errors against truth, residuals.

Takes a LightPath, gives Axes. The horizontal axis of the first two is the camera's own: frames of
55 ps of arrival time, counted from the light of vertex 0.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.axes import Axes

from lightflight.path.tables import Polyline
from lightflight.path.trace import (
    PulsePlaces,
    Trace,
    parted,
    places_from_path,
    trace_from_path,
    traces_of_branches,
    true_event_time_along,
)
from lightflight.path.tree import starts_of, way_before
from lightflight.view import style
from lightflight.view.types import Floats, Marks

if TYPE_CHECKING:
    from lightflight import LightPath


PAPER_FRAME_PS = 55.0
"""One frame of the paper's Fig. 6(b), ps."""

_LEG_MARKS = "osD^v<>P*X"


def leg_mark(leg: int) -> str:
    """Marker of a leg; repeats after ten.

    Examples
    --------
    >>> leg_mark(0), leg_mark(10)
    ('o', 'o')
    """
    return _LEG_MARKS[leg % len(_LEG_MARKS)]


def _frames(trace: Trace, arrival_ps: Floats, frame_ps: float) -> Floats:
    return np.asarray((arrival_ps - trace.arrival_ps[0]) / frame_ps)


def _label_frames(ax: Axes, frame: Floats, frame_ps: float) -> None:
    ax.set_xlim(min(frame[0], 0.0), np.max(frame))
    ax.set_xlabel(f"camera frame (one frame: {frame_ps:g} ps of arrival time)")


def distortion_rms_ps(trace: Trace) -> float:
    """Root mean square of t_a against t, both from vertex 0, over equal event times; ps.

    What an observer is wrong by who takes arrival for event time (paper: 174.80 ps).
    """
    if len(trace.leg) == 0:
        return float("nan")
    # Equal event times, so that a long leg does not weigh by its number of points.
    event = np.linspace(trace.event_time_ps[0], trace.event_time_ps[-1], 2001)
    arrival = np.interp(event, trace.event_time_ps, trace.arrival_ps)
    return float(np.sqrt(np.mean(((arrival - arrival[0]) - (event - event[0])) ** 2)))


@style.styled
def draw_times(
    path: LightPath,
    ax: Axes | None = None,
    *,
    truth: Polyline | None = None,
    frame_ps: float = PAPER_FRAME_PS,
    in_view_only_marks: bool = True,
) -> Axes:
    """Event time t and arrival time t_a at every camera frame (paper, Fig. 6b).

    Both start at 0 at vertex 0. Dots are measured pulses: their arrival time, and the event time
    that the path makes of it. Shaded: what the camera's clock is wrong by.

    Parameters
    ----------
    path : LightPath
        Path with a camera.
    ax : Axes, optional
        Where to draw; None makes a figure of its own.
    truth : Polyline, optional
        For the dashed lines; taken from the path where it knows one.
    frame_ps : float, optional
        Width of a frame, ps.
    in_view_only_marks : bool, optional
        True greys the frames in which the pulse is outside the picture.

    Returns
    -------
    Axes
        The axes drawn on.
    """
    ax = style.axes_or_new(ax, 120, 80)
    trace = trace_from_path(path)
    if len(trace.leg) == 0 or not np.isfinite(trace.arrival_ps).all():
        return style.message(ax, "no camera or no legs: the path has no arrival times")
    frame = _frames(trace, trace.arrival_ps, frame_ps)
    # Each clock from its own zero: the delay from vertex 0 to the camera is no distortion.
    t_zero, a_zero = trace.event_time_ps[0], trace.arrival_ps[0]
    event, arrival = trace.event_time_ps - t_zero, trace.arrival_ps - a_zero
    if in_view_only_marks:
        shade_out_of_view(ax, *watched(trace, path, frame))
    x, told, seen = (parted(trace, values) for values in (frame, event, arrival))
    ax.fill_between(x, told, seen, color=style.ARRIVAL, alpha=0.10, lw=0, zorder=2)
    ax.plot(x, seen, color=style.ARRIVAL, lw=1.1, zorder=3, label="arrival time $t_a$")
    ax.plot(x, told, color=style.EVENT, lw=1.8, zorder=4, label="event time $t$")
    _draw_measured(ax, path, trace, frame_ps)
    truth = getattr(path, "truth", None) if truth is None else truth
    if truth is not None:
        exact = trace_from_path(truth, camera=path.camera, medium=path.medium)
        true_frame = (exact.arrival_ps - a_zero) / frame_ps
        when = exact.event_time_ps - t_zero
        x, when = parted(exact, true_frame), parted(exact, when)
        ax.plot(x, when, **style.TRUTH_LINE, zorder=6, label="truth")
    if in_view_only_marks and not trace.in_view.all():
        look: dict[str, Any] = {"facecolor": style.WASH, "edgecolor": style.HAIR, "lw": 0.6}
        ax.fill_between([], [], **look, label="pulse outside the picture")
    _label_frames(ax, frame, frame_ps)
    ax.set(ylim=(0, None), ylabel="time since vertex 0 (ps)")
    ax.legend(loc="upper left", bbox_to_anchor=(0.01, 1.0))
    return ax


def watched(trace: Trace, path: Polyline, x: Floats) -> tuple[Floats, Marks]:
    """Ascending abscissae of a path's points, and whether the camera sees any light there.

    Parameters
    ----------
    trace : Trace
        Of the path.
    path : Polyline
        Whose trace it is.
    x : array of float, shape (n,)
        Abscissa of each point: ascending along each branch.

    Returns
    -------
    array of float, array of bool
        Those of the points themselves where nothing forks.
    """
    branches = traces_of_branches(trace, path)
    if len(branches) == 1:
        return x, trace.in_view
    every = np.unique(x[np.isfinite(x)])
    seen = np.zeros(len(every), dtype=bool)
    for branch in branches:
        own = x[np.isin(trace.leg, branch.leg)]
        seen |= np.interp(every, own, branch.in_view.astype(float), left=0.0, right=0.0) > 0.5
    return every, seen


def shade_out_of_view(ax: Axes, x: Floats, in_view: Marks) -> None:
    """Grey bands where the camera does not see the pulse.

    Parameters
    ----------
    ax : Axes
        Where to draw.
    x : array of float
        Abscissa of the points.
    in_view : array of bool
        True where the camera sees the pulse.
    """
    # Bands between changes of view: one patch each, where one per point would leave seams.
    edges = np.flatnonzero(np.diff(in_view.astype(int)))
    starts = [0, *(edges + 1)] if not in_view[0] else list(edges + 1)
    for start in starts:
        if in_view[start]:
            continue
        after = np.flatnonzero(in_view[start:])
        stop = start + after[0] if after.size else len(x) - 1
        ax.axvspan(x[start], x[stop], color=style.WASH, lw=0, zorder=0)


def _draw_measured(ax: Axes, path: LightPath, trace: Trace, frame_ps: float) -> None:
    places = places_from_path(path)
    good = precise_pulses(places) & np.isfinite(places.measured_event_time_ps)
    if not good.any():
        return
    frame = _frames(trace, places.arrival_ps[good], frame_ps)
    style_of: dict[str, Any] = {
        "ls": "none",
        "marker": "o",
        "ms": 2.4,
        "mew": 0.5,
        "mfc": style.PAPER,
    }
    arrival = places.arrival_ps[good] - trace.arrival_ps[0]
    event = places.measured_event_time_ps[good] - trace.event_time_ps[0]
    ax.plot(frame, arrival, mec=style.ARRIVAL, zorder=5, label="single pulses", **style_of)
    ax.plot(frame, event, mec=style.EVENT, zorder=5, **style_of)


@style.styled
def draw_time_errors(
    path: LightPath,
    ax: Axes | None = None,
    *,
    truth: Polyline | None = None,
    others: Mapping[str, LightPath] | None = None,
    frame_ps: float = PAPER_FRAME_PS,
    points: bool = True,
) -> Axes:
    """Estimated minus true event time on the camera's rays, at every frame.

    The band is one sigma of the path; dots are single pulses with their error bars (those with
    more than three times the median error are not shown).
    The scale is the path's: another estimate that leaves it has its extremes in the legend.

    Parameters
    ----------
    path : LightPath
        The path.
    ax : Axes, optional
        Where to draw; None makes a figure of its own.
    truth : Polyline, optional
        Taken from the path where not given; without any the axes say so.
    others : mapping of str to LightPath, optional
        Other estimates by name.
    frame_ps : float, optional
        Width of a frame of arrival time, ps.
    points : bool, optional
        False leaves out the single pulses.

    Returns
    -------
    Axes
        The axes drawn on.
    """
    ax = style.axes_or_new(ax, 120, 60)
    truth = getattr(path, "truth", None) if truth is None else truth
    trace = trace_from_path(path)
    if truth is None or len(trace.leg) == 0:
        return style.message(ax, "the truth is not known: no errors to show")
    frame = _frames(trace, trace.arrival_ps, frame_ps)
    shade_out_of_view(ax, *watched(trace, path, frame))
    error = trace.event_time_ps - true_event_time_along(trace, truth, camera=path.camera)
    ax.axhline(0.0, **style.TRUTH_LINE, zorder=2)
    sigma = trace.event_time_std_ps
    if points:
        _draw_pulse_errors(ax, path, trace, truth, frame_ps)
    x, low, high = (parted(trace, v) for v in (frame, error - sigma, error + sigma))
    ax.fill_between(x, low, high, color=style.EVENT, alpha=0.22, lw=0)
    # A polyline without a name is drawn too.
    method = getattr(path, "method", "") or "path"
    own = _gaps(error, trace.in_view)
    ax.plot(x, parted(trace, own), color=style.EVENT, lw=1.6, zorder=5,
            label=f"{method}, $\\pm1\\sigma$")  # fmt: skip
    # Other estimates do not stretch the scale: beside the paper's estimator the path would be a
    # line.
    limit = _error_limit(path, own, sigma, points=points)
    for k, (name, other) in enumerate((others or {}).items()):
        o_trace = trace_from_path(other, camera=path.camera, medium=path.medium)
        o_error = o_trace.event_time_ps - true_event_time_along(o_trace, truth, camera=path.camera)
        o_error = _gaps(o_error, o_trace.in_view)
        ax.plot(
            parted(o_trace, _frames(trace, o_trace.arrival_ps, frame_ps)),
            parted(o_trace, o_error),
            **style.line_of_other(k),
            lw=1.1,
            zorder=3,
            label=_with_reach(name, o_error, limit),
        )
    _label_frames(ax, frame, frame_ps)
    ax.set(ylim=(-limit, limit), ylabel="$t$ \u2212 true $t$ (ps)")
    ax.legend(loc="best", ncols=3)
    return ax


def _error_limit(path: LightPath, own: Floats, sigma: Floats, *, points: bool) -> float:
    """Half of the vertical scale: the path and its precise pulses; other estimates may leave it."""
    reach = [np.abs(own) + 2.0 * np.nan_to_num(sigma)]
    if points:
        places = places_from_path(path)
        precise = precise_pulses(places)
        reach.append(np.abs(places.residual_ps[precise]) + places.std_ps[precise])
    every = np.concatenate(reach)
    every = every[np.isfinite(every)]
    return 1.5 * max(float(np.percentile(every, 98.0)), 1e-3) if every.size else 1.0


def _with_reach(name: str, error: Floats, limit: float) -> str:
    """Name of an estimate, with its extremes where it leaves the scale."""
    if not np.isfinite(error).any() or np.nanmax(np.abs(error)) <= limit:
        return name
    low, high = (style.number(float(f(error)), 2, sign=True) for f in (np.nanmin, np.nanmax))
    return f"{name} ({low} \u2026 {high} ps)"


@style.styled
def draw_time_std(
    path: LightPath, ax: Axes | None = None, *, frame_ps: float = PAPER_FRAME_PS
) -> Axes:
    """The path's own error of the event time at every frame, where no truth is known.

    Parameters
    ----------
    path : LightPath
        The path.
    ax : Axes, optional
        Where to draw; None makes a figure of its own.
    frame_ps : float, optional
        Width of a frame of arrival time, ps.

    Returns
    -------
    Axes
        The axes drawn on.
    """
    ax = style.axes_or_new(ax, 120, 60)
    trace = trace_from_path(path)
    if not np.isfinite(trace.event_time_std_ps).any():
        return style.message(ax, "the path carries no errors")
    frame = _frames(trace, trace.arrival_ps, frame_ps)
    shade_out_of_view(ax, *watched(trace, path, frame))
    ax.plot(parted(trace, frame), parted(trace, trace.event_time_std_ps), color=style.EVENT, lw=1.6)
    _label_frames(ax, frame, frame_ps)
    ax.set(ylim=(0, None), ylabel="1\u03c3 of $t$ (ps)")
    return ax


def _gaps(values: Floats, in_view: Marks) -> Floats:
    return np.where(in_view, values, np.nan)


def _draw_pulse_errors(
    ax: Axes, path: LightPath, trace: Trace, truth: Polyline, frame_ps: float
) -> None:
    places = places_from_path(path)
    good = precise_pulses(places) & np.isfinite(places.measured_event_time_ps)
    if not good.any():
        return
    # The truth is looked up on the ray of a point; a pulse has one where the path puts it.
    nodes = Trace(
        points_mm=places.points_mm[good], event_time_ps=places.event_time_ps[good],
        arrival_ps=places.arrival_ps[good], length_mm=places.length_mm[good],
        leg=places.leg[good], covariance=np.zeros((int(good.sum()), 4, 4)),
        in_view=np.ones(int(good.sum()), dtype=bool),
    )  # fmt: skip
    exact = true_event_time_along(nodes, truth, camera=path.camera)
    ax.errorbar(
        _frames(trace, places.arrival_ps[good], frame_ps),
        places.measured_event_time_ps[good] - exact, yerr=places.std_ps[good],
        ls="none", marker="o", ms=1.8, mfc=style.PAPER, mec=style.QUIET, mew=0.5,
        ecolor="#aab1bb", elinewidth=0.6, zorder=1.5, label="single pulses",
    )  # fmt: skip


@style.styled
def draw_residuals_along(
    path: LightPath,
    ax: Axes | None = None,
    *,
    truth: Polyline | None = None,
    limit_ps: float | None = None,
) -> Axes:
    """Arrival-time residuals with error bars against the length of path behind the pulse.

    Marks tell the legs apart, hollow ones are imprecise (more than three times the median
    error), crosses are pulses the fit left out. The scale follows the precise ones.

    Parameters
    ----------
    path : LightPath
        The path.
    ax : Axes, optional
        Where to draw; None makes a figure of its own.
    truth : Polyline, optional
        Not looked at: residuals need none.
    limit_ps : float, optional
        Half of the scale, ps; None follows the data.

    Returns
    -------
    Axes
        The axes drawn on.
    """
    del truth
    ax = style.axes_or_new(ax, 120, 60)
    places = places_from_path(path)
    shown = np.isfinite(places.residual_ps) & np.isfinite(places.length_mm)
    if not shown.any():
        return style.message(ax, "the path carries no residuals")
    limit = _residual_limit(places, shown) if limit_ps is None else limit_ps
    _draw_leg_bands(ax, path)
    ax.axhline(0.0, color=style.INK, lw=0.7, zorder=1)
    precise = precise_pulses(places)
    for leg in np.unique(places.leg[shown]):
        of_leg = shown & (places.leg == leg) & places.used
        _draw_residual_points(ax, places, of_leg & ~precise, leg_mark(leg), faint=True)
        _draw_residual_points(ax, places, of_leg & precise, leg_mark(leg), faint=False)
    faint = shown & places.used & ~precise
    if faint.any():
        label = f"hollow: error > 3 \u00d7 median ({int(faint.sum())})"
        ax.plot([], [], "o", ms=2.0, mfc=style.PAPER, mec="#a9b9d6", mew=0.5, label=label)
    left_out = shown & ~places.used
    # Outliers stay on the page, near its edge; their distance is written beside the farthest.
    clipped = np.clip(places.residual_ps, -0.86 * limit, 0.86 * limit)
    ax.plot(
        places.length_mm[left_out],
        clipped[left_out],
        "x",
        color=style.EVENT,
        ms=4.5,
        mew=1.1,
        zorder=4,
        label=f"left out ({int(left_out.sum())})" if left_out.any() else None,
    )
    _label_far_pulses(ax, places, left_out, limit)
    ax.set_ylim(-limit, limit)
    ax.set_xlim(0, max(end for _, end in _spans_mm(path)))
    ax.set_xlabel("length of path (mm)")
    ax.set_ylabel("$t_a$ \u2212 model (ps)")
    if left_out.any() or faint.any():
        ax.legend(loc="lower left")
    return ax


def precise_pulses(places: PulsePlaces) -> Marks:
    """(n,), True where the error is at most three times the median one: they carry the fit."""
    used = places.used & np.isfinite(places.std_ps)
    if not used.any():
        return used
    # A pulse of thrice the median error carries a ninth of its weight: it says little of the fit.
    return used & (places.std_ps <= 3.0 * float(np.median(places.std_ps[used])))


def _draw_residual_points(
    ax: Axes, places: PulsePlaces, which: Marks, mark: str, *, faint: bool
) -> None:
    """Pulses with error bars; imprecise ones step back."""
    if not which.any():
        return
    color = "#a9b9d6" if faint else style.ARRIVAL
    ax.errorbar(
        places.length_mm[which],
        places.residual_ps[which],
        yerr=places.std_ps[which],
        ls="none",
        marker=mark,
        ms=2.0 if faint else 2.8,
        mfc=style.PAPER if faint else color,
        mec=color,
        mew=0.5,
        ecolor="#d3dbea" if faint else "#8fa3c8",
        elinewidth=0.6 if faint else 0.7,
        zorder=2 if faint else 3,
    )


def _label_far_pulses(ax: Axes, places: PulsePlaces, left_out: Marks, limit: float) -> None:
    """Write beside the farthest few left-out pulses how far they are."""
    far = np.flatnonzero(left_out & (np.abs(places.residual_ps) > limit))
    for k in far[np.argsort(-np.abs(places.residual_ps[far]))][:4]:
        ax.annotate(
            style.number(places.residual_ps[k], 2, sign=True) + " ps",
            (places.length_mm[k], 0.86 * limit * np.sign(places.residual_ps[k])),
            xytext=(5, 0),
            textcoords="offset points",
            fontsize=6.0,
            color=style.EVENT,
            va="center",
        )


def _residual_limit(places: PulsePlaces, shown: Marks) -> float:
    precise = shown & precise_pulses(places)
    basis = precise if precise.any() else shown
    reach = np.abs(places.residual_ps[basis]) + np.nan_to_num(places.std_ps[basis])
    return 1.15 * style.robust_limit(reach, percentile=99.0)


def _draw_leg_bands(ax: Axes, path: LightPath) -> None:
    spans, starts = _spans_mm(path), starts_of(path)
    for leg, (start, end) in enumerate(spans):
        if leg % 2 == 0:
            ax.axvspan(start, end, color=style.WASH, lw=0, zorder=0)
        # Legs that leave one fork run side by side: their words stand below each other.
        line = np.count_nonzero(starts[:leg] == starts[leg])
        # Of more than eight legs the words would overlap.
        if len(spans) <= 8:
            ax.text(
                (start + end) / 2, 0.985 - 0.08 * line, f"leg {leg + 1}",
                transform=ax.get_xaxis_transform(), ha="center", va="top", fontsize=6.5,
                color=style.QUIET,
            )  # fmt: skip


def _spans_mm(path: Polyline) -> list[tuple[float, float]]:
    """Way of the light to the start of each leg and to its end, mm."""
    vertices, starts = np.asarray(path.vertices_mm, dtype=float), starts_of(path)
    way = way_before(starts, np.linalg.norm(vertices[1:] - vertices[starts], axis=1))
    return [(float(way[start]), float(way[leg + 1])) for leg, start in enumerate(starts)]


@style.styled
def draw_residual_map(
    path: LightPath, ax: Axes | None = None, *, limit_ps: float | None = None
) -> Axes:
    """Residuals as the camera's picture; the largest one where legs cross in a pixel.

    Negative pixels carry a dot, so that the sign survives without colour; crosses are left out.
    The scale follows the precise pulses (at most three times the median error).

    Parameters
    ----------
    path : LightPath
        The path.
    ax : Axes, optional
        Where to draw; None makes a figure of its own.
    limit_ps : float, optional
        Half of the scale, ps; None follows the data.

    Returns
    -------
    Axes
        The axes drawn on.
    """
    ax = style.axes_or_new(ax, 90, 80)
    places = places_from_path(path)
    camera = getattr(path, "camera", None)
    if camera is None or not np.isfinite(places.residual_ps).any():
        return style.message(ax, "the path carries no residuals")
    picture = np.full(camera.shape, np.nan)
    # Written in ascending order: where legs cross in a pixel, the largest residual stays.
    order = np.argsort(np.abs(np.nan_to_num(places.residual_ps)))
    use = order[places.used[order]]
    picture[places.row[use], places.col[use]] = places.residual_ps[use]
    precise = precise_pulses(places)
    basis = places.residual_ps[precise if precise.any() else places.used]
    limit = style.robust_limit(basis) if limit_ps is None else limit_ps
    ax.set_facecolor(style.WASH)
    image = ax.imshow(picture, cmap=style.signed_colormap(), vmin=-limit, vmax=limit)
    negative = np.argwhere(picture < 0)
    size = max(0.4, 40.0 / max(camera.shape))
    ax.plot(negative[:, 1], negative[:, 0], ".", color=style.PAPER, ms=1.4 * size, zorder=3)
    out = ~places.used & np.isfinite(places.residual_ps)
    ax.plot(
        places.col[out], places.row[out], "x", color=style.EVENT, ms=3.2 * size, mew=0.9, zorder=4
    )
    ax.set(xlabel="column", ylabel="row")
    style.colorbar(ax, image, "residual (ps); dot: negative", extend="both")
    return ax
