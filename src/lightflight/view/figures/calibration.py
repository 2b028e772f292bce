"""The camera's clock in pictures: gain, code phases, delays, response, bad pixels with reasons.

Takes a TimingCalibration, gives Axes or a Figure.
"""

from __future__ import annotations

import textwrap
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import ArrayLike

from lightflight import flags as fl
from lightflight.units import FWHM_PER_STD
from lightflight.view import style
from lightflight.view.types import Floats, Marks

if TYPE_CHECKING:
    from lightflight import TimingCalibration


_REASON_MARKS: tuple[tuple[str, str], ...] = (
    ("x", style.EVENT),
    ("s", style.ARRIVAL),
    ("^", "#8c6bb1"),
    ("o", "#a6861a"),
    ("+", style.INK),
    ("D", "#5f9ea0"),
    ("v", "#667080"),
)


def good_pixels(timing: TimingCalibration) -> Marks:
    """(rows, cols), True where no flag keeps the pixel out."""
    return np.asarray(fl.is_usable(timing.flags))


def _blank_bad(timing: TimingCalibration, values: ArrayLike) -> Floats:
    return np.where(good_pixels(timing), np.asarray(values, dtype=float), np.nan)


def _signed_map(ax: Axes, values: Floats, label: str) -> None:
    """A map about 0; grey where NaN. A hundredth of the pixels may leave the scale."""
    limit = style.robust_limit(values, percentile=99.0, floor=1e-3)
    ax.set_facecolor("#e4e7ec")
    image = ax.imshow(values, cmap=style.signed_colormap(), vmin=-limit, vmax=limit)
    ax.set(xlabel="column", ylabel="row")
    style.colorbar(ax, image, label, extend="both")


@style.styled
def draw_gain_map(timing: TimingCalibration, ax: Axes | None = None) -> Axes:
    """Width of a code in each pixel against the array's mean, per cent; grey: bad pixels.

    Parameters
    ----------
    timing : TimingCalibration
        The calibration.
    ax : Axes, optional
        Where to draw; None makes a figure of its own.

    Returns
    -------
    Axes
        The axes drawn on.
    """
    ax = style.axes_or_new(ax, 85, 75)
    gain = _blank_bad(timing, timing.gain)
    deviation = 100.0 * (gain - 1.0)
    _signed_map(ax, deviation, "gain \u2212 mean (%)")
    style.title(ax, "Gain", f"{style.number(float(np.nanstd(deviation)), 2)} % rms", stacked=True)
    return ax


@style.styled
def draw_phases(timing: TimingCalibration, ax: Axes | None = None) -> Axes:
    """Relative widths of the codes by phase (code modulo 8): mean, pixel spread, single pixels.

    Parameters
    ----------
    timing : TimingCalibration
        The calibration.
    ax : Axes, optional
        Where to draw; None makes a figure of its own.

    Returns
    -------
    Axes
        The axes drawn on.
    """
    ax = style.axes_or_new(ax, 85, 70)
    phases = np.asarray(timing.phases, dtype=float)[good_pixels(timing)]
    # Pixels without light have no phases.
    known = np.isfinite(phases).all(axis=1)
    phases, errors = phases[known], timing.phase_std[good_pixels(timing)][known]
    n_phases = timing.phases.shape[2]
    if len(phases) == 0 or n_phases < 2 or np.all(phases == 1.0):
        return style.message(ax, "code widths were not measured")
    k = np.arange(n_phases)
    mean, spread = phases.mean(axis=0), phases.std(axis=0)
    if n_phases <= 64:
        shown = phases[:: max(1, len(phases) // 120)]
        # Side by side, or 120 pixels of one phase would lie on one another.
        jitter = np.linspace(-0.27, 0.27, len(shown))
        ax.plot(
            (k + jitter[:, np.newaxis]).ravel(), shown.ravel(), ".", ms=1.3, color="#9fb0d0",
            zorder=1, rasterized=len(shown) * n_phases > 4000,
        )  # fmt: skip
        ax.bar(k, 2 * spread, 0.62, mean - spread, color=style.ARRIVAL, alpha=0.16, zorder=2)
        ax.hlines(mean, k - 0.34, k + 0.34, color=style.ARRIVAL, lw=2.0, zorder=3)
        ax.set_xticks(k[:: max(1, n_phases // 16)])
    else:
        ax.fill_between(k, mean - spread, mean + spread, color=style.ARRIVAL, alpha=0.2, lw=0)
        ax.plot(k, mean, color=style.ARRIVAL, lw=0.9)
    ax.axhline(1.0, color=style.QUIET, lw=0.6, zorder=0)
    ax.set(xlabel=f"code modulo {n_phases}", ylabel="relative code width")
    # Few photons draw widths to the mean: their own spread is that seen and their errors.
    error = float(np.sqrt(np.mean(errors**2)))
    own = float(np.hypot(np.sqrt(np.mean(spread**2)), error))
    note = f"pixels differ by {100 * own:.1f} % rms, known to {100 * error:.1f} %"
    mean_of, spread_of = ("bar", "box") if n_phases <= 64 else ("line", "band")
    words = f"{mean_of}: mean; {spread_of}: \u00b11\u03c3 of the pixels"
    style.title(ax, f"{_count_word(n_phases)} phases", f"{note}\n{words}", stacked=True)
    return ax


def _count_word(n: int) -> str:
    return {2: "Two", 4: "Four", 8: "Eight", 16: "Sixteen"}.get(n, f"{n}")


@style.styled
def draw_delay_map(timing: TimingCalibration, ax: Axes | None = None) -> Axes:
    """Delay of each pixel against the array's median, ps; grey: bad pixels.

    Parameters
    ----------
    timing : TimingCalibration
        The calibration.
    ax : Axes, optional
        Where to draw; None makes a figure of its own.

    Returns
    -------
    Axes
        The axes drawn on.
    """
    ax = style.axes_or_new(ax, 85, 75)
    delay = _blank_bad(timing, timing.skew_ps)
    if not np.isfinite(delay).any() or float(np.nanstd(delay)) == 0.0:
        style.title(ax, "Delay", "not measured", stacked=True)
        return style.message(ax, "no flat recording:\nthe delays were not measured")
    centred = delay - np.nanmedian(delay)
    _signed_map(ax, centred, "delay \u2212 median (ps)")
    error = float(np.nanmedian(_blank_bad(timing, timing.skew_std_ps)))
    spread = style.number(float(np.nanstd(centred)), 3)
    note = f"{spread} ps rms, known to {style.number(error, 2)} ps"
    style.title(ax, "Delay", note, stacked=True)
    return ax


@style.styled
def draw_response_widths(timing: TimingCalibration, ax: Axes | None = None) -> Axes:
    """Histogram of the width of the flat's pulse over the good pixels, FWHM in ps.

    Parameters
    ----------
    timing : TimingCalibration
        The calibration.
    ax : Axes, optional
        Where to draw; None makes a figure of its own.

    Returns
    -------
    Axes
        The axes drawn on.
    """
    ax = style.axes_or_new(ax, 85, 60)
    width = FWHM_PER_STD * _blank_bad(timing, timing.response_std_ps)
    width = width[np.isfinite(width)]
    if width.size == 0:
        style.title(ax, "Response", "not measured", stacked=True)
        return style.message(ax, "no flat recording:\nthe response was not measured")
    # A few wild pixels must not squeeze the rest into one bar; they are shown in the last ones.
    low, high = np.percentile(width, [0.5, 99.5])
    pad = max(0.08 * (high - low), 1e-3 * high)
    edges = np.linspace(low - pad, high + pad, min(40, max(8, width.size // 20)) + 1)
    clipped = np.clip(width, edges[0], edges[-1])
    ax.hist(clipped, edges.tolist(), color="#a9b9d6", edgecolor=style.PAPER, linewidth=0.4)
    ax.axvline(float(np.median(width)), color=style.ARRIVAL, lw=1.2)
    ax.set(xlabel="FWHM of the flat's pulse (ps)", ylabel="pixels")
    style.title(
        ax, "Response", f"median {style.number(float(np.median(width)), 3)} ps", stacked=True
    )
    return ax


@style.styled
def draw_bad_pixels(flagged: Any, ax: Axes | None = None) -> Axes:
    """Flagged pixels with their reasons; a mark per reason, a count per reason.

    `flagged` is a TimingCalibration, or anything with `flags` (rows, cols) uint32.

    Parameters
    ----------
    flagged : object
        Anything with `flags`, shape (rows, cols).
    ax : Axes, optional
        Where to draw; None makes a figure of its own.

    Returns
    -------
    Axes
        The axes drawn on.
    """
    ax = style.axes_or_new(ax, 85, 75)
    words = np.asarray(flagged.flags, dtype=np.uint32)
    rows, cols = words.shape
    ax.set_facecolor(style.WASH)
    ax.set(xlim=(-0.5, cols - 0.5), ylim=(rows - 0.5, -0.5), xlabel="column", ylabel="row")
    ax.set_aspect("equal")
    counted = fl.count_flags(words)
    size = max(1.6, 95.0 / max(rows, cols))
    note = ""
    reasons = sorted(counted, key=lambda name: counted[name])[-len(_REASON_MARKS) :]
    for name, (mark, color) in zip(reversed(reasons), _REASON_MARKS, strict=False):
        bit = next(flag.value for flag in fl.REGISTRY if flag.name == name)
        at = np.argwhere(words & np.uint32(bit))
        # A flag of nearly every pixel says something of the recording: its marks would bury the
        # others.
        if len(at) > 0.9 * words.size:
            ax.plot([], [], " ", label=f"{name.replace('_', ' ')}: {len(at)} *")
            note += "  (* not drawn)"
            continue
        hollow: dict[str, Any] = {"mfc": "none"} if mark not in "x+" else {}
        ax.plot(
            at[:, 1], at[:, 0], mark, color=color, ms=size, mew=0.8, ls="none",
            label=f"{name.replace('_', ' ')}: {len(at)}", **hollow,
        )  # fmt: skip
    n_bad = int((~fl.is_usable(words)).sum())
    style.title(ax, "Pixels", f"{words.size - n_bad} of {words.size} usable{note}", stacked=True)
    if reasons:
        ax.legend(
            loc="upper left", bbox_to_anchor=(1.02, 1.0), handletextpad=0.4, borderaxespad=0.0
        )
    return ax


@style.styled
def calibration_figure(timing: TimingCalibration) -> Figure:
    """Everything a timing calibration holds on one page (212 x 128 mm).

    Parameters
    ----------
    timing : TimingCalibration
        The calibration.

    Returns
    -------
    Figure
        The page, to be saved or shown.
    """
    page_mm = (212.0, 128.0)
    figure = style.new_figure(*page_mm)
    place = partial(style.axes_in_mm, figure, page_mm)
    draw_gain_map(timing, place(12, 13, 50, 40))
    draw_phases(timing, place(88, 13, 44, 40))
    draw_delay_map(timing, place(146, 13, 50, 40))
    draw_response_widths(timing, place(12, 77, 41, 40))
    draw_bad_pixels(timing, place(82, 77, 40, 40))
    _draw_numbers(timing, place(152, 70, 56, 48))
    return figure


def _draw_numbers(timing: TimingCalibration, ax: Axes) -> None:
    ax.set_axis_off()
    direction = "backwards" if timing.reversed_codes else "forwards"
    period = timing.laser_period_ps
    lines = [
        f"mean code  {timing.bin_width_ps:.3f} ps",
        f"shared scale error  {100 * timing.scale_std:.2f} %",
        "laser period  " + ("unknown" if period is None else f"{period:,.1f} ps"),
        f"codes run {direction}",
    ]
    text = "\n".join(lines)
    for note in timing.notes:
        text += "\n\n" + "\n".join(textwrap.wrap(style.words(note), 42))
    # A clipped sentence is worse than none: the rest is in the record.
    kept = text.split("\n")[:17]
    if len(kept) < len(text.split("\n")):
        kept[-1] += " \u2026"
    ax.text(0.12, 1.0, "\n".join(kept), transform=ax.transAxes, va="top", fontsize=6.5,
            linespacing=1.4)  # fmt: skip
