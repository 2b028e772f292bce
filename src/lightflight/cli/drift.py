"""Whether a clock still holds: the figures of `lightflight info --timing` and `--slices`."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from lightflight.cli.console import Fact, with_error
from lightflight.cli.progress import step

if TYPE_CHECKING:
    from lightflight.lab import Lab
    from lightflight.recording.histograms import Histograms
    from lightflight.recording.recording import Recording
    from lightflight.timing.clock.calibration import TimingCalibration
    from lightflight.timing.drift import Drift


def drift_facts(
    file: Path,
    lab: Lab,
    hints: Mapping[str, object],
    *,
    timing_path: Path | None,
    slices: int | None,
) -> tuple[list[Fact], list[str]]:
    """Offset and scale of a new flat against its calibration, or slice by slice.

    Parameters
    ----------
    file : Path
        The new flat, or a long recording.
    lab : Lab
        The set-up; [recording] tells what the file does not.
    hints : mapping of str
        What --hint told; stands over [recording].
    timing_path : Path or None
        Calibration that the clock is held against.
    slices : int or None
        Stretches to cut the recording into; None: all of it, against the calibration.

    Returns
    -------
    facts : list of Fact
        A line for each slice, ps.
    sentences : list of str
        What they mean.

    Raises
    ------
    click.UsageError
        Where the recording cannot be cut into slices.
    """
    from lightflight.cli.records import read_hinted
    from lightflight.recording.counting import histogram
    from lightflight.timing.clock.calibration import TimingCalibration
    from lightflight.timing.drift import drift_from_flat, drift_in_slices

    timing = None if timing_path is None else TimingCalibration.load(timing_path)
    record = read_hinted(file, lab, hints)
    if slices is not None:
        parts = _slices(record, slices, file)
        with step("following the pulses"):
            return _facts(drift_in_slices(parts, timing=timing), slices)
    assert timing is not None
    arrival = lab.timing.get("flat_arrival_ps", _arrival_of(timing))
    with step("comparing with the calibration"):
        drift = drift_from_flat(timing, histogram(record), flat_arrival_ps=arrival)
    return _facts(drift, None)


def _arrival_of(timing: TimingCalibration) -> float:
    """When the flat of a calibration arrived, as its file says; 0 where it says nothing."""
    settings: Any = timing.provenance.get("settings", {})
    arrival = settings.get("timing", {}).get("flat_arrival_ps", 0.0)
    return float(arrival) if isinstance(arrival, int | float) else 0.0


def _slices(record: Recording | Histograms, n_slices: int, file: Path) -> list[Histograms]:
    """Histograms of runs of frames of nearly equal length."""
    from lightflight.recording.counting import histogram
    from lightflight.recording.histograms import Histograms

    n_frames = record.n_frames
    if isinstance(record, Histograms) or n_frames is None or n_frames < n_slices:
        raise click.UsageError(
            f"{file}: --slices needs a recording of frames or events that knows its frames; this "
            "one cannot be cut in time"
        )
    edges = [n_frames * i // n_slices for i in range(n_slices + 1)]
    return [histogram(record, frames=(edges[i], edges[i + 1])) for i in range(n_slices)]


def _facts(drift: Drift, slices: int | None) -> tuple[list[Fact], list[str]]:
    """Lines and sentences about a drift; `slices` None: one, against the calibration."""
    import numpy as np

    facts, sentences = [], []
    for i in range(len(drift.offset_ps)):
        label = "drift" if slices is None else f"slice {i + 1}"
        shown = f"{with_error(float(drift.offset_ps[i]), float(drift.offset_std_ps[i]))} ps"
        if np.isfinite(drift.scale[i]):
            percent, std = 100.0 * float(drift.scale[i]), 100.0 * float(drift.scale_std[i])
            shown += f", scale {with_error(percent, std)} %"
        facts.append(
            Fact(label, f"drift_{i}_ps" if slices else "drift_ps", drift.offset_ps[i], shown)
        )
    if slices is None:
        sentences.append(f"Since the calibration, {drift.sentence()}.")
        # Beyond offset and scale: the pixels' own movement, in units of their errors squared.
        own = float(drift.chi2[0]) / max(int(drift.dof[0]), 1)
        if own > 2.0:
            sentences.append(
                f"Beyond that, pixels moved by {own**0.5:.1f} of their errors on their own: "
                "another scene than the flat's, or a clock that has changed; calibrate again."
            )
    if not drift.moved.any():
        sentences.append("No movement beyond its errors.")
    return facts, sentences
