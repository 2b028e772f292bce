"""`calibrate_timing`: recordings of light in, the camera's clock out."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from lightflight.arguments import finite_number, one_of, shown
from lightflight.errors import CalibrationError
from lightflight.recording.histograms import Histograms
from lightflight.recording.stored import check_photons
from lightflight.timing.calibrate.assemble import (
    clock_from_code_density,
    clock_without_code_density,
    with_assumed_delays,
    with_dark,
    with_dead_codes_of_scan,
    with_flats,
    with_tilt,
)
from lightflight.timing.calibrate.code_density import fit_code_density
from lightflight.timing.calibrate.flat_shapes import flat_shape
from lightflight.timing.clock.calibration import TimingCalibration
from lightflight.timing.clock.shared_modes import with_shared_errors
from lightflight.timing.pulses.sync import check_sync

_LARGEST_STD = 1e12
"""ps, or a share: whoever knows a clock no better has none."""
_NO_TILT_PS = 1e-6
"""A tilt of less moves no arrival."""

if TYPE_CHECKING:
    from lightflight.timing.calibrate.flat_shapes import FlatPulse, FlatShape


def calibrate_timing(
    code_density: Histograms | None = None,
    *,
    flat: Histograms | Sequence[Histograms] | None = None,
    flat_arrival_ps: ArrayLike | Sequence[ArrayLike] | None = None,
    dead_codes: str | None = None,
    dark: Histograms | None = None,
    assumed_skew_std_ps: float = 0.0,
    flat_tilt_std_ps: float = 0.0,
    flat_pulse: FlatPulse = "auto",
    flat_arrival_std_ps: float = 0.0,
    scale_std: float = 0.0,
    drift_std_ps: float = 0.0,
) -> TimingCalibration:
    """The camera's clock from a code-density recording, a flat recording, or both.

    Parameters
    ----------
    code_density : Histograms or None
        Light that ignores the laser: gain, pattern of code widths, dead codes. None: nominal
        codes, with a warning that says what that costs.
    flat : Histograms, list of Histograms, or None
        A pulse that reaches every pixel at a known time: delays, response. Several at known extra
        delays (a delay scan) also measure the scale of the clock, and tell where the dead codes'
        time went. None: equal delays, with a warning.
    flat_arrival_ps : float or (rows, cols), or a list of them, one for each flat
        When the flat's pulse reached each pixel, ps, on the clock that this defines. What is
        common to all pixels and flats only shifts that clock. None: as a simulated flat says
        itself, so that the clock's zero is the simulation's; 0 for one of a lab.
    dead_codes : "absorbed", "lost" or None
        Where the time of the dead first codes went: into the first live ones, or nowhere. None:
        unknown, which is a scale error that all pixels share.
    dark : Histograms or None
        No light at all: finds screaming pixels.
    assumed_skew_std_ps : float
        Spread of delays to assume for pixels without a flat, ps.
    flat_tilt_std_ps : float
        How far the flat's beam may have been tilted, as arrival time from edge to edge of the
        array, ps (a sensor 1.6 mm wide: 0.09 ps per degree). The tilt is then fitted; what stays
        unknown of it is a shared error. A screen has no tilt: see `flat_arrival_from_screen_ps`.
    flat_pulse : "auto", "gaussian", "tail", Response, "mean", or (codes,)
        Shape of the flat's pulse: a Gaussian of each pixel's own width; a Gaussian with an
        exponential tail, found from the flat; whichever of these two the flat asks for ("auto"); a
        shape of your own (`Response`). With a tail or a shape, recordings on this clock are fitted
        by the same, and delays are those of its mean. For light that lasts longer than the response
        (fluorescence): the array's own mean pulse; or the counts of the instrument's response,
        which is then convolved with an exponential decay that is fitted; delays are then those of
        the onset (half height).
    flat_arrival_std_ps : float
        One-sigma error of `flat_arrival_ps`, alike in all pixels: of the clock's zero, ps. 0: what
        is common to all pixels defines the clock.
    scale_std : float
        One-sigma error of the length of all codes when it records, as a share, beside what the
        calibration measures (a camera that is warmer by then). 0: none.
    drift_std_ps : float
        How far the clock's zero may have drifted by the middle of a recording, alike in all pixels,
        ps; recordings of one flight share it. 0: not at all.

    Returns
    -------
    TimingCalibration
        Pixels that could not be calibrated hold what is typical for the array and are flagged.

    Raises
    ------
    ValueError
        If neither recording is given, or an option is wrong.
    CalibrationError
        If a recording cannot be what it is called, or the recordings do not belong together.
    """
    if flat_arrival_ps is None:
        flat_arrival_ps, said = arrival_of_flat(flat)
    else:
        said = ()
    flats, arrivals = _checked_flats(flat, flat_arrival_ps)
    stds = {
        "assumed_skew_std_ps": assumed_skew_std_ps, "flat_tilt_std_ps": flat_tilt_std_ps,
        "flat_arrival_std_ps": flat_arrival_std_ps, "scale_std": scale_std,
        "drift_std_ps": drift_std_ps,
    }  # fmt: skip
    shape = _checked_parts(code_density, flats, dark, dead_codes, flat_pulse, stds)
    if code_density is not None:
        fit = fit_code_density(code_density)
        clock = clock_from_code_density(code_density, fit, dead_codes=dead_codes)
        if dead_codes is None and len(flats) > 1:
            clock = with_dead_codes_of_scan(clock, code_density, fit, flats, arrivals, shape)
    else:
        clock = clock_without_code_density(flats[0])
    if flats:
        clock = with_flats(
            clock, flats, arrivals, flat_shape=shape, assumed_skew_std_ps=assumed_skew_std_ps,
            nominal_codes=code_density is None,
        )  # fmt: skip
        if flat_tilt_std_ps > _NO_TILT_PS:
            clock = with_tilt(clock, flat_tilt_std_ps)
    else:
        clock = with_assumed_delays(clock, assumed_skew_std_ps)
    clock = with_shared_errors(
        clock, offset_std_ps=flat_arrival_std_ps, scale_std=scale_std, drift_std_ps=drift_std_ps
    )
    clock = replace(clock, notes=(*clock.notes, *said))
    return clock if dark is None else with_dark(clock, dark)


def arrival_of_flat(
    flat: Histograms | Sequence[Histograms] | None,
) -> tuple[float, tuple[str, ...]]:
    """When the flat's light arrived, where nobody said: a simulation knows, a lab sets its zero.

    Parameters
    ----------
    flat : Histograms, sequence of Histograms or None
        The flat, as `calibrate_timing` takes it.

    Returns
    -------
    arrival_ps : float
        ps.
    notes : tuple of str
        What it rests on; none where there is no single flat.
    """
    if not isinstance(flat, Histograms):
        return 0.0, ()
    known = getattr(flat.truth, "flat_arrival_ps", None)
    if known is None or np.ndim(known):
        return 0.0, ("the clock's zero is the arrival of the flat's light (flat_arrival_ps)",)
    return float(known), (f"the flat is simulated: its light arrived at {float(known):g} ps",)


def _checked_flats(
    flat: Histograms | Sequence[Histograms] | None, flat_arrival_ps: Any
) -> tuple[list[Histograms], list[ArrayLike]]:
    """Flats and their arrival times as two lists of one length."""
    if flat is None:
        return [], []
    if isinstance(flat, Histograms):
        return [flat], [flat_arrival_ps]
    if not isinstance(flat, list | tuple):
        raise TypeError(f"flat must be Histograms or a list of them, got {shown(flat)}")
    flats = list(flat)
    if not flats:
        raise ValueError("flat is an empty list: give one flat recording or several")
    arrivals = (
        list(flat_arrival_ps) if np.ndim(flat_arrival_ps) or _is_list(flat_arrival_ps) else []
    )
    if len(arrivals) != len(flats):
        raise ValueError(
            f"{len(flats)} flats need as many flat_arrival_ps, got {len(arrivals)}: give the known "
            "arrival time (or map of times) of each"
        )
    return flats, arrivals


def _is_list(value: object) -> bool:
    return isinstance(value, list | tuple)


def _checked_parts(
    code_density: Histograms | None,
    flats: Sequence[Histograms],
    dark: Histograms | None,
    dead_codes: str | None,
    flat_pulse: FlatPulse,
    stds: Mapping[str, float],
) -> FlatShape:
    """Shape of the flat's pulse; raises for parts missing, of the wrong kind or other cameras."""
    for part in (code_density, *flats):
        if isinstance(part, Histograms) and part.poisson:
            check_sync(part)
            check_photons(part)
    if code_density is None and not flats:
        raise ValueError("nothing to calibrate from: give code_density, flat, or both")
    shape = flat_shape(flat_pulse)
    if dead_codes is not None:
        one_of("dead_codes", dead_codes, ("absorbed", "lost"))
    for name, std in stds.items():
        must = f"be finite and >= 0, and at most {_LARGEST_STD:g}"
        finite_number(name, std, must, low=0.0, high=_LARGEST_STD)
    named = {"code_density": code_density, "dark": dark}
    named |= {f"flat {i + 1}" if len(flats) > 1 else "flat": x for i, x in enumerate(flats)}
    parts = {name: part for name, part in named.items() if part is not None}
    for name, part in parts.items():
        if not isinstance(part, Histograms):
            raise TypeError(
                f"{name} must be Histograms, got {type(part).__name__}: call histogram() first"
            )
        # A dark recording is only asked which pixels stand out.
        if name != "dark" and not part.poisson:
            raise CalibrationError(
                f"{name} holds scaled intensities: a clock can only be calibrated from counts"
            )
    shapes = {name: part.shape for name, part in parts.items()}
    if len(set(shapes.values())) > 1:
        raise CalibrationError(f"the recordings are of different cameras: {shapes}")
    return shape
