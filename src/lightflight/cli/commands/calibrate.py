"""`lightflight calibrate`: the camera's clock from recordings of light."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from lightflight.cli.commands.calibrate_camera import command as camera_command
from lightflight.cli.console import Fact, report
from lightflight.cli.options import (
    PLOT_SUFFIXES,
    RECORD_SUFFIXES,
    check_outputs,
    debug_option,
    hint_option,
    json_option,
    lab_options,
    outputs_option,
    path_option,
)
from lightflight.cli.progress import step, writing
from lightflight.timing.calibrate.flat_shapes import FLAT_SHAPE_NAMES, shapes_in_words

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from lightflight.lab import Lab
    from lightflight.timing.clock.calibration import TimingCalibration


@click.group(
    "calibrate",
    invoke_without_command=True,
    short_help="Calibrate the camera's clock from recordings of light; `camera`: its place.",
)
@path_option(
    "--code-density",
    help="Recording of light that knows nothing of the laser: gives the true width of each code.",
)
@path_option(
    "--flat",
    "flats",
    multiple=True,
    help="Recording of pulses that reach all pixels at one known time: gives each pixel's delay. "
    "Given more than once, with as many --flat-arrival-ps: a delay scan, which also measures the "
    "clock's scale and tells where the time of the dead codes went.",
)
@click.option("--dark", type=click.Path(path_type=Path), help="Recording without light.")
@click.option(
    "--dead-codes",
    type=click.Choice(["absorbed", "lost"]),
    help="Whether the first live codes absorb the time of the dead ones, or it is lost. Unless "
    "you know, the clock's scale stays uncertain by what lies between.",
)
@click.option(
    "--flat-arrival-ps",
    "flat_arrivals",
    metavar="TIME",
    multiple=True,
    help="When the flat's light arrived, ps: a number, or a .npy file with a time for each pixel "
    "(rows, cols); one for each --flat.",
)
@click.option(
    "--flat-pulse",
    type=click.Choice(FLAT_SHAPE_NAMES),
    help=f"Shape of the flat's pulse: {shapes_in_words()}.  [default: auto]",
)
@path_option(
    "--flat-response",
    help="Instrument response, counts per code (.npy or text): the flat's pulse is taken as it, "
    "convolved with an exponential decay that is fitted.",
)
@click.option(
    "--flat-tilt-std-ps",
    type=click.FloatRange(min=0),
    help="How far the flat's beam may have been tilted, as time from edge to edge of the array, "
    "ps: the tilt is fitted.",
)
@click.option(
    "--screen",
    nargs=9,
    type=float,
    metavar="SX SY SZ PX PY PZ NX NY NZ",
    help="The flat is a screen lit from a pulsed source: source and a point of the screen, mm, "
    "and the screen's normal; arrival times follow with the [camera] of --lab.",
)
@path_option(
    "--plot",
    "plots",
    multiple=True,
    help="Figure of the calibration to write (.png .pdf .svg): gain, code phases, delays, "
    "response, bad pixels with reasons.",
)
@outputs_option(
    "File to write: the calibration (.h5), a figure of it (.png .pdf .svg); may be given more "
    "than once.",
)
@lab_options
@hint_option
@json_option
@debug_option
@click.pass_context
def command(
    context: click.Context,
    *,
    code_density: Path | None,
    flats: tuple[Path, ...],
    dark: Path | None,
    dead_codes: str | None,
    flat_arrivals: tuple[str, ...],
    flat_pulse: str | None,
    flat_response: Path | None,
    flat_tilt_std_ps: float | None,
    screen: tuple[float, ...] | None,
    plots: tuple[Path, ...],
    outputs: tuple[Path, ...],
    lab_path: Path | None,
    assignments: tuple[str, ...],
    hints: dict[str, object],
    dry_run: bool,
    as_json: bool,
) -> None:
    """Calibrate the camera's clock: true code widths, and the delay of every pixel.

    `lightflight calibrate camera` finds where the camera stands, and its lens.

    \b
    Examples:
      lightflight calibrate --code-density bright.h5 --flat flat.h5 -o calibration.h5
      lightflight calibrate --code-density bright.h5 --flat near.h5 --flat far.h5 \\
          --flat-arrival-ps 0 --flat-arrival-ps 3335.6 -o calibration.h5 --plot calibration.png
    """
    if context.invoked_subcommand is not None:  # click calls the group before its subcommand
        return
    from lightflight.cli.records import lab_from_options, print_lab

    outputs = (*outputs, *plots)
    if code_density is None and not flats:
        raise click.UsageError("give --code-density, --flat, or better both")
    if not outputs:
        raise click.UsageError("give -o with the calibration (.h5) or a figure to write")
    check_outputs(
        outputs,
        suffixes=(*RECORD_SUFFIXES, *PLOT_SUFFIXES),
        kinds=("calibration",),
    )
    lab = lab_from_options(lab_path, assignments)
    given = {"dead_codes": dead_codes, "flat_tilt_std_ps": flat_tilt_std_ps}
    given |= flat_options(flats, flat_arrivals, flat_pulse, flat_response, screen, lab)
    options = {**lab.timing, **{k: v for k, v in given.items() if v is not None}}
    # What was given stands in the provenance as a set-up would say it; maps and curves cannot.
    lab = replace(lab, timing={k: v for k, v in options.items() if _fits_set_up(v)})
    if dry_run:
        print_lab(lab)
        return
    others = {"code_density": code_density, "dark": dark}
    calibration = _calibrated(others, flats, lab, hints, options)
    for output in outputs:
        with writing(output):
            _write(calibration, output)
    facts = calibration_facts(calibration)
    notes = calibration.notes
    report(facts, notes, as_json=as_json, title="Clock", written=outputs, notes=notes)


def _calibrated(
    others: dict[str, Path | None],
    flats: tuple[Path, ...],
    lab: Lab,
    hints: dict[str, object],
    options: dict[str, Any],
) -> TimingCalibration:
    """Calibration from the flats and `others`, which tells what it was made of."""
    from lightflight.cli.records import provenance_of_command, read_histograms
    from lightflight.timing.calibrate.chain import arrival_of_flat, calibrate_timing

    recordings: dict[str, Any] = {
        name: read_histograms(path, lab, hints) for name, path in others.items() if path is not None
    }
    notes: tuple[str, ...] = ()
    if flats:
        lit = [read_histograms(path, lab, hints) for path in flats]
        recordings["flat"] = lit if len(lit) > 1 else lit[0]
        if "flat_arrival_ps" not in options:
            options["flat_arrival_ps"], notes = arrival_of_flat(lit[0])
            lab = replace(lab, timing={**lab.timing, "flat_arrival_ps": options["flat_arrival_ps"]})
    with step("calibrating the clock"):
        calibration = calibrate_timing(**recordings, **options)
    inputs = (others["code_density"], *flats, others["dark"])
    return replace(
        calibration,
        notes=(*calibration.notes, *notes),
        provenance=provenance_of_command("calibrate", inputs, lab),
    )


def flat_options(
    flats: tuple[Path, ...],
    arrivals: tuple[str, ...],
    pulse: str | None,
    response: Path | None,
    screen: tuple[float, ...] | None,
    lab: Lab,
) -> dict[str, Any]:
    """What the command line says of the flats, as options of `calibrate_timing`.

    Parameters
    ----------
    flats : tuple of Path
        Recordings of flats.
    arrivals : tuple of str
        When their light arrived: a number (ps) or a .npy file for each.
    pulse : str or None
        Name of the pulse's shape.
    response : Path or None
        Measured response, counts per code.
    screen : tuple of float or None
        Source, a point of the screen and its normal, mm (nine numbers).
    lab : Lab
        The set-up, whose camera looks at the screen.

    Returns
    -------
    dict of str
        `flat_pulse`, and `flat_arrival_ps` where it is stated.

    Raises
    ------
    click.UsageError
        For what contradicts itself or is missing.
    """
    if (arrivals or pulse or response or screen) and not flats:
        raise click.UsageError("options of the flat need --flat")
    if pulse and response:
        raise click.UsageError("give --flat-pulse or --flat-response, not both")
    if screen and (arrivals or len(flats) > 1):
        raise click.UsageError("--screen gives the arrival times of one --flat by itself")
    if screen and lab.camera is None:
        raise click.UsageError("--screen needs the [camera] of a set-up file: give --lab")
    if len(flats) > 1 and len(arrivals) != len(flats):
        raise click.UsageError(
            f"{len(flats)} flats need as many --flat-arrival-ps, got {len(arrivals)}"
        )
    if len(flats) == 1 and len(arrivals) > 1:
        raise click.UsageError(f"one --flat needs one --flat-arrival-ps, got {len(arrivals)}")
    options: dict[str, object] = {"flat_pulse": pulse}
    if response is not None:
        options["flat_pulse"] = _array_from_file(response)
    if arrivals:
        times = [_arrival_from_text(text) for text in arrivals]
        options["flat_arrival_ps"] = times if len(flats) > 1 else times[0]
    if screen:
        from lightflight.timing.flat_geometry import flat_arrival_from_screen_ps

        assert lab.camera is not None
        options["flat_arrival_ps"] = flat_arrival_from_screen_ps(
            lab.camera, source_mm=screen[:3], screen_point_mm=screen[3:6],
            screen_normal=screen[6:], medium=lab.medium,
        )  # fmt: skip
    return options


def _fits_set_up(value: object) -> bool:
    """Whether an option can be written down in a set-up: no map, no curve."""
    parts = value if isinstance(value, list) else [value]
    return all(isinstance(part, int | float | str) for part in parts)


def _arrival_from_text(text: str) -> Any:
    """A number, or the map of a .npy file."""
    try:
        return float(text)
    except ValueError:
        if not Path(text).exists():
            raise click.UsageError(
                f"--flat-arrival-ps {text}: is neither a number of ps nor the name of a file"
            ) from None
        return _array_from_file(Path(text))


_MOST_TEXT_BYTES = 1 << 26


def _array_from_file(path: Path) -> NDArray[np.generic]:
    """Numbers of a .npy file or a text file."""
    import numpy as np

    from lightflight.errors import FileFormatError
    from lightflight.files.filecheck import readable_file
    from lightflight.formats.numpy_files import arrays_from_file

    if path.suffix.lower() == ".npy":
        return arrays_from_file(path)[""]
    if readable_file(path).stat().st_size > _MOST_TEXT_BYTES:
        raise FileFormatError("is too large for a list of numbers: save it as .npy", path=path)
    try:
        # Opened here: by its name, NumPy would unpack a .gz of any size.
        with path.open(encoding="utf-8") as text:
            return np.loadtxt(text, delimiter="," if path.suffix.lower() == ".csv" else None)
    except ValueError as error:
        raise FileFormatError(f"holds no array of numbers ({error})", path=path) from error


def _write(calibration: TimingCalibration, output: Path) -> None:
    """Write a calibration file, or a figure of it, as the suffix says."""
    if output.suffix.lower() in RECORD_SUFFIXES:
        calibration.save(output)
        return
    from lightflight.view.export.files import write_figure
    from lightflight.view.figures.calibration import calibration_figure

    write_figure(calibration_figure(calibration), output)


def calibration_facts(calibration: TimingCalibration) -> list[Fact]:
    """What a calibration found.

    Parameters
    ----------
    calibration : TimingCalibration
        The clock.

    Returns
    -------
    list of Fact
        Widths, scale, gains, delays (ps) and flags; spreads are those of the usable pixels.
    """
    import numpy as np

    from lightflight import flags

    good = flags.is_usable(calibration.flags)
    if not good.any():  # spreads over all pixels say more than NaN
        good = np.ones(calibration.shape, dtype=bool)

    def spread(values: NDArray[np.float64]) -> float:
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

command.add_command(camera_command)
