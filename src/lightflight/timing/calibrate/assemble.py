"""What each recording says of the clock, put into one `TimingCalibration`, step by step."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import replace
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from lightflight import flags
from lightflight.errors import CalibrationError, SuspectDataWarning, UncalibratedWarning
from lightflight.recording.histograms import Histograms
from lightflight.timing.calibrate.code_density import CodeDensityFit, pixel_flags
from lightflight.timing.calibrate.delay_scan import DelayScan, fit_scan
from lightflight.timing.calibrate.delays import FlatDelays, skews_near_median
from lightflight.timing.calibrate.flat_shapes import FlatShape
from lightflight.timing.calibrate.notes import fit_notes
from lightflight.timing.clock.calibration import (
    ASSUMED_GAIN_STD,
    ASSUMED_PHASE_STD,
    ASSUMED_SCALE_STD,
    TimingCalibration,
)
from lightflight.timing.flat_geometry import fit_tilt, tilt_ps

Floats = NDArray[np.float64]
DeadCodes = Literal["absorbed", "lost"]
"""What became of the time of the dead codes."""

_USUALLY_MISSED = 0.05
"""Share of live pixels that even light may miss: a speck of dust, a shaded rim."""
_MOST_MISSED = 0.5
"""... and above which it is no flat: a beam in the picture lights a tenth."""
_SAME_LENGTH = 0.02
"""Of a code: where all codes are told to be so nearly as long as the period, they are made from it.
A counter that stops by chance where the period does has gains that nobody sees."""
_COVERED = "the codes cover the laser period: the widths of each pixel add up to it"
_SCAN_TOLERANCE = 5e-4
"""Relative error of delays that people can set and know."""


def clock_from_code_density(
    code_density: Histograms, fit: CodeDensityFit, *, dead_codes: str | None
) -> TimingCalibration:
    """Code edges of every pixel; delays are not known yet.

    Parameters
    ----------
    code_density : Histograms
        Recording of light that ignores the laser.
    fit : CodeDensityFit
        What `fit_code_density` says of it.
    dead_codes : str or None
        "absorbed", "lost" or None, see `calibrate_timing`.

    Returns
    -------
    TimingCalibration
        Without delays, with notes of what was measured.

    Raises
    ------
    CalibrationError
        If nothing tells how wide a code is.
    """
    good = flags.is_usable(fit.flags)
    if not fit.structured and _covers_the_period(code_density, fit):
        # Each pixel's own widths share out the period; codes are then as wide as stated on average.
        share = (code_density.n_codes / fit.phases.sum(axis=-1))[..., np.newaxis]
        fit = replace(fit, phases=fit.phases * share, phase_std=fit.phase_std * share)
    width, gain_std, scale_std, notes = _widths_ps(code_density, fit, dead_codes, good)
    mean_width = float(width[good].mean())
    nominal = TimingCalibration.nominal(code_density)
    clock = replace(
        nominal,
        laser_period_ps=code_density.laser_period_ps,
        bin_width_ps=mean_width, gain=width / mean_width, gain_std=gain_std, scale_std=scale_std,
        phases=fit.phases, phase_std=fit.phase_std, code_widths=fit.code_widths,
        code_width_std=fit.code_width_std,
        end_code=fit.end_code, end_widths=fit.end_widths, first_live_code=fit.first_live_code,
        first_live_width=fit.first_live_width, misfit_std=fit.misfit_std, flags=fit.flags,
        period_end_seen=fit.period_end_seen and code_density.laser_period_ps is not None,
        notes=(*notes, *fit_notes(code_density, fit, width, gain_std, good)),
    )  # fmt: skip
    return clock


def _covers_the_period(code_density: Histograms, fit: CodeDensityFit) -> bool:
    """Whether the codes, none of which the end of a period cuts, last as long as one."""
    hidden = _hidden_codes(code_density)
    if hidden is None or fit.period_end_seen:
        return False
    return abs(hidden) < (_SAME_LENGTH if fit.structured else 0.5)


def _hidden_codes(code_density: Histograms) -> float | None:
    """Codes by which the laser period is longer than all there are; None where nothing tells."""
    period, width = code_density.laser_period_ps, code_density.bin_width_ps
    return None if period is None or width is None else period / width - code_density.n_codes


def _cut_by_the_period(
    code_density: Histograms, fit: CodeDensityFit, good: NDArray[np.bool_]
) -> float:
    """Codes by which periods end within the last code of pixels, rms, where all codes are one.

    Those of pixels whose codes are longer than most would.
    """
    last = code_density.counts[..., -1].astype(np.float64)
    expected = fit.flux * fit.phases[..., (code_density.n_codes - 1) % fit.n_phases]
    expected = np.maximum(expected * fit.code_widths[-1], 1e-9)
    squared = (last / expected - 1.0) ** 2 - 1.0 / expected
    return float(np.sqrt(max(0.0, float(np.average(squared[good], weights=expected[good])))))


def _widths_ps(
    code_density: Histograms, fit: CodeDensityFit, dead_codes: str | None, good: NDArray[np.bool_]
) -> tuple[Floats, Floats, float, list[str]]:
    """Width of a plateau code per pixel (ps), relative error, shared relative error, notes."""
    period, covered = code_density.laser_period_ps, _covers_the_period(code_density, fit)
    if period is None or not (fit.period_end_seen or covered):
        return _widths_without_end(code_density, fit)
    if covered and not fit.structured:
        each = np.full(fit.flux.shape, period / code_density.n_codes)
        return each, np.zeros(fit.flux.shape), 0.0, [_COVERED]
    cut = _cut_by_the_period(code_density, fit, good) if covered else 0.0
    absorbed, lost = period / fit.codes_absorbed, period / fit.codes_lost
    means = float(absorbed[good].mean()), float(lost[good].mean())
    absorbed_std = np.hypot(fit.absorbed_std, cut) / fit.codes_absorbed
    lost_std = np.hypot(fit.lost_std, cut) / fit.codes_lost
    if covered and not fit.dead_codes:
        return absorbed, absorbed_std, 0.0, [_COVERED]
    if not fit.dead_codes:
        return lost, lost_std, 0.0, [f"mean code {means[1]:.2f} ps; no dead codes"]
    notes = [
        f"mean code {means[0]:.2f} ps if the time of the dead codes is absorbed by the first live "
        f"ones, {means[1]:.2f} ps if it is lost"
    ]
    if dead_codes == "absorbed":
        return absorbed, absorbed_std, 0.0, [*notes, "taken as absorbed"]
    if dead_codes == "lost":
        return lost, lost_std, 0.0, [*notes, "taken as lost"]
    if fit.dead_codes == (code_density.no_photon_code,):
        # Code numbers count time from the start: that of the one code without photons is lost.
        scale_std = abs(means[0] / means[1] - 1.0)
        return lost, lost_std, scale_std, [*notes, "taken as lost, as code numbers say"]
    middle = 0.5 * (absorbed + lost)
    apart = 0.5 * (absorbed - lost) / middle
    scale_std = abs(float(apart[good].mean()))
    std = np.hypot(0.5 * (absorbed_std + lost_std), apart - apart[good].mean())
    notes.append(
        f"which is unknown: the mean is used, with a shared scale error of {100 * scale_std:.2f} % "
        "(a flat at two known delays, or dead_codes=..., removes it)"
    )
    return middle, std, scale_std, notes


def _widths_without_end(
    code_density: Histograms, fit: CodeDensityFit
) -> tuple[Floats, Floats, float, list[str]]:
    """Nominal width where no end of a period is in sight: gains cannot be measured."""
    width = code_density.bin_width_ps
    if width is None:
        raise CalibrationError(
            "the code-density recording shows no end of the laser period and has no bin_width_ps: "
            "give bin_width_ps (or laser_period_ps, where the codes cover the period)"
        )
    gain_std, hidden = ASSUMED_GAIN_STD, _hidden_codes(code_density)
    if hidden is not None:
        # Codes that stop just short of the period: an end in no pixel bounds the gains' spread.
        gain_std = min(gain_std, (abs(hidden) + 1.0) / code_density.n_codes)
    text = (
        "the codes show no end of the laser period, so gains cannot be measured: nominal ones are "
        f"used, which costs {1000 * gain_std:.1f} ps per ns between flat and recording"
    )
    warnings.warn(text, UncalibratedWarning, stacklevel=5)
    image = np.ones(fit.flux.shape)
    return width * image, gain_std * image, min(ASSUMED_SCALE_STD, gain_std), [text]


def clock_without_code_density(flat: Histograms) -> TimingCalibration:
    """Nominal codes with the spread that real ones have, for want of a code-density recording.

    Parameters
    ----------
    flat : Histograms
        Recording whose clock is taken as it states itself.

    Returns
    -------
    TimingCalibration
        Equal codes, all pixels flagged `uncalibrated`; warns of what that costs.
    """
    nominal = TimingCalibration.nominal(flat)
    image = np.zeros(flat.shape)
    text = (
        "no code-density recording: nominal codes stand in, which costs 3-6 ps per pixel and "
        f"{1000 * ASSUMED_GAIN_STD:.1f} ps per ns between flat and recording on a camera like the "
        "PF32 (about 0.1-0.2 deg in a leg's angle)"
    )
    warnings.warn(text, UncalibratedWarning, stacklevel=3)
    return replace(
        nominal, gain_std=image + ASSUMED_GAIN_STD, scale_std=ASSUMED_SCALE_STD,
        phases=np.ones((*flat.shape, 8)), phase_std=np.full((*flat.shape, 8), ASSUMED_PHASE_STD),
        flags=np.full(flat.shape, flags.UNCALIBRATED, dtype=np.uint32),
        notes=(*nominal.notes, text),
    )  # fmt: skip


def with_assumed_delays(clock: TimingCalibration, assumed_skew_std_ps: float) -> TimingCalibration:
    """The clock with unknown delays, for want of a flat recording.

    Parameters
    ----------
    clock : TimingCalibration
        Clock whose codes are calibrated.
    assumed_skew_std_ps : float
        Spread of the pixels' delays, ps.

    Returns
    -------
    TimingCalibration
        Delays of zero with that error, all pixels flagged `uncalibrated`.
    """
    text = (
        "no flat recording: the delays of the pixels are taken as equal within "
        f"{assumed_skew_std_ps:g} ps; arrays differ by 300-2,000 ps, and 1 ps per pixel costs "
        "0.02-0.03 deg in a leg's angle"
    )
    warnings.warn(text, UncalibratedWarning, stacklevel=3)
    return replace(
        clock,
        skew_std_ps=np.full(clock.shape, float(assumed_skew_std_ps)),
        assumed_skew_std_ps=float(assumed_skew_std_ps),
        flags=clock.flags | np.uint32(flags.UNCALIBRATED),
        notes=(*clock.notes, text),
    )


def with_flats(
    clock: TimingCalibration,
    flats: Sequence[Histograms],
    arrivals_ps: Sequence[ArrayLike],
    *,
    flat_shape: FlatShape,
    assumed_skew_std_ps: float,
    nominal_codes: bool,
) -> TimingCalibration:
    """The clock with the delays that flat recordings show, and what several say of its gains.

    Parameters
    ----------
    clock : TimingCalibration
        Clock whose codes are calibrated, or nominal.
    flats : sequence of Histograms
        Recordings of a pulse that reaches every pixel, at least one.
    arrivals_ps : sequence of array-like
        Arrival time of each flat, one number or (rows, cols), ps.
    flat_shape : FlatShape
        Shape of the pulse.
    assumed_skew_std_ps : float
        Least error of the delay of a pixel that shows no pulse, ps.
    nominal_codes : bool
        True where no code density was had: the flat's misfit then tells how unequal codes are.

    Returns
    -------
    TimingCalibration
        With delays, anchors, widths of the pulse and, for several flats, gains drawn to the scan.

    Raises
    ------
    CalibrationError
        If no pixel of a flat shows a pulse.
    """
    clock = _with_response(clock, flats[0], flat_shape)
    seen_by = delays_of_flats(clock, flats, arrivals_ps, flat_shape)
    if nominal_codes:
        clock = _with_misfit_of_flat(clock, float(np.mean([x.chi2_excess for x in seen_by])))
    scan = scan_of_flats(clock, flats, arrivals_ps, seen_by)
    seen = np.isfinite(scan.skew_ps)
    skew, std = scan.skew_ps.copy(), scan.skew_std_ps.copy()
    middle, spread = float(np.median(skew[seen])), float(np.std(skew[seen]))
    skew[~seen], std[~seen] = middle, max(spread, assumed_skew_std_ps)
    words = clock.flags.copy()
    for flat, delays in zip(flats, seen_by, strict=True):
        words |= _pixels_that_scream(flat) | (delays.flags & np.uint32(flags.NO_PHOTONS))
    partial = _check_covered(seen, flags.is_usable(words))
    words[~seen] |= flags.UNCALIBRATED
    response = np.stack([x.response_std_ps for x in seen_by])
    photons = [float(np.nanmedian(x.photons)) for x in seen_by]
    notes = [
        f"flat: {' + '.join(f'{n:.3g}' for n in photons)} photons per pixel, delays known to "
        f"{np.median(std[seen]):.2f} ps, spread {spread:.1f} ps rms"
    ]
    if np.isfinite(response).any():
        notes.append(f"pulse of the flat: {np.nanmedian(response):.1f} ps (std)")
    notes.extend(partial)
    if not seen.all():
        notes.append(f"{int((~seen).sum())} pixels show no pulse in the flat: the array's delay")
    clock = replace(
        clock, skew_ps=skew, skew_std_ps=std, anchor_delay_ps=scan.anchor_delay_ps,
        response_std_ps=_mean_where_seen(response), flags=words,
        assumed_skew_std_ps=float(assumed_skew_std_ps), notes=(*clock.notes, *notes),
    )  # fmt: skip
    return _with_gains_of_scan(clock, scan) if len(flats) > 1 else clock


def _check_covered(seen: NDArray[np.bool_], live: NDArray[np.bool_]) -> tuple[str, ...]:
    """A note, and SuspectDataWarning, where the flat's light misses many of the live pixels.

    Raises
    ------
    CalibrationError
        Where it misses more than half of them: it is no flat.
    """
    n_live = int(np.count_nonzero(live))
    n_missed = int(np.count_nonzero(live & ~seen))
    text = f"{n_missed:,} of {n_live:,} pixels that count show no pulse in the flat"
    if n_missed > _MOST_MISSED * n_live:
        raise CalibrationError(
            f"{text}: is it another recording (a beam)? Light all pixels at once, as from a "
            "diffuser or a screen, and longer where it is dim"
        )
    if n_missed <= _USUALLY_MISSED * n_live:
        return ()
    warnings.warn(
        f"{text}, and their times will hardly count: light the whole array, or longer",
        SuspectDataWarning, stacklevel=4,
    )  # fmt: skip
    return (text,)


def _with_response(
    clock: TimingCalibration, flat: Histograms, flat_shape: FlatShape
) -> TimingCalibration:
    """The clock with the shape that its pulses are fitted with."""
    if flat_shape.response is None:
        return clock
    response = flat_shape.response(flat, clock)
    if response is None:
        return clock
    response = response.anchored()
    return replace(
        clock,
        response_curve=np.stack([response.time_ps, response.density]),
        response_place_ps=response.place_ps,
    )


def delays_of_flats(
    clock: TimingCalibration,
    flats: Sequence[Histograms],
    arrivals_ps: Sequence[ArrayLike],
    flat_shape: FlatShape,
) -> list[FlatDelays]:
    """Delays by each flat alone.

    Parameters
    ----------
    clock : TimingCalibration
        Clock whose codes are calibrated, or nominal.
    flats : sequence of Histograms
        Recordings of a pulse that reaches every pixel.
    arrivals_ps : sequence of array-like
        Arrival time of each flat, one number or (rows, cols), ps.
    flat_shape : FlatShape
        Shape of the pulse.

    Returns
    -------
    list of FlatDelays
        One for each flat.
    """
    return [flat_shape.delays(flat, clock, at) for flat, at in zip(flats, arrivals_ps, strict=True)]


def with_tilt(clock: TimingCalibration, flat_tilt_std_ps: float) -> TimingCalibration:
    """The clock with a tilt of the flat's beam fitted, and what stays of it as shared errors.

    Parameters
    ----------
    clock : TimingCalibration
        Clock with the delays that a flat gave.
    flat_tilt_std_ps : float
        Expected tilt from edge to edge of the array, ps.

    Returns
    -------
    TimingCalibration
        The tilt taken off the delays; what is left of it as two shared modes.
    """
    measured = np.isfinite(clock.anchor_delay_ps) & flags.is_usable(clock.flags)
    tilt = fit_tilt(np.where(measured, clock.skew_ps, np.nan), flat_tilt_std_ps)
    note = (
        f"flat tilted from edge to edge by {tilt.across_ps[0]:.2f} +- {tilt.across_std_ps[0]:.2f}"
        f" ps over the rows, {tilt.across_ps[1]:.2f} +- {tilt.across_std_ps[1]:.2f} ps over the "
        "columns"
    )
    return replace(
        clock, skew_ps=clock.skew_ps - tilt_ps(tilt, clock.shape), flat_modes_ps=tilt.modes_ps,
        flat_mode_names=("flat tilt, rows", "flat tilt, columns"), notes=(*clock.notes, note),
    )  # fmt: skip


def scan_of_flats(
    clock: TimingCalibration,
    flats: Sequence[Histograms],
    arrivals_ps: Sequence[ArrayLike],
    seen_by: Sequence[FlatDelays],
) -> DelayScan:
    """Line through the delays of several flats in each pixel (one flat: its delay alone).

    Parameters
    ----------
    clock : TimingCalibration
        The clock that timed the flats' pulses.
    flats : sequence of Histograms
        The recordings.
    arrivals_ps : sequence of array-like
        Arrival time of each flat, one number or (rows, cols), ps.
    seen_by : sequence of FlatDelays
        What `delays_of_flats` makes of them.

    Returns
    -------
    DelayScan
        Delays of all flats together, and the scale they tell.
    """
    period, shape = clock.laser_period_ps, clock.shape
    delay = np.stack([x.pulse_delay_ps for x in seen_by])
    std = np.stack([x.skew_std_ps for x in seen_by])
    skew = np.stack([x.skew_ps for x in seen_by])
    if period is not None:
        skew = skews_near_median(skew, period)
    if len(flats) > 1:
        # Widths between the two delays count here; gain, scale and skews are what is
        # being measured.
        bare = replace(
            clock, gain_std=np.zeros(shape), skew_std_ps=np.zeros(shape), scale_std=0.0,
            anchor_delay_ps=np.full(shape, np.nan), flat_mode_names=(),
        )  # fmt: skip
        rows, cols = (grid.ravel() for grid in np.indices(shape))
        widths = [bare.arrival_errors_ps(rows, cols, x.ravel())[0].reshape(shape) for x in delay]
        std = np.hypot(std, np.stack(widths))
    return fit_scan(delay, delay - skew, std, clock.gain_std / clock.gain)


def _mean_where_seen(values: Floats) -> Floats:
    """(rows, cols), mean over the first axis, without NaN."""
    seen = np.isfinite(values)
    count = seen.sum(axis=0)
    total = np.where(seen, values, 0.0).sum(axis=0)
    return np.where(count > 0, total / np.maximum(count, 1), np.nan)


def _with_gains_of_scan(clock: TimingCalibration, scan: DelayScan) -> TimingCalibration:
    """Scale and gains drawn to what a delay scan says, each as far as its error allows.

    Times stretch about the end of the period; anchors and skews stretch with them. A scale that
    the period itself gives is kept: the scan then only moves gains against each other.
    """
    prior, found, std = clock.scale_std, scan.scale, scan.scale_std
    if not np.isfinite(std):
        return clock
    note = f"delay scan: scale {100 * found:+.3f} +- {100 * std:.3f} %"
    if abs(found) > 5.0 * np.hypot(prior, std) and abs(found) > _SCAN_TOLERANCE:
        text = (
            f"{note} against the code density, more than their errors allow: check the delays "
            "given with the flats, and dead_codes"
        )
        warnings.warn(text, SuspectDataWarning, stacklevel=4)
    # Best estimate of a Gaussian prior about zero and a measurement: it keeps this share.
    scale = found * prior**2 / (prior**2 + std**2)
    scale_std = prior * std / np.hypot(prior, std)
    information = (scan.lever_ps * clock.gain_std / clock.gain) ** 2
    kept = information / (1.0 + information)
    own = np.nan_to_num(kept * (scan.slope - (scale if prior > 0 else found)))
    stretch = 1.0 + scale + own
    good = flags.is_usable(clock.flags)
    mean = float(np.mean((clock.gain * stretch)[good if good.any() else slice(None)]))
    anchor = clock.end_delay_ps + stretch * (clock.anchor_delay_ps - clock.end_delay_ps)
    moved = np.nan_to_num(anchor - clock.anchor_delay_ps)
    return replace(
        clock, bin_width_ps=clock.bin_width_ps * mean, gain=clock.gain * stretch / mean,
        # What a pixel's own slope tells, the shared error no longer holds.
        scale_std=float(scale_std * np.median(1.0 - kept)),
        gain_std=clock.gain_std * np.sqrt(1.0 - kept) * stretch / mean,
        anchor_delay_ps=anchor, skew_ps=clock.skew_ps + moved, notes=(*clock.notes, note),
    )  # fmt: skip


def with_dead_codes_of_scan(
    clock: TimingCalibration,
    code_density: Histograms,
    fit: CodeDensityFit,
    flats: Sequence[Histograms],
    arrivals_ps: Sequence[ArrayLike],
    flat_shape: FlatShape,
) -> TimingCalibration:
    """The clock under the hypothesis of the dead codes that flats at known delays bear out.

    Parameters
    ----------
    clock : TimingCalibration
        Clock for which the dead codes' time is unknown.
    code_density : Histograms
        The recording it was made from.
    fit : CodeDensityFit
        What `fit_code_density` says of that.
    flats : sequence of Histograms
        At least two recordings at known delays.
    arrivals_ps : sequence of array-like
        Arrival time of each flat, one number or (rows, cols), ps.
    flat_shape : FlatShape
        Shape of the pulse.

    Returns
    -------
    TimingCalibration
        The same clock where the flats cannot tell.
    """
    seen_by = delays_of_flats(clock, flats, arrivals_ps, flat_shape)
    scan = scan_of_flats(clock, flats, arrivals_ps, seen_by)
    dead_codes = dead_codes_from_scan(clock, scan)
    if dead_codes is None:
        return clock
    clock = clock_from_code_density(code_density, fit, dead_codes=dead_codes)
    return replace(clock, notes=(*clock.notes, "the delay scan says so"))


def dead_codes_from_scan(clock: TimingCalibration, scan: DelayScan) -> DeadCodes | None:
    """Which hypothesis of the dead codes a delay scan bears out; None where it cannot tell.

    Parameters
    ----------
    clock : TimingCalibration
        In the middle between both hypotheses; `scale_std` is half their distance.
    scan : DelayScan
        What the flats say of its scale.

    Returns
    -------
    {"absorbed", "lost"} or None
        The one within 4 standard errors where the other is more than 6 away; None: undecided.
    """
    half = clock.scale_std
    if not (half > 0 and np.isfinite(scan.scale_std)):
        return None
    std = np.hypot(scan.scale_std, 0.02 * half)
    from_absorbed, from_lost = abs(scan.scale - half) / std, abs(scan.scale + half) / std
    if from_absorbed < 4.0 and from_lost > 6.0:
        return "absorbed"
    if from_lost < 4.0 and from_absorbed > 6.0:
        return "lost"
    return None


def _with_misfit_of_flat(clock: TimingCalibration, chi2_excess: float) -> TimingCalibration:
    """Uncalibrated code widths are as unequal as the flat's misfit with equal ones says."""
    rms = min(float(np.sqrt(max(chi2_excess, 0.0))), 0.3)
    note = f"with equal codes the flat leaves a misfit of {100 * rms:.1f} % rms of a code's width"
    return replace(clock, phase_std=np.full(clock.phases.shape, rms), notes=(*clock.notes, note))


def with_dark(clock: TimingCalibration, dark: Histograms) -> TimingCalibration:
    """The clock with pixels flagged that scream in the dark.

    Parameters
    ----------
    clock : TimingCalibration
        Any clock.
    dark : Histograms
        Recording without light.

    Returns
    -------
    TimingCalibration
        The same clock with more flags, and a note of how many pixels scream.
    """
    screaming = _pixels_that_scream(dark)
    note = f"dark: {int(np.count_nonzero(screaming))} pixels scream"
    return replace(clock, flags=clock.flags | screaming, notes=(*clock.notes, note))


def _pixels_that_scream(hist: Histograms) -> NDArray[np.uint32]:
    """(rows, cols), the flag `screaming` where a pixel fires far more often than its peers."""
    photons = hist.photons.astype(np.float64)
    words = pixel_flags(photons.ravel(), n_frames=hist.n_frames).reshape(hist.shape)
    return words & np.uint32(flags.SCREAMING)
