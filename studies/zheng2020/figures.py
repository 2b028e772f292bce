"""The figures of Zheng et al. 2020, drawn from the records of this study.

Each function takes one record and gives a Figure; the paper's own numbers are marked with a star.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patheffects import withStroke
from numpy.typing import NDArray

from lightflight import flags as fl
from lightflight.demo import POSITION_RMS_MM
from lightflight.units import fwhm_from_std
from lightflight.view import style
from lightflight.view.figures.camera import (
    FIG_2B_CASES,
    draw_camera_picture,
    draw_pixel_histogram,
    pixel_of_case,
)
from lightflight.view.figures.path import draw_path_3d, draw_path_on_photo, legend_entries
from lightflight.view.figures.timing import draw_times
from lightflight.view.film.encode import Frame
from lightflight.view.film.flight import MovieSettings, movie_frames
from studies.zheng2020 import reported
from studies.zheng2020.contributions import Contributions
from studies.zheng2020.discussion import Discussion
from studies.zheng2020.fig2 import Fig2
from studies.zheng2020.fig4 import Fig4
from studies.zheng2020.fig5a import Fig5a
from studies.zheng2020.fig5b import Fig5b
from studies.zheng2020.fig5c import Fig5c
from studies.zheng2020.fig6 import Fig6
from studies.zheng2020.photo_stand_in import rendered_set_up

Floats = NDArray[np.float64]

_STAR: dict[str, Any] = {"marker": "*", "ms": 9, "ls": "none", "color": style.INK, "zorder": 8}
_PAPER, _JOINT, _PHOTON = style.OTHERS[0], style.EVENT, style.OTHERS[1]
_COLORS = {"paper": _PAPER, "joint": _JOINT, "photon": _PHOTON}


@style.styled
def fig2_figure(record: Fig2) -> Figure:
    """The four kinds of pixel (Fig. 2b), and the arrival times of those kept (Fig. 2c)."""
    figure = style.new_figure(250, 125, layout="constrained")
    grid = figure.add_gridspec(1, 2, width_ratios=(1.45, 1.0))
    left, right = (figure.add_subfigure(grid[0, k]) for k in (0, 1))
    axes = left.subplots(2, 2).ravel()
    for number, (ax, (name, bits)) in enumerate(zip(axes, FIG_2B_CASES, strict=True), start=1):
        pixel = pixel_of_case(record.pulses, bits)
        if pixel is None:
            style.message(ax, f"no pixel is\n{name}")
        else:
            screams = bool(bits & fl.ABNORMAL_COUNT)
            draw_pixel_histogram(
                record.hist, *pixel, ax, pulses=None if screams else record.pulses, annotate=False
            )
            _note_pixel(ax, record, pixel, screams=screams)
        kept = "kept" if bits == 0 else "left out"
        style.title(ax, f"{number}  {name}: {kept}")
    ax = right.subplots()
    draw_camera_picture(record.arrivals, ax)
    style.title(ax, f"{record.n_kept} pixels kept")
    return figure


def _note_pixel(ax: Axes, record: Fig2, pixel: tuple[int, int], *, screams: bool) -> None:
    """Say above the counts of a pixel what was found in it."""
    row, col = pixel
    if screams:
        occupancy = record.hist.occupancy
        assert occupancy is not None  # the twin counts its frames
        share = 100 * occupancy[row, col]
        lines = [f"row {row}, column {col}", f"fires in {share:.0f} % of all frames"]
    else:
        pulses = record.pulses
        (k,) = np.flatnonzero((pulses.row == row) & (pulses.col == col))[:1]
        lines = [
            f"row {row}, column {col}: {record.hist.photons[row, col]:,.0f} counts",
            f"{pulses.delay_ps[k]:.0f} ps, FWHM {fwhm_from_std(pulses.std_ps[k]):.0f} ps",
        ]
    ax.set_ylim(0, 1.3 * ax.get_ylim()[1])
    ax.annotate(
        "\n".join(lines), (0.03, 0.97), xycoords="axes fraction", va="top", fontsize=7, zorder=9,
        path_effects=[withStroke(linewidth=2.6, foreground=style.PAPER)],
    )  # fmt: skip


def _degrees(angle: float, digits: str = ".2f") -> str:
    """An angle in deg with a minus sign as long as those of the axes."""
    return f"{angle:{digits}}\u00b0".replace("-", "\u2212")


@style.styled
def fig4_figure(record: Fig4) -> Figure:
    """The legs one after another (Fig. 4): start, reference plane, projection, angle, end."""
    n = len(record.starts_mm)
    figure = style.new_figure(190, 62, layout="constrained")
    for leg, ax in enumerate(figure.subplots(1, n, sharey=True)):
        _draw_reference_plane(ax, record, leg)
        ax.set_xlabel("x (mm)")
        style.title(ax, f"Leg {leg + 1}", f"dashed: true, {_degrees(record.true_angles_deg[leg])}")
    figure.axes[0].set_ylabel("z (mm), towards the camera")
    return figure


def _draw_reference_plane(ax: Axes, record: Fig4, leg: int) -> None:
    start, end = record.starts_mm[leg], record.ends_mm[leg]
    seen, true = record.projected_ends_mm[leg], record.true_vertices_mm[leg : leg + 2]
    ax.plot(true[:, 0], true[:, 2], color=style.INK, lw=0.8, ls=(0, (4, 3)), zorder=3)
    before = np.vstack([record.starts_mm[: leg + 1]])
    ax.plot(before[:, 0], before[:, 2], color=style.HAIR, lw=2.0, zorder=2)
    ax.axhline(record.plane_z_mm[leg], color=style.ARRIVAL, lw=0.8, alpha=0.6)
    ax.plot([start[0], seen[0]], [start[2], seen[2]], color=style.ARRIVAL, lw=2.2, alpha=0.5)
    ax.plot([seen[0], end[0]], [seen[2], end[2]], color=style.QUIET, lw=0.6, ls=":")
    ax.plot([start[0], end[0]], [start[2], end[2]], color=style.EVENT, lw=1.8, zorder=4)
    for point, name in ((start, f"S{leg + 1}"), (end, f"E{leg + 1}")):
        ax.plot(point[0], point[2], "o", ms=4, color=style.INK, zorder=6)
        ax.annotate(name, (point[0], point[2]), (0, 6), textcoords="offset points", ha="center")
    rightwards = end[0] > start[0]
    ax.annotate(
        f"RP{leg + 1}", (1.0 if rightwards else 0.0, record.plane_z_mm[leg]), (0, -8),
        xycoords=("axes fraction", "data"), textcoords="offset points",
        ha="right" if rightwards else "left", color=style.ARRIVAL, fontsize=7,
    )  # fmt: skip
    middle = 0.5 * (start + end)
    ax.annotate(
        f"\u03b1 = {_degrees(record.angles_deg[leg])}", (middle[0], middle[2]), (0, -16),
        textcoords="offset points", ha="center", color=style.EVENT, zorder=9,
        bbox={"fc": style.PAPER, "ec": "none", "pad": 1.0, "alpha": 0.8},
    )  # fmt: skip
    ax.margins(x=0.06, y=0.28)


@style.styled
def fig5a_figure(record: Fig5a) -> Figure:
    """Angle error against the number of arrival times (Fig. 5a), one recording and their mean."""
    figure = style.new_figure(190, 82, layout="constrained")
    left, right = figure.subplots(1, 2, sharey=True)
    _draw_angle_errors(
        left, record, record.single_deg, record.estimator_single_deg, record.bound_deg["known"]
    )
    style.title(left, "One recording")
    _draw_angle_errors(
        right,
        record,
        record.averaged_deg,
        record.estimator_averaged_deg,
        record.bound_deg["known"] / np.sqrt(record.recordings),
    )
    right.plot(
        (2, 32),
        (reported.ANGLE_ERROR_TWO_TIMES_DEG, reported.MEAN_ANGLE_ERROR_DEG),
        label="the paper's laboratory",
        **_STAR,
    )
    style.title(right, f"Mean of {_recordings(record.recordings)}", "as the paper has it")
    left.set_ylabel("mean |angle error| (deg)")
    handles, labels = right.get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=3)
    return figure


def _draw_angle_errors(
    ax: Axes, record: Fig5a, errors: Mapping[str, Floats], estimators: Floats, bound: float
) -> None:
    for kind, color, dash in (("delays", style.ARRIVAL, "-"), ("codes", _PAPER, (0, (5, 1.5)))):
        words = "delays calibrated" if kind == "delays" else "code widths too"
        ax.plot(
            record.counts, errors[kind], color=color, ls=dash, marker="o", ms=3,
            label=f"paper's chain, {words}",
        )  # fmt: skip
    at = dict(zip(record.estimators, estimators, strict=True))
    for name, marker in (("joint", "s"), ("photon", "D")):
        ax.plot(
            32 if name == "joint" else 33, at[name], marker=marker, ms=5, ls="none",
            color=_COLORS[name], label=f"{name}, code widths too",
        )  # fmt: skip
    ax.axhline(bound, color=style.QUIET, lw=0.9, ls=":", label="Cram\u00e9r-Rao bound, 32 times")
    ax.set(yscale="log", xlabel="arrival times used, in the order of flight", xlim=(0, 35))
    ax.set_xticks([2, 8, 16, 24, 32])
    ax.grid(axis="y", which="major")


@style.styled
def fig5b_figure(record: Fig5b) -> Figure:
    """Event time against arrival time at several angles (Fig. 5b)."""
    figure = style.new_figure(120, 90, layout="constrained")
    ax = figure.subplots()
    colors = style.time_colormap()(np.linspace(0.0, 0.9, len(record.curves)))
    longest = 0.0
    for curve, color in zip(record.curves, colors, strict=True):
        ax.plot(curve.theory_arrival_ps, curve.theory_event_ps, color=color, lw=1.0)
        ax.plot(
            curve.arrival_ps, curve.event_time_ps, "o", ms=3, color=color,
            label=f"{_degrees(curve.angle_deg, '+.0f')}   rms {curve.time_rms_ps:.2f} ps",
        )  # fmt: skip
        longest = max(longest, float(curve.theory_arrival_ps.max()))
    ax.plot([0, longest], [0, longest], color=style.QUIET, lw=0.8, ls="--")
    ax.annotate("no distortion", (0.93 * longest, 0.95 * longest), color=style.QUIET, ha="right")
    ax.set(xlabel="arrival time $t_a$ (ps, from the first light)", ylabel="event time $t$ (ps)")
    ax.legend(title="paper's chain (dots), exact (lines)", loc="lower right")
    style.title(ax, "Two clocks, one leg")
    return figure


@style.styled
def fig5c_figure(record: Fig5c) -> Figure:
    """Width of the pulse against its angle (Fig. 5c), by both readings of it."""
    figure = style.new_figure(120, 86, layout="constrained")
    ax = figure.subplots()
    ax.plot(
        record.angles_deg, record.theory_frame_ps, color=style.EVENT, lw=1.0,
        label="of a frame, theory $n_p\\tau/(n_p - n_r\\,d{\\cdot}u)$",
    )  # fmt: skip
    ax.errorbar(
        record.angles_deg, record.frame_ps, record.frame_std_ps, fmt="o", ms=3, lw=0.7,
        color=style.EVENT, label="of a frame, measured",
    )  # fmt: skip
    ax.axhline(record.theory_pixel_ps, color=style.ARRIVAL, lw=1.0, label="of a pixel, the laser's")
    ax.errorbar(
        record.angles_deg, record.pixel_ps, record.pixel_std_ps, fmt="s", ms=3, lw=0.7,
        color=style.ARRIVAL, label="of a pixel, measured",
    )  # fmt: skip
    ax.plot(0.0, reported.DECONVOLVED_FWHM_PS, label="the paper's 65 ps", **_STAR)
    ax.set(xlabel="angle \u03b1 (deg)", ylabel="pulse width, FWHM, deconvolved (ps)")
    ax.legend(loc="upper left")
    style.title(ax, "How long the pulse looks")
    return figure


@style.styled
def fig6_figure(record: Fig6) -> Figure:
    """Three legs (Fig. 6): in space, over a picture of the set-up, and by both clocks."""
    figure = style.new_figure(190, 190)
    path, paper = record.paths["joint"], record.paths["paper"]
    space = figure.add_axes((0.03, 0.55, 0.94, 0.37))
    draw_path_3d(path, space, truth=record.scene, others={"paper": paper}, legend=False)
    handles, labels = legend_entries(space, path)
    figure.legend(
        handles, labels, loc="upper left", bbox_to_anchor=(0.04, 0.945), ncols=len(labels)
    )
    figure.text(0.045, 0.965, "Three legs by way of two mirrors", fontsize=12, fontweight="bold")
    photo, photo_camera = rendered_set_up(record.scene)
    over = figure.add_axes((0.045, 0.33, 0.45, 0.19))
    draw_path_on_photo(path, photo, photo_camera, over, truth=record.scene)
    style.title(over, "Over a picture of the set-up", "rendered stand-in")
    times = figure.add_axes((0.085, 0.055, 0.41, 0.22))
    draw_times(path, times, truth=record.scene)
    times.legend(loc="upper left", ncols=2)
    style.title(times, "Two clocks", _before_and_after(record))
    _draw_errors(figure.add_axes((0.66, 0.055, 0.31, 0.465)), record)
    return figure


def visualization1_frames(record: Fig6) -> Iterator[Frame]:
    """The full evolution (Visualization 1): `joint`'s path at every 55 ps, by both clocks."""
    rate = MovieSettings().frames_per_second
    settings = MovieSettings(pace_ps_per_s=rate * reported.BIN_WIDTH_PS)
    return movie_frames(record.paths["joint"], settings=settings)


def _before_and_after(record: Fig6) -> str:
    """Rms error of the time before the correction, and after it by `paper` and `joint`."""
    after = {
        way.method: error
        for way, error in zip(record.ways, record.event_time_rms_ps, strict=True)
        if (way.clock, way.emission_known) == ("codes", True)
    }
    return (
        f"rms {record.before_ps:.0f} \u2192 {after['paper']:.0f} (paper), "
        f"{after['joint']:.2f} ps (joint)"
    )


def _recordings(number: int) -> str:
    return f"{number} recording" + ("" if number == 1 else "s")


def _draw_errors(ax: Axes, record: Fig6) -> None:
    """Position error of every way, the bound, and the paper's own number."""
    ax = style.dress(ax)
    places = np.arange(len(record.ways))[::-1]
    for place, way, error in zip(places, record.ways, record.position_rms_mm, strict=True):
        ax.plot(error, place, "o", ms=5, color=_COLORS[way.method], zorder=5)
        limit = record.bound_mm[way.emission_known]
        low, high = record.chance_mm[way.emission_known]
        ax.barh(place, high - low, height=0.6, left=low, color=style.WASH, zorder=0)
        ax.plot([limit, limit], [place - 0.3, place + 0.3], color=style.QUIET, lw=1.2)
        ax.plot([limit, error], [place, place], color=style.HAIR, lw=1.0, zorder=1)
        small = error < POSITION_RMS_MM
        ax.annotate(
            style.number(float(error), 2), (error, place), (7, 0) if small else (0, 5),
            textcoords="offset points", ha="left" if small else "center",
            va="center" if small else "baseline", fontsize=6.5, zorder=6,
            path_effects=[withStroke(linewidth=2.6, foreground=style.PAPER)],
        )  # fmt: skip
    ax.plot(POSITION_RMS_MM, len(places), **_STAR)
    ax.annotate(
        f"{POSITION_RMS_MM} mm", (POSITION_RMS_MM, len(places)), (7, 0),
        textcoords="offset points", va="center", fontsize=6.5,
    )  # fmt: skip
    ax.set_yticks(
        [*places, len(places)],
        [
            f"{w.method}, {w.clock}\nt0 {'known' if w.emission_known else 'fitted'}"
            for w in record.ways
        ]
        + ["the paper's\nlaboratory"],
    )
    ax.set(xscale="log", xlabel="position error in view, rms (mm)", ylim=(-0.6, len(places) + 0.6))
    ax.grid(axis="x")
    style.title(ax, _recordings(record.recordings), "bar: bound; band: chance")
    ax.text(
        0.98, 0.02,
        "An estimator\nat its bound falls\ninto the band 19\ntimes in 20, below\n"
        "the bar as well\nas above it.",
        transform=ax.transAxes, ha="right", va="bottom", fontsize=6.5, color=style.QUIET,
    )  # fmt: skip


@style.styled
def contributions_figure(record: Contributions) -> Figure:
    """What the error of the paper's chain is made of: one thing changed at a time."""
    figure = style.new_figure(170, 12 + 9 * len(record.words), layout="constrained")
    ax = figure.subplots()
    places = np.arange(len(record.words))[::-1]
    shown = np.maximum(record.position_rms_mm, 1e-3)
    ax.barh(places, shown, height=0.55, color=_PAPER)
    for place, position, time in zip(
        places, record.position_rms_mm, record.event_time_rms_ps, strict=True
    ):
        exact = position < 1e-9
        words = "exact to rounding" if exact else f"{position:.2f} mm, {time:.2f} ps"
        ax.annotate(
            words, (max(position, 1e-3), place), (4, 0),
            textcoords="offset points", va="center", fontsize=7, zorder=6,
            bbox={"fc": style.PAPER, "ec": "none", "pad": 0.8},
        )  # fmt: skip
    ax.axvline(POSITION_RMS_MM, color=style.INK, lw=0.9, ls="--")
    ax.annotate(
        f"the paper: {POSITION_RMS_MM} mm", (POSITION_RMS_MM, places[0] + 0.45), (3, 2),
        textcoords="offset points", fontsize=7,
    )  # fmt: skip
    ax.set_yticks(places, record.words)
    ax.set(xscale="log", xlabel="position error in view, rms (mm)", xlim=(1e-3, 400))
    ax.tick_params(axis="y", length=0)
    style.title(ax, "The paper's chain on three legs")
    return figure


@style.styled
def discussion_figure(record: Discussion) -> Figure:
    """What the discussion hopes for: every error, in its own unit, and its bound."""
    figure = style.new_figure(170, 12 + 8 * len(record.cases), layout="constrained")
    ax = figure.subplots()
    places = np.arange(len(record.cases))[::-1]
    for place, case in zip(places, record.cases, strict=True):
        for name, error in case.errors.items():
            if np.isfinite(error) and error > 0:
                ax.plot(error, place, "o", ms=5, color=_COLORS[name], zorder=5)
        if np.isfinite(case.bound):
            ax.plot([case.bound] * 2, [place - 0.3, place + 0.3], color=style.QUIET, lw=1.4)
    for name, color in _COLORS.items():
        ax.plot([], [], "o", color=color, label=name)
    ax.plot([], [], "|", ms=9, mew=1.4, color=style.QUIET, label="bound")
    ax.set_yticks(places, [f"{c.topic}, {c.name}\n{c.quantity}" for c in record.cases])
    ax.set(xscale="log", xlabel="error, in the unit of its line")
    ax.tick_params(axis="y", length=0)
    ax.grid(axis="x")
    ax.legend(loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=4)
    return figure
