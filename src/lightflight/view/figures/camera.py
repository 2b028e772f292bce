"""What the camera saw: its picture in (x, y, t_a) (paper Fig. 2c) and single pixels (Fig. 2b).

Takes Arrivals, Histograms and Pulses, gives Axes or a Figure.
"""

from __future__ import annotations

import textwrap
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import StepPatch
from matplotlib.patheffects import withStroke
from numpy.typing import NDArray

from lightflight import flags as fl
from lightflight.path.trace import trace_from_path
from lightflight.view import style
from lightflight.view.types import Floats, Marks, Whole

if TYPE_CHECKING:
    from lightflight import Arrivals, Camera, Histograms, LightPath, Pulses, TimingCalibration


FIG_2B_CASES: tuple[tuple[str, int], ...] = (
    ("too narrow", fl.TOO_NARROW),
    ("too wide", fl.TOO_WIDE),
    ("effective", 0),
    ("abnormal count", fl.ABNORMAL_COUNT | fl.SCREAMING | fl.SATURATED),
)
"""The paper's four kinds of pixel, and the flags that tell them."""


def unfolded_arrivals(arrivals: Arrivals) -> Floats:
    """(n,), arrival times with the laser period unfolded so that one flight is in one piece."""
    times = np.asarray(arrivals.arrival_ps, dtype=float)
    period = getattr(arrivals, "laser_period_ps", None)
    use = np.isfinite(times) & fl.is_usable(arrivals.flags)
    # Without a period nothing can be folded.
    if period is None or not use.any():
        return times.copy()
    # The cut goes into the longest silence of the period.
    folded = np.sort(np.mod(times[use], period))
    silence = np.diff(np.append(folded, folded[0] + period))
    start = folded[(int(np.argmax(silence)) + 1) % len(folded)] - 0.5 * silence.max()
    unfolded: Floats = start + np.mod(times - start, period)
    return unfolded


@style.styled
def draw_camera_picture(
    arrivals: Arrivals, ax: Axes | None = None, *, path: LightPath | None = None, unit: str = "ps"
) -> Axes:
    """Arrival time by pixel (paper, Fig. 2c), with the legs of a path laid over it.

    Pixels without a pulse stay blank, pixels that were left out carry a cross.

    Parameters
    ----------
    arrivals : Arrivals
        Arrival times of its pulses.
    ax : Axes, optional
        Where to draw; None makes a figure of its own.
    path : LightPath, optional
        Path whose legs to draw.
    unit : str, optional
        Of the arrival times ("codes" where the width of a code is unknown).

    Returns
    -------
    Axes
        The axes drawn on.
    """
    ax = style.axes_or_new(ax, 95, 80)
    rows, cols = arrivals.shape
    times = unfolded_arrivals(arrivals)
    use = fl.is_usable(arrivals.flags) & np.isfinite(times)
    picture = np.full((rows, cols), np.nan)
    # Of several pulses in a pixel the brightest is written last, and stays.
    order = np.argsort(np.nan_to_num(arrivals.photons))
    order = order[use[order]]
    start = times[use].min() if use.any() else 0.0
    picture[arrivals.row[order], arrivals.col[order]] = times[order] - start
    ax.set_facecolor(style.WASH)
    image = ax.imshow(picture, cmap=style.time_colormap())
    _draw_left_out(ax, arrivals, use)
    if path is not None:
        draw_legs_on_picture(ax, path)
    ax.set(xlim=(-0.5, cols - 0.5), ylim=(rows - 0.5, -0.5), xlabel="column", ylabel="row")
    if use.any():
        style.colorbar(ax, image, f"arrival time $t_a$ \u2212 first ({unit})")
    return ax


def _draw_left_out(ax: Axes, arrivals: Arrivals, use: Marks) -> None:
    # Dark pixels were not left out: there was nothing in them.
    silent = np.uint32(fl.NO_PHOTONS | fl.NO_PULSE | fl.TOO_FEW)
    out = ~use & ((np.asarray(arrivals.flags, dtype=np.uint32) & silent) == 0)
    if out.any():
        size = max(1.2, 90.0 / max(arrivals.shape))
        ax.plot(
            arrivals.col[out], arrivals.row[out], "x", color="#9aa2ae", ms=size, mew=0.7,
            label=f"left out ({int(out.sum())})", zorder=2,
        )  # fmt: skip
        ax.legend(
            loc="lower right", bbox_to_anchor=(1.0, 1.0), borderaxespad=0.2, borderpad=0.2,
            handlelength=0.8, handletextpad=0.3, frameon=False,
        )  # fmt: skip


def draw_legs_on_picture(ax: Axes, path: LightPath, *, camera: Camera | None = None) -> None:
    """The legs of a path in the pixels of its camera, with an arrow along the flight."""
    camera = path.camera if camera is None else camera
    trace = trace_from_path(path, camera=camera)
    halo = [withStroke(linewidth=2.6, foreground=style.PAPER)]
    for leg in np.unique(trace.leg):
        seen = (trace.leg == leg) & trace.in_view
        if seen.sum() < 2:
            continue
        row, col = camera.pixels_from_points(trace.points_mm[seen])
        ax.plot(col, row, color=style.EVENT, lw=1.1, zorder=5, path_effects=halo)
        k = int(0.55 * (len(row) - 1))
        ax.annotate(
            "", (col[k + 1], row[k + 1]), xytext=(col[k], row[k]), zorder=6,
            arrowprops={"arrowstyle": "-|>,head_width=0.28,head_length=0.5",
                        "color": style.EVENT, "lw": 0.8},
        )  # fmt: skip


@style.styled
def draw_pixel_histogram(
    hist: Histograms,
    row: int,
    col: int,
    ax: Axes | None = None,
    *,
    pulses: Pulses | None = None,
    timing: TimingCalibration | None = None,
    window_ps: float | None = None,
    annotate: bool = True,
) -> Axes:
    """Counts of one pixel at their true code edges, with the fitted pulse.

    The curve is what the fit expects in each code: it follows the codes' unequal widths.

    Parameters
    ----------
    hist : Histograms
        The recording.
    row, col : int
        Its pixel, from 0.
    ax : Axes, optional
        Where to draw; None makes a figure of its own.
    pulses : Pulses, optional
        Pulses of this recording; None draws counts alone.
    timing : TimingCalibration, optional
        Calibration the pulses were fitted with.
    window_ps : float, optional
        Width of the time window around the pulse; None chooses, inf shows everything.
    annotate : bool, optional
        False leaves out the words about pixel and fit.

    Returns
    -------
    Axes
        The axes drawn on.

    Raises
    ------
    IndexError
        For a pixel outside the camera.
    """
    rows, cols = hist.shape
    if not (0 <= row < rows and 0 <= col < cols):
        raise IndexError(f"there is no pixel ({row}, {col}): the camera has {rows} x {cols}")
    ax = style.axes_or_new(ax, 85, 60)
    # Edges by the clock the pulses were fitted with: nominal ones would put the fit beside its
    # counts.
    lower, upper, period = _pixel_intervals(hist, row, col, timing)
    fits = _pixel_pulses(pulses, row, col)
    counts = np.asarray(hist.counts[row, col], dtype=float)
    middle = _window_middle(counts, (lower, upper), period, fits, window_ps)
    seen = _share_counted(hist, row, col, lower, upper)
    lower, upper, order = _unfolded(lower, upper, middle, period)
    counts = counts[order]
    # One outline, with nothing between codes: a bar each takes minutes for 100,000 of them.
    edges = np.stack((lower, upper), axis=1).ravel()
    heights = np.zeros(max(len(edges) - 1, 0))
    heights[::2] = counts
    if len(heights):
        look: Any = {"fill": True, "color": "#b7c4dc", "lw": 0, "zorder": 2}
        _draw_steps(ax, heights, edges, **look, baseline=0, label="counts")
    if pulses is not None and len(fits):
        sampled = pulses.method == "least_squares" and hist.poisson
        expected = _expected_counts(lower, upper, period, fits, sampled=sampled) * seen[order]
        edges = np.append(lower, upper[-1])
        look = {"fill": False, "color": style.ARRIVAL, "lw": 1.1, "zorder": 4}
        _draw_steps(ax, expected, edges, **look, baseline=None, label="fit")
        _draw_centers(ax, fits, middle, period)
    unit = "ps" if timing is not None or hist.bin_width_ps is not None else "codes"
    half = _half_window(fits, lower, upper, window_ps)
    inside = (upper > middle - half) & (lower < middle + half)
    top = counts[inside].max() if inside.any() else 1.0
    ax.set(xlim=(middle - half, middle + half), ylim=(0, 1.16 * max(float(top), 1.0)))
    ax.set(xlabel=f"delay after the laser sync ({unit})", ylabel="counts per code")
    if annotate:
        _annotate_pixel(ax, row, col, fits, unit)
    return ax


def _draw_steps(ax: Axes, values: Floats, edges: Floats, **look: Any) -> None:
    """Steps as `Axes.stairs` draws them, whose limits somebody else sets: they take seconds."""
    ax.add_artist(StepPatch(values, edges, **look))


def _unfolded(
    lower: Floats, upper: Floats, middle: float, period: float
) -> tuple[Floats, Floats, Whole]:
    """Live codes in ascending time within half a period of `middle`, and their order."""
    if np.isfinite(period):
        shift = period * np.rint(((lower + upper) / 2 - middle) / period)
        lower, upper = lower - shift, upper - shift
    order = np.argsort(lower)
    order = order[upper[order] > lower[order]]
    return lower[order], upper[order], order


def _pixel_intervals(
    hist: Histograms, row: int, col: int, timing: TimingCalibration | None
) -> tuple[Floats, Floats, float]:
    from lightflight.timing.pulses.fits import clock_of

    clock = clock_of(hist, timing)
    lower, upper = clock.intervals(np.array([row]), np.array([col]))
    return lower[0].copy(), upper[0].copy(), float(clock.period)


def _share_counted(hist: Histograms, row: int, col: int, lower: Floats, upper: Floats) -> Floats:
    """(codes,), counts per photon that came: pulses tell those, the figure shows counts."""
    from lightflight.timing.pulses.pile_up import open_share_of

    intervals = (lower[np.newaxis], upper[np.newaxis])
    share = open_share_of(hist, np.array([row]), np.array([col]), intervals)[0]
    return np.broadcast_to(share, lower.shape)


def _pixel_pulses(pulses: Pulses | None, row: int, col: int) -> NDArray[np.float64]:
    """Pulses of this pixel: (n, 6), delay, its error, std, photons, background, flags."""
    if pulses is None:
        return np.zeros((0, 6))
    mine = np.flatnonzero((pulses.row == row) & (pulses.col == col) & np.isfinite(pulses.delay_ps))
    error = np.sqrt(np.maximum(pulses.covariance[mine, 0, 0], 0.0))
    columns = (
        pulses.delay_ps[mine], error, pulses.std_ps[mine], pulses.photons[mine],
        pulses.background_per_ps[mine], pulses.flags[mine],
    )  # fmt: skip
    return np.stack([np.asarray(c, dtype=float) for c in columns], axis=1)


def _window_middle(
    counts: Floats,
    intervals: tuple[Floats, Floats],
    period: float,
    fits: Floats,
    window_ps: float | None,
) -> float:
    """Where the window is laid: at the pulse, else at the fullest code, or about everything."""
    if len(fits):
        return float(fits[np.argmax(fits[:, 3]), 0])
    lower, upper = intervals
    live = upper > lower
    if window_ps is not None and np.isfinite(window_ps):
        top = int(np.argmax(np.where(live, counts, -1.0)))
        return 0.5 * float(lower[top] + upper[top])
    if np.isfinite(period):
        return 0.5 * period
    return 0.5 * float(lower[live].min() + upper[live].max())


def _half_window(fits: Floats, lower: Floats, upper: Floats, window_ps: float | None) -> float:
    whole = 0.5 * float(upper.max() - lower.min())
    if window_ps is not None:
        return min(0.5 * window_ps, whole)
    if len(fits):
        width = float(np.median(upper - lower))
        # Nine deviations show the foot of the pulse; a narrow one still needs a dozen codes to be a
        # shape.
        return min(max(9.0 * float(fits[:, 2].max()), 12.0 * width), whole)
    return whole


def _expected_counts(
    lower: Floats, upper: Floats, period: float, fits: Floats, *, sampled: bool
) -> Floats:
    """Expected counts per code of the fitted pulses and their background.

    Parameters
    ----------
    sampled : bool
        True: the Gaussian at the codes' middles, as least squares fit it; else its integral.
    """
    from scipy.special import ndtr

    expected = np.nan_to_num(fits[0, 4]) * (upper - lower)
    # Light that overruns the period stands at its other end.
    turns = (-period, 0.0, period) if np.isfinite(period) else (0.0,)
    for delay, _, std, photons, *_ in fits:
        for turn in turns:
            z_low, z_high = (lower - delay - turn) / std, (upper - delay - turn) / std
            if sampled:
                z_middle = 0.5 * (z_low + z_high)
                share = (z_high - z_low) * np.exp(-0.5 * z_middle**2) / np.sqrt(2.0 * np.pi)
            else:
                share = ndtr(z_high) - ndtr(z_low)
            expected = expected + photons * share
    return np.asarray(expected)


def _draw_centers(ax: Axes, fits: Floats, middle: float, period: float) -> None:
    for delay, error, *_ in fits:
        turn = period * np.rint((delay - middle) / period) if np.isfinite(period) else 0.0
        ax.axvline(delay - turn, color=style.EVENT, lw=0.9, zorder=3)
        if np.isfinite(error):
            ax.axvspan(
                delay - turn - error, delay - turn + error, color=style.EVENT, alpha=0.3, lw=0
            )


_LETTERS = 24
"""Of a line of words in a histogram's corner."""


def _annotate_pixel(ax: Axes, row: int, col: int, fits: Floats, unit: str) -> None:
    lines = [f"row {row}, column {col}"]
    if len(fits):
        delay, error, std, photons, _, flags = fits[np.argmax(fits[:, 3])]
        # Two digits of the error, and as many places of the value.
        places = max(0, 1 - int(np.floor(np.log10(error)))) if error > 0 else 1
        lines += [
            f"{delay:.{places}f} \u00b1 {error:.{places}f} {unit}",
            f"FWHM {style.number(2.3548 * std, 3)} {unit}",
            f"{style.number(photons, 3)} photons",
        ]
        names = ", ".join(name.replace("_", " ") for name in fl.names_from_flags(int(flags)))
        lines += textwrap.wrap(names, _LETTERS)
    ax.text(
        0.02, 0.97, "\n".join(lines), transform=ax.transAxes, ha="left", va="top", fontsize=6.5,
        linespacing=1.35,
    )  # fmt: skip
    # The counts stay below the words.
    figure = ax.get_figure(root=True)
    assert figure is not None
    height = ax.get_window_extent().height / figure.dpi * 72.0
    taken = min(0.7, (len(lines) * 6.5 * 1.35 + 4.0) / height)
    ax.set_ylim(top=ax.get_ylim()[1] / 1.16 / (1.0 - taken))


@style.styled
def pixel_cases_figure(
    hist: Histograms, pulses: Pulses, *, timing: TimingCalibration | None = None
) -> Figure:
    """The four kinds of pixel of the paper's Fig. 2(b), one histogram of each.

    A kind that this recording does not hold is said to be absent.

    Parameters
    ----------
    hist : Histograms
        The recording.
    pulses : Pulses
        Pulses fitted to it.
    timing : TimingCalibration, optional
        The calibration of its clock.

    Returns
    -------
    Figure
        The page, to be saved or shown.
    """
    figure = style.new_figure(170, 115, layout="constrained")
    axes = figure.subplots(2, 2).ravel()
    for number, (ax, (name, bits)) in enumerate(zip(axes, FIG_2B_CASES, strict=True), start=1):
        pixel = pixel_of_case(pulses, bits)
        if pixel is None:
            style.message(ax, f"no pixel is\n{name}")
        else:
            draw_pixel_histogram(hist, *pixel, ax, pulses=pulses, timing=timing)
        kept = "kept" if bits == 0 else "left out"
        style.title(ax, f"{number}  {name}", kept)
    return figure


def pixel_of_case(pulses: Pulses, bits: int) -> tuple[int, int] | None:
    """A bright pixel of a kind, brighter than four of five; None where there is none."""
    words = np.asarray(pulses.flags, dtype=np.uint32)
    of_kind = fl.is_usable(words) if bits == 0 else (words & np.uint32(bits)) != 0
    of_kind &= np.isfinite(pulses.photons)
    if not of_kind.any():
        return None
    candidates = np.flatnonzero(of_kind)
    photons = pulses.photons[candidates]
    # Bright enough to show a shape, without being an extreme.
    wanted = np.percentile(photons, 80)
    k = candidates[np.argmin(np.abs(photons - wanted))]
    return int(pulses.row[k]), int(pulses.col[k])
