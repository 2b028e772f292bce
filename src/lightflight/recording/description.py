"""What a recording is, in numbers and sentences, before anything is fitted.

For `lightflight info`, and for anyone who wants to know whether a file is worth more work:
photons, occupancy, hot and silent pixels, whether there is a pulse at all, whether it drifts, and
what is missing to reconstruct a path. The tests are coarse on purpose; `timing` measures.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from lightflight.flags import SCREAMING_OCCUPANCY
from lightflight.recording.counting import histogram
from lightflight.recording.histograms import Histograms
from lightflight.recording.recording import Progress, Recording
from lightflight.recording.stored import largest_count

_STANDS_OUT = 1.5
"""A screaming pixel fires so many times as often as the median one, too: half as much again is no
pixel's share of a lamp."""

_WINDOW_CODES = 8
"""Codes added up before a pulse is looked for: the period of a PF32's non-linearity."""

_CONTRAST = 1.5
_SIGMAS = 6.0
_FEWEST_COUNTS = 5.0
_MAD_SIGMAS = 8.0
_STD_FROM_MAD = 1.4826
_HALF_WIDTH_CODES = 16


@dataclass(frozen=True)
class Description:
    """What `describe_recording` found.

    Attributes
    ----------
    kind : str
        "histograms", "frames" or "events".
    live_codes : (int, int) or None
        First and last code in which pixels that do not scream hold photons; None: none do.
    photons : float
        Photons (scaled intensities: their sum) in all pixels.
    median_photons : float
        Median over pixels.
    occupancy : float or None
        Median over pixels of photons per frame; None where frames are unknown.
    n_screaming : int
        Pixels that fire in most frames; where frames are unknown, those whose counts away from
        their highest codes are over ten times those of the median pixel.
    n_silent : int
        Pixels without a single photon.
    n_saturated : int
        Pixels with a count at the limit of its storage type.
    n_pulse_pixels : int
        Pixels that show a pulse.
    has_pulse : bool
        Whether there is a pulse at all.
    drift_codes : float or None
        Mean code of the pulses in the second half of the frames minus the first; None where the
        frames are unknown or nothing shows a pulse.
    drift_std_codes : float or None
        Photon error of `drift_codes`.
    missing : tuple of str
        What is still needed to reconstruct a path, a sentence each.
    remarks : tuple of str
        What looks unusual, a sentence each.
    """

    kind: str

    live_codes: tuple[int, int] | None

    photons: float

    median_photons: float

    occupancy: float | None

    n_screaming: int

    n_silent: int

    n_saturated: int

    n_pulse_pixels: int

    has_pulse: bool

    drift_codes: float | None

    drift_std_codes: float | None

    missing: tuple[str, ...]

    remarks: tuple[str, ...]


def describe_recording(
    record: Recording | Histograms, *, progress: Progress | None = None
) -> Description:
    """What a recording holds, before anything is fitted.

    Parameters
    ----------
    record : Recording or Histograms
        A recording is counted, in two halves where it knows its frames.
    progress : callable, optional
        As for `recording.histogram`.

    Returns
    -------
    Description
        Numbers, and sentences on what is missing and what looks unusual.

    Raises
    ------
    ValueError
        As `recording.histogram` does.
    """
    halves = _halves(record, progress)
    hist = _sum_of(halves)
    photons = hist.photons.astype(float)
    screaming = pixels_that_scream_in_a_scene(hist, photons)
    silent = photons == 0
    usable = ~screaming & ~silent
    live = _live_codes(hist, usable)
    pulses = _pulse_pixels(hist, live) & usable
    has_pulse = _shows_pulse(pulses, usable)
    drift = _drift_codes(halves, pulses) if has_pulse else None
    occupancy = hist.occupancy
    return Description(
        kind="histograms" if isinstance(record, Histograms) else record.kind,
        live_codes=live,
        photons=float(photons.sum()),
        median_photons=float(np.median(photons)),
        occupancy=None if occupancy is None else float(np.median(occupancy)),
        n_screaming=int(screaming.sum()),
        n_silent=int(silent.sum()),
        n_saturated=_n_saturated(hist),
        n_pulse_pixels=int(pulses.sum()),
        has_pulse=has_pulse,
        drift_codes=None if drift is None else drift[0],
        drift_std_codes=None if drift is None else drift[1],
        missing=_missing(hist, has_pulse),
        remarks=_remarks(hist, photons, drift),
    )


def _halves(record: Recording | Histograms, progress: Progress | None) -> list[Histograms]:
    """Histograms of the first and the second half of the frames, or of all where unknown."""
    knows_frames = isinstance(record, Recording) and (
        record.kind == "frames" or record.frame_starts is not None
    )
    if not knows_frames or record.n_frames is None or record.n_frames < 2:
        return [histogram(record, progress=progress)]
    n_frames, middle = record.n_frames, record.n_frames // 2
    found = []
    for start, end in ((0, middle), (middle, n_frames)):

        def report(done: int, total: int, start: int = start, end: int = end) -> None:
            if progress is not None:
                progress(start + done * (end - start) // max(total, 1), n_frames)

        found.append(histogram(record, frames=(start, end), progress=report))
    return found


def _sum_of(halves: list[Histograms]) -> Histograms:
    """One histogram of two halves."""
    if len(halves) == 1:
        return halves[0]
    first, second = halves
    counts = first.counts.astype(np.uint64) + second.counts
    n_frames = (first.n_frames or 0) + (second.n_frames or 0) or None
    return replace(first, counts=counts, n_frames=n_frames)


def pixels_that_scream_in_a_scene(
    hist: Histograms, photons: NDArray[np.float64]
) -> NDArray[np.bool_]:
    """(rows, cols), by occupancy where it is known, else by darkness against the median pixel.

    Bright is not screaming: on a dark scene the light itself is all there is, and under a lamp
    every pixel fires in most frames.
    """
    if hist.occupancy is not None and hist.no_photon_code is not None:
        # A frame shows the first photon only: p = 1 - exp(-rate).
        rate = -np.log1p(-np.minimum(hist.occupancy, 1.0 - 1e-9))
        stands_out = rate > _STANDS_OUT * np.median(rate)
        return np.asarray((hist.occupancy > SCREAMING_OCCUPANCY) & stands_out)
    dark = photons - np.stack([_near_highest_code(hist, row) for row in range(hist.shape[0])])
    return dark > 10 * max(float(np.median(dark)), _FEWEST_COUNTS)


def _near_highest_code(hist: Histograms, row: int) -> NDArray[np.float64]:
    """(cols,), counts of one row within `_HALF_WIDTH_CODES` of each pixel's highest code."""
    counts = np.where(hist.photon_codes, hist.counts[row], 0).astype(float)
    total = np.zeros((counts.shape[0], counts.shape[1] + 1))
    np.cumsum(counts, axis=1, out=total[:, 1:])
    highest = counts.argmax(axis=1)
    first = np.maximum(highest - _HALF_WIDTH_CODES, 0)
    end = np.minimum(highest + _HALF_WIDTH_CODES + 1, counts.shape[1])
    pixel = np.arange(counts.shape[0])
    near: NDArray[np.float64] = total[pixel, end] - total[pixel, first]
    return near


def _n_saturated(hist: Histograms) -> int:
    """Pixels with a count at the largest that could be stored."""
    if hist.counts.dtype.kind != "u":
        return 0
    cut = hist.counts[..., hist.photon_codes] >= largest_count(hist)
    return int(cut.any(axis=2).sum())


def codes_of_pulses(hist: Histograms) -> tuple[int, int] | None:
    """Between which codes the pixels that show a pulse have it.

    Parameters
    ----------
    hist : Histograms
        The recording.

    Returns
    -------
    (int, int) or None
        First and last code of 98 % of these pixels' highest windows. None: fewer than a hundredth
        of the pixels show one.
    """
    photons = hist.photons.astype(float)
    usable = ~pixels_that_scream_in_a_scene(hist, photons) & (photons > 0)
    live = _live_codes(hist, usable)
    pulses = _pulse_pixels(hist, live) & usable
    if live is None or not _shows_pulse(pulses, usable):
        return None
    windows = _windowed(hist.counts[pulses][:, live[0] : live[1] + 1])
    first, last = np.percentile(windows.argmax(axis=1), [1.0, 99.0])
    end = min(live[0] + int(last) + _WINDOW_CODES - 1, live[1])
    return live[0] + int(first), end


def _shows_pulse(pulses: NDArray[np.bool_], usable: NDArray[np.bool_]) -> bool:
    return bool(pulses.sum() >= max(1, 0.01 * usable.sum()))


def _live_codes(hist: Histograms, usable: NDArray[np.bool_]) -> tuple[int, int] | None:
    """First and last code in which usable pixels hold photons; None where they hold none."""
    per_row = (hist.counts[row][usable[row]].any(axis=0) for row in range(hist.shape[0]))
    held = np.logical_or.reduce(list(per_row)) & hist.photon_codes
    live = np.flatnonzero(held)
    return (int(live[0]), int(live[-1])) if live.size else None


def _pulse_pixels(hist: Histograms, live: tuple[int, int] | None) -> NDArray[np.bool_]:
    """(rows, cols), True where some window stands far above the pixel's median window.

    So does a window that holds most of the pixel's photons: without background the live codes
    are those of the pulse, and no window is without it. Poisson counts must exceed the median by
    half and by six standard deviations, which over a thousand pixels of a thousand codes happens
    by chance less than once in a thousand recordings.
    """
    found = np.zeros(hist.shape, dtype=bool)
    if live is None:
        return found
    for row in range(hist.shape[0]):
        windows = _windowed(hist.counts[row, :, live[0] : live[1] + 1])
        highest, middle = windows.max(axis=1), np.median(windows, axis=1)
        if hist.poisson:
            noise = _SIGMAS * np.sqrt(middle + 1.0)
            limit = np.maximum(_CONTRAST * middle, middle + noise) + _FEWEST_COUNTS
        else:
            mad = np.median(np.abs(windows - middle[:, None]), axis=1)
            # Scaled intensities have no counting error: their own scatter stands for it.
            noise = _MAD_SIGMAS * _STD_FROM_MAD * mad
            limit = np.maximum(_CONTRAST * middle, middle + noise)
        total = hist.counts[row, :, live[0] : live[1] + 1].sum(axis=1, dtype=float)
        fewest = 4 * _FEWEST_COUNTS if hist.poisson else 0.0
        found[row] = (highest > limit) | (highest > np.maximum(0.5 * total, fewest))
    return found


def _windowed(counts: NDArray[np.integer]) -> NDArray[np.float64]:
    """(pixels, windows), sums of `_WINDOW_CODES` neighbours: free of their non-linearity."""
    width = min(_WINDOW_CODES, counts.shape[1])
    total = np.zeros((counts.shape[0], counts.shape[1] + 1))
    np.cumsum(counts, axis=1, out=total[:, 1:])
    windows: NDArray[np.float64] = total[:, width:] - total[:, :-width]
    return windows


def _drift_codes(halves: list[Histograms], pulses: NDArray[np.bool_]) -> tuple[float, float] | None:
    """Shift of the pulses between two halves, photon-weighted mean over pixels, and its error."""
    if len(halves) < 2:
        return None
    first, second = (half.counts[pulses].astype(float) for half in halves)
    absent = halves[0].no_photon_code
    if absent is not None:
        first[:, absent] = second[:, absent] = 0.0
    peak = (first + second).argmax(axis=1)
    code = np.arange(first.shape[1])
    # Background away from the pulse would pull both means to the middle of the gate.
    near = np.abs(code[None] - peak[:, None]) <= _HALF_WIDTH_CODES
    shift = np.zeros(len(peak))
    variance = np.zeros(len(peak))
    for sign, counts in ((-1, first), (1, second)):
        weights = np.where(near, counts, 0.0)
        total = np.maximum(weights.sum(axis=1), 1.0)
        mean = (weights * code).sum(axis=1) / total
        spread = (weights * (code - mean[:, None]) ** 2).sum(axis=1) / total
        shift += sign * mean
        # A twelfth: a time known to one code is spread over it, even where all fell into one.
        variance += (spread + 1.0 / 12.0) / total
    weight = 1.0 / np.maximum(variance, 1e-12)
    return float((weight * shift).sum() / weight.sum()), float(weight.sum() ** -0.5)


# --- sentences --------------------------------------------------------------------------


def _missing(hist: Histograms, has_pulse: bool) -> tuple[str, ...]:
    """What is still needed to reconstruct a path, a sentence each."""
    found = []
    if not has_pulse and hist.counts.any():
        found.append(
            "No pixel shows a pulse: this recording can calibrate codes (code density), it cannot "
            "be reconstructed."
        )
    if hist.bin_width_ps is None:
        found.append("The time per code is unknown: give bin_width_ps.")
    if hist.laser_period_ps is None:
        found.append(
            "The laser period is unknown: give laser_period_ps, unless the recording is one sweep."
        )
    if has_pulse:
        found.append(
            "Camera pose and source position are in no recording: give them in a set-up file."
        )
        if hist.poisson:
            found.append(
                "True code widths and pixel delays are not in it: calibrate with a code-density "
                "and a flat recording."
            )
    return tuple(found)


def _remarks(
    hist: Histograms, photons: NDArray[np.float64], drift: tuple[float, float] | None
) -> tuple[str, ...]:
    """What looks unusual, a sentence each."""
    found = []
    if photons.sum() == 0:
        found.append("There is not a single photon in it.")
    if hist.occupancy is not None and hist.periods_per_frame is not None:
        rate = float(np.median(hist.occupancy)) / hist.periods_per_frame
        if rate > 0.01:
            found.append(
                f"{rate:.1%} of laser periods give a photon: pile-up bends times (above 1 %)."
            )
    if drift is not None and abs(drift[0]) > 5 * drift[1]:
        unit = f" ({drift[0] * hist.bin_width_ps:+.3g} ps)" if hist.bin_width_ps else ""
        found.append(f"Pulses move by {drift[0]:+.3g} codes{unit} from first to second half.")
    if not hist.poisson:
        found.append("Intensities are scaled, not counted: errors come from the scatter.")
    found += [str(note) for note in hist.settings.get("notes", ()) if isinstance(note, str)]
    return tuple(found)
