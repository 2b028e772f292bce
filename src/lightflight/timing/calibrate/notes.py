"""What a code-density recording says of a clock, in sentences."""

from __future__ import annotations

import warnings

import numpy as np
from numpy.typing import NDArray

from lightflight.errors import SuspectDataWarning
from lightflight.recording.histograms import Histograms
from lightflight.timing.calibrate.code_density import CodeDensityFit

Floats = NDArray[np.float64]

_GOOD_PHOTONS = 4e6
"""Photons per pixel that calibrate a clock to 0.1 ps next to the flat."""


def fit_notes(
    code_density: Histograms,
    fit: CodeDensityFit,
    width: Floats,
    gain_std: Floats,
    good: NDArray[np.bool_],
) -> list[str]:
    """What the code-density recording said, in sentences.

    Gives SuspectDataWarning where no pattern explains the code widths.

    Parameters
    ----------
    code_density : Histograms
        The recording.
    fit : CodeDensityFit
        What `fit_code_density` says of it.
    width : array of float, shape (rows, cols)
        Width of a plateau code, ps.
    gain_std : array of float, shape (rows, cols)
        Its relative error.
    good : array of bool, shape (rows, cols)
        Usable pixels.

    Returns
    -------
    list of str
        One sentence each, for `TimingCalibration.notes`.
    """
    relative = width[good] / width[good].mean()
    noise2 = float(np.mean((gain_std[good] / relative) ** 2))
    spread = np.sqrt(max(float(np.var(relative)) - noise2, 0.0))
    notes = [
        f"code density: {fit.photons[good].mean():.3g} photons per pixel; gain spread "
        f"{100 * spread:.2f} % rms (measured to {100 * np.sqrt(noise2):.3f} %)"
    ]
    notes += _duration_notes(code_density, float(fit.photons[good].mean()))
    if fit.structured and fit.n_phases > 1:
        pattern = " ".join(f"{x:.3f}" for x in fit.phases[good].mean(axis=0))
        notes.append(
            f"code widths repeat every {fit.n_phases} codes: {pattern}, and "
            f"{100 * fit.phase_spread:.1f} % rms of its own in each pixel"
        )
    if not fit.structured:
        text = (
            "no repeating pattern explains the code widths, so every code of every pixel has its "
            f"own: {fit.n_phases} numbers where a pattern needs 9, and as many times the photons "
            "for the same error"
        )
        warnings.warn(text, SuspectDataWarning, stacklevel=4)
        notes.append(text)
    if fit.code_width_std > 0.0:
        notes.append(
            f"codes differ one by one by {100 * fit.code_spread:.1f} % rms in all pixels alike, "
            f"known to {100 * fit.code_width_std:.2f} %"
        )
    if fit.first_live_code > 0:
        notes.append(
            f"codes 0-{fit.first_live_code - 1} hold no light; code {fit.first_live_code} is "
            f"{np.nanmean(fit.first_live_width[good]):.2f} codes wide"
            if np.isfinite(fit.first_live_width[good]).any()
            else f"codes 0-{fit.first_live_code - 1} hold no light"
        )
    if np.any(fit.misfit_std[good] > 0):
        notes.append(
            f"widths beyond the model: {100 * np.median(fit.misfit_std[good]):.2f} % rms of a code"
        )
    return notes


def _duration_notes(code_density: Histograms, photons: float) -> list[str]:
    """How long the recording took, and how long a good one would at this rate."""
    n_frames, periods = code_density.n_frames, code_density.periods_per_frame
    if n_frames is None or periods is None or code_density.laser_period_ps is None:
        return []
    seconds = n_frames * periods * code_density.laser_period_ps * 1e-12
    wanted = seconds * _GOOD_PHOTONS / photons
    return [
        f"recorded in {_duration(seconds)}; {_GOOD_PHOTONS / 1e6:.0f} million photons per pixel "
        f"take {_duration(wanted)} at this rate"
    ]


def _duration(seconds: float) -> str:
    """Seconds in the unit that a person would use."""
    for unit, size in (("h", 3600.0), ("min", 60.0)):
        if seconds >= 2.0 * size:
            return _short(seconds / size) + f" {unit}"
    return _short(seconds) + " s"


def _short(value: float) -> str:
    return f"{value:.0f}" if value >= 10.0 else f"{value:.1f}"
