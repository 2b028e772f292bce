"""The pixels' histograms, small enough to travel inside a page.

Takes Histograms and Pulses, gives one compressed block: for a pixel with a pulse the codes around
it at their true edges, for any other the whole range in a few dozen bins, until a budget of bytes
is spent (pixels with pulses first).
"""

from __future__ import annotations

import base64
import gzip
from typing import TYPE_CHECKING

import numpy as np

from lightflight.view.types import Floats, Json, Whole

if TYPE_CHECKING:
    from lightflight import Histograms, Pulses, TimingCalibration


BUDGET_BYTES = 9_000_000
"""Raw bytes of histograms in one page; they shrink to a third or less."""

WINDOW_STD = 6.0
"""Half-width of the window around a pulse, in its standard deviations."""

COARSE_BINS = 48
"""Bins of a pixel without a pulse."""

_CHUNK = 2048
_BYTES_PER_BIN = 6


def histogram_blob(
    hist: Histograms, *, pulses: Pulses | None = None, timing: TimingCalibration | None = None
) -> Json:
    """Index and compressed counts of the pixels' histograms.

    The block holds the widths of all bins, pixel after pixel in the order of the index (uint16,
    in units of `width_unit`), then the counts of all bins (uint32, or float32 for scaled
    intensities). Bins of a pixel touch; `start` is the lower edge of its first.

    Parameters
    ----------
    hist : Histograms
        The recording.
    pulses : Pulses, optional
        Pulses fitted to it.
    timing : TimingCalibration, optional
        The calibration of its clock.

    Returns
    -------
    dict with row, col, n (bins), start, fit (delay, std, photons, background per unit of time;
    NaN without a pulse), unit of time, and the block; pixels that found no room are counted in
    `left_out`.
    """
    from lightflight.timing.pulses.pile_up import pile_up_of

    rows, cols = hist.shape
    strongest = _strongest_pulses(pulses, rows, cols)
    # Pulses tell the photons that came; beside the counts stand those that were counted.
    strongest[:, 2:] /= pile_up_of(hist).scale[:, np.newaxis]
    order = _priority(hist, strongest)
    entries: list[tuple[int, Floats]] = []
    spent = 0
    for start in range(0, len(order), _CHUNK):
        # Chunk by chunk, so that a large camera's edges are never all in memory.
        if spent > BUDGET_BYTES:
            break
        for pixel, bins in _blocks(hist, timing, order[start : start + _CHUNK], strongest):
            spent += _BYTES_PER_BIN * bins.shape[1]
            if spent > BUDGET_BYTES:
                break
            entries.append((pixel, bins))
    return _finish(hist, timing, entries, strongest, len(order) - len(entries))


def _strongest_pulses(pulses: Pulses | None, rows: int, cols: int) -> Floats:
    """(pixels, 4): delay, std, photons, background of the strongest pulse; NaN without one."""
    best = np.full((rows * cols, 4), np.nan)
    if pulses is None:
        return best
    use = np.flatnonzero(np.isfinite(pulses.delay_ps) & np.isfinite(pulses.photons))
    # Ascending: of several pulses in a pixel the strongest is written last.
    use = use[np.argsort(pulses.photons[use], kind="stable")]
    pixel = np.asarray(pulses.row, dtype=np.int64)[use] * cols + np.asarray(pulses.col)[use]
    columns = (pulses.delay_ps, pulses.std_ps, pulses.photons, pulses.background_per_ps)
    best[pixel] = np.stack([np.asarray(c, dtype=float)[use] for c in columns], axis=1)
    return best


def _priority(hist: Histograms, strongest: Floats) -> Whole:
    """Pixels, brightest pulse first, then by counts."""
    photons = np.asarray(hist.photons, dtype=float).ravel()
    with_pulse = np.isfinite(strongest[:, 0])
    # Negative for all without a pulse, so that they come after; the brighter the sooner.
    key = np.where(with_pulse, strongest[:, 2], -1.0 / (1.0 + photons))
    return np.argsort(-np.nan_to_num(key, nan=-1.0), kind="stable")


def _blocks(
    hist: Histograms, timing: TimingCalibration | None, pixels: Whole, strongest: Floats
) -> list[tuple[int, Floats]]:
    from lightflight.timing.pulses.fits import clock_of

    clock = clock_of(hist, timing)
    rows, cols = np.divmod(pixels, hist.shape[1])
    lower, upper = clock.intervals(rows, cols)
    lower, upper = (np.broadcast_to(a, (len(pixels), hist.n_codes)) for a in (lower, upper))
    out = []
    for k, pixel in enumerate(pixels):
        counts = np.asarray(hist.counts[rows[k], cols[k]], dtype=float)
        fit = strongest[pixel]
        bins = (
            _window(lower[k], upper[k], counts, fit, float(clock.period))
            if np.isfinite(fit[0])
            else _coarse(lower[k], upper[k], counts)
        )
        out.append((int(pixel), bins))
    return out


def _window(lower: Floats, upper: Floats, counts: Floats, fit: Floats, period: float) -> Floats:
    """(3, n): lower edges, widths, counts of the codes near a pulse, unfolded around it."""
    delay, std = float(fit[0]), max(float(fit[1]), 1e-9)
    if np.isfinite(period):
        turn = period * np.rint(((lower + upper) / 2 - delay) / period)
        lower, upper = lower - turn, upper - turn
    half = max(WINDOW_STD * std, 8.0 * float(np.median(upper - lower)))
    near = np.flatnonzero((upper > delay - half) & (lower < delay + half) & (upper > lower))
    near = near[np.argsort(lower[near])]
    return np.stack((lower[near], (upper - lower)[near], counts[near]))


def _coarse(lower: Floats, upper: Floats, counts: Floats) -> Floats:
    """(3, n): the whole range in `COARSE_BINS` bins of whole codes."""
    live = np.flatnonzero(upper > lower)
    live = live[np.argsort(lower[live])]
    groups = np.array_split(live, min(COARSE_BINS, max(len(live), 1)))
    groups = [g for g in groups if len(g)]
    if not groups:
        return np.zeros((3, 0))
    edges = np.array([lower[g[0]] for g in groups])
    widths = np.array([upper[g[-1]] for g in groups]) - edges
    return np.stack((edges, widths, [counts[g].sum() for g in groups]))


def _finish(
    hist: Histograms,
    timing: TimingCalibration | None,
    entries: list[tuple[int, Floats]],
    strongest: Floats,
    left_out: int,
) -> Json:
    from lightflight.view.page.packing import packed

    pixel = np.array([e[0] for e in entries], dtype=np.int64)
    row, col = np.divmod(pixel, hist.shape[1])
    every = np.concatenate([e[1] for e in entries], axis=1) if entries else np.zeros((3, 0))
    unit = max(float(every[1].max(initial=0.0)) / 65535.0, 1e-12)
    # Scaled intensities are no whole numbers.
    kind = "u4" if hist.poisson else "f4"
    raw = np.rint(every[1] / unit).astype("<u2").tobytes() + every[2].astype(f"<{kind}").tobytes()
    known = timing is not None or hist.bin_width_ps is not None
    return {
        "row": packed(row, "u2"),
        "col": packed(col, "u2"),
        "n": packed([e[1].shape[1] for e in entries], "u2"),
        "start": packed([e[1][0, 0] if e[1].size else 0.0 for e in entries], "f8"),
        "fit": packed(strongest[pixel], "f4"),
        "total": packed(np.asarray(hist.photons, dtype=float)[row, col], "f4"),
        "unit": "ps" if known else "codes",
        "width_unit": unit,
        "counts_kind": kind,
        "left_out": left_out,
        "gzip": base64.b64encode(gzip.compress(raw, 6, mtime=0)).decode("ascii"),
    }
