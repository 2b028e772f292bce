"""`lightflight calibrate`: the camera's clock from two recordings of light."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from lightflight.cli._console import (
    Fact,
    json_from_facts,
    print_facts,
    print_json,
    print_sentences,
    step,
)
from lightflight.cli._options import (
    FIGURE_SUFFIXES,
    RECORD_SUFFIXES,
    check_outputs,
    debug_option,
    hint_option,
    json_option,
    lab_options,
    outputs_option,
)

if TYPE_CHECKING:
    from lightflight.histogram import Histograms
    from lightflight.timing.calibration import TimingCalibration


@click.command("calibrate", short_help="Calibrate the camera's clock from two recordings.")
@click.option(
    "--code-density",
    type=click.Path(path_type=Path),
    help="Recording of light that knows nothing of the laser: gives the true width of each code.",
)
@click.option(
    "--flat",
    type=click.Path(path_type=Path),
    help="Recording of pulses that reach all pixels at one known time: gives each pixel's delay.",
)
@click.option("--dark", type=click.Path(path_type=Path), help="Recording without light.")
@click.option(
    "--dead-codes",
    type=click.Choice(["absorbed", "lost"]),
    help="Whether the first live codes absorb the time of the dead ones, or it is lost. Unless "
    "you know, the clock's scale stays uncertain by what lies between.",
)
@click.option("--flat-arrival-ps", type=float, help="When the flat's light arrived, ps.")
@outputs_option(
    "File to write: the calibration (.h5), a figure of it (.png .pdf .svg); may be given more "
    "than once.",
    required=True,
)
@lab_options
@hint_option
@json_option
@debug_option
def command(
    *,
    code_density: Path | None,
    flat: Path | None,
    dark: Path | None,
    dead_codes: str | None,
    flat_arrival_ps: float | None,
    outputs: tuple[Path, ...],
    lab_path: Path | None,
    assignments: tuple[str, ...],
    hints: dict[str, Any],
    dry_run: bool,
    as_json: bool,
) -> None:
    """Calibrate the camera's clock: true code widths, and the delay of every pixel.

    \b
    Example:
      lightflight calibrate --code-density bright.h5 --flat flat.h5 -o calibration.h5
    """
    from lightflight.cli._records import lab_from_options, print_lab, provenance, read_histograms
    from lightflight.timing.calibration import calibrate_timing

    if code_density is None and flat is None:
        raise click.UsageError("give --code-density, --flat, or better both")
    inputs = [path for path in (code_density, flat, dark) if path is not None]
    check_outputs(
        outputs,
        inputs=inputs,
        suffixes=(*RECORD_SUFFIXES, *FIGURE_SUFFIXES),
        kinds=("calibration",),
    )
    lab = lab_from_options(lab_path, assignments)
    given = {"dead_codes": dead_codes, "flat_arrival_ps": flat_arrival_ps}
    options = {**lab.timing, **{k: v for k, v in given.items() if v is not None}}
    lab = replace(lab, timing=options)
    if dry_run:
        print_lab(lab)
        return
    recordings: dict[str, Any] = {
        name: read_histograms(path, lab, hints)
        for name, path in (("code_density", code_density), ("flat", flat), ("dark", dark))
        if path is not None
    }
    notes: tuple[str, ...] = ()
    if "flat" in recordings and "flat_arrival_ps" not in options:
        options["flat_arrival_ps"], notes = _flat_arrival(recordings["flat"])
        lab = replace(lab, timing=options)
    with step("calibrating the clock"):
        calibration = calibrate_timing(**recordings, **options)
    calibration = replace(calibration, notes=(*calibration.notes, *notes))
    calibration = replace(calibration, provenance=provenance("calibrate", inputs, lab))
    for output in outputs:
        with step(f"writing {output.name}"):
            _write(calibration, output)
    facts = calibration_facts(calibration)
    if as_json:
        print_json(
            json_from_facts(facts)
            | {"notes": calibration.notes, "written": [str(path) for path in outputs]}
        )
        return
    print_facts(facts, title="Clock")
    print_sentences(calibration.notes)
    print_sentences([f"Written: {', '.join(map(str, outputs))}"])


def _flat_arrival(flat: Histograms) -> tuple[float, tuple[str, ...]]:
    """When the flat's light arrived, where nobody said: a simulation knows, a lab sets its zero."""
    import numpy as np

    known = getattr(flat.truth, "flat_arrival_ps", None)
    if known is None or np.ndim(known):
        return 0.0, (
            "the clock's zero is the arrival of the flat's light (--flat-arrival-ps sets another)",
        )
    return float(known), (f"the flat is simulated: its light arrived at {float(known):g} ps",)


def _write(calibration: TimingCalibration, output: Path) -> None:
    if output.suffix.lower() in RECORD_SUFFIXES:
        calibration.save(output)
        return
    from lightflight.view.export import write_figure
    from lightflight.view.figures_calibration import calibration_figure

    write_figure(calibration_figure(calibration), output)


def calibration_facts(calibration: TimingCalibration) -> list[Fact]:
    """What a calibration found."""
    import numpy as np

    from lightflight import flags

    good = flags.is_usable(calibration.flags)
    if not good.any():
        good = np.ones(calibration.shape, dtype=bool)

    def spread(values: Any) -> float:
        return float(np.nanstd(values[good]))

    def percent(label: str, key: str, value: float) -> Fact:
        return Fact(label, key, value, f"{100 * value:.2f} %")

    rows, cols = calibration.shape
    end = float(np.nanmedian(calibration.end_code[good]))
    facts = [
        Fact(
            "pixels (rows x cols)",
            "shape",
            calibration.shape,
            f"{rows} x {cols}, {int(good.sum()):,} usable",
        ),
        Fact(
            "mean code width",
            "bin_width_ps",
            calibration.bin_width_ps,
            f"{calibration.bin_width_ps:.3f} ps",
        ),
        percent("shared error of the scale", "scale_std", calibration.scale_std),
        Fact("end of the laser period", "end_code", end, f"code {end:.2f}"),
        percent("gain, pixel to pixel (rms)", "gain_rms", spread(calibration.gain)),
    ]
    if 1 < calibration.n_phases <= _MOST_PHASES_SHOWN:
        phases = np.mean(calibration.phases[good], axis=0)
        pattern = " ".join(f"{phase:.3f}" for phase in phases)
        facts.append(Fact("code widths, code mod phases", "phases", phases, pattern))
    if np.any(calibration.skew_ps != 0):
        skew = spread(calibration.skew_ps)
        error = float(np.nanmedian(calibration.skew_std_ps[good]))
        facts.append(Fact("pixel delays (rms)", "skew_rms_ps", skew, f"{skew:.1f} ps"))
        facts.append(Fact("their error (median)", "skew_std_ps", error, f"{error:.2f} ps"))
    flagged = flags.count_flags(calibration.flags)
    words = ", ".join(f"{n} {name}" for name, n in flagged.items()) or "none"
    return [*facts, Fact("flagged pixels", "flagged", flagged, words)]


_MOST_PHASES_SHOWN = 16
