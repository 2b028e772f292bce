"""`lightflight reconstruct`: from a recording to the path of the pulse."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import click

from lightflight.cli.console import (
    Fact,
    json_from_facts,
    print_facts,
    print_json,
    print_sentences,
    print_table,
    print_written,
    with_error,
)
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
    strict_option,
    timing_option,
)
from lightflight.cli.progress import step, writing
from lightflight.reconstruct import FREE_NAMES
from lightflight.reconstruct.estimators import METHODS

if TYPE_CHECKING:
    from lightflight.lab import Lab
    from lightflight.path.light_path import LightPath
    from lightflight.reconstruct.legs.find import ImageLeg
    from lightflight.recording.histograms import Histograms
    from lightflight.timing.clock.calibration import TimingCalibration


@click.command("reconstruct", short_help="Reconstruct the path of a pulse.")
@click.argument("recordings", nargs=-1, required=True, type=click.Path(path_type=Path))
@timing_option(
    "Calibration of the clock, from `lightflight calibrate`. Without: nominal, and warned of."
)
@path_option(
    "--background",
    "background_path",
    help="Recording of the scene without the flight, by the same camera: its rate is that of the "
    "dark, and codes where it holds pulses (a leak, reflections) take no part.",
)
@click.option(
    "--method",
    type=click.Choice(sorted(METHODS)),
    help="Estimator.  [default: joint]",
)
@click.option("--n-legs", type=click.IntRange(min=1), help="Number of legs, where you know it.")
@click.option(
    "--free",
    multiple=True,
    type=click.Choice(FREE_NAMES),
    help="Fit this within its plausible size although it was told as exact, as a check advises; "
    "may be given more than once.",
)
@click.option(
    "--response-fwhm-ps",
    type=click.FloatRange(min=0.0),
    help="Width of the camera's response alone: says how long the laser's pulse was.",
)
@outputs_option(
    "File to write: the path (.h5), points along it (.csv), a figure (.png .pdf .svg); may be "
    "given more than once."
)
@strict_option
@lab_options
@hint_option
@json_option
@debug_option
def command(
    *,
    recordings: tuple[Path, ...],
    timing_path: Path | None,
    background_path: Path | None,
    method: str | None,
    n_legs: int | None,
    free: tuple[str, ...],
    response_fwhm_ps: float | None,
    outputs: tuple[Path, ...],
    strict: bool,
    lab_path: Path | None,
    assignments: tuple[str, ...],
    hints: dict[str, object],
    dry_run: bool,
    as_json: bool,
) -> None:
    """Reconstruct the 4D path of a pulse from RECORDINGS (one, or repeats of the same scene).

    The set-up says where camera and source stand. Without the time per code or the camera's
    distance, the legs are found in the picture, and what is missing is named.

    What is said first is the verdict: whether the recording agrees with the path ("trust"),
    something is open ("check"), or it does not agree ("contradicted").

    \b
    Examples:
      lightflight reconstruct recording.h5 --lab lab.toml --timing calibration.h5 -o path.h5
      lightflight reconstruct streak.mat --hint axes=tyx -o path.csv -o path.png
    """
    from lightflight.cli.paths import refuse_unless_trusted
    from lightflight.cli.records import calibration_from_option, print_lab, read_histograms

    inputs = [p for p in (*recordings, timing_path, background_path, lab_path) if p is not None]
    lab = _lab_with_options(lab_path, assignments, method, n_legs, free)
    check_outputs(
        outputs,
        suffixes=(*RECORD_SUFFIXES, ".csv", *PLOT_SUFFIXES),
        kinds=("path",),
    )
    if dry_run:
        print_lab(lab)
        return
    repeats = [read_histograms(path, lab, hints) for path in recordings]
    _refuse_copies(recordings, repeats)
    timing = calibration_from_option(timing_path)
    if timing is not None:
        _warn_of_other_timing(lab, timing)
    missing = _missing(lab, repeats)
    if missing:  # the picture is worth having, and says what to ask the lab for
        _stop_at_the_picture(repeats[0], timing, lab, missing, outputs, as_json=as_json)
        refuse_unless_trusted(None, strict=strict)
        return
    background = None if background_path is None else read_histograms(background_path, lab, hints)
    path = _reconstruct(repeats, timing, background, lab, inputs, outputs)
    laser = []
    if response_fwhm_ps is not None:
        laser = _laser_facts(path, repeats[0], timing, response_fwhm_ps)
    _print(path, laser, outputs, as_json=as_json)
    refuse_unless_trusted(path, strict=strict)


def _lab_with_options(
    lab_path: Path | None,
    assignments: tuple[str, ...],
    method: str | None,
    n_legs: int | None,
    free: tuple[str, ...],
) -> Lab:
    """Lab with --method, --n-legs and --free laid over it."""
    from lightflight.cli.records import lab_from_options

    lab = lab_from_options(lab_path, assignments)
    given = {"method": method, "n_legs": n_legs, "free": free or None}
    options = {**lab.reconstruct, **{k: v for k, v in given.items() if v is not None}}
    return replace(lab, reconstruct=options)


def _refuse_copies(recordings: tuple[Path, ...], repeats: list[Histograms]) -> None:
    """Refuse a recording that is given twice, by its name."""
    from lightflight.errors import ConfigError
    from lightflight.reconstruct.calls import first_copy

    copy = first_copy(repeats)
    if copy is not None:
        first, again = (recordings[k] for k in copy)
        raise ConfigError(f"{again}: holds the same counts as {first}: give each recording once")


def _warn_of_other_timing(lab: Lab, timing: TimingCalibration) -> None:
    """Say what [timing] tells and the calibration was made without: only calibrations read it."""
    import warnings

    from lightflight.errors import SuspectDataWarning

    if "settings" not in timing.provenance:
        return
    kept = timing.provenance["settings"].get("timing", {})
    other = [name for name, value in lab.timing.items() if kept.get(name) != value]
    if other:
        warnings.warn(
            f"[timing] {', '.join(other)}: not used here, and the calibration was made without: "
            "make it with this set-up (lightflight calibrate --lab)",
            SuspectDataWarning,
            stacklevel=2,
        )


def _missing(lab: Lab, repeats: list[Histograms]) -> list[str]:
    """What stands between these recordings and a path in space, in words."""
    missing = []
    if any(hist.bin_width_ps is None for hist in repeats):
        missing.append("the time per code (--hint bin_width_ps=..., or under [recording])")
    if lab.camera is None:
        missing.append(f"the camera ([camera] {' and '.join(lab.camera_needs)})")
    return missing


def _reconstruct(
    repeats: list[Histograms],
    timing: TimingCalibration | None,
    background: Histograms | None,
    lab: Lab,
    inputs: list[Path],
    outputs: tuple[Path, ...],
) -> LightPath:
    """The path, with its provenance, written to every output."""
    from lightflight.cli.paths import write_path
    from lightflight.cli.records import provenance_of_command
    from lightflight.lab import reconstruct_options
    from lightflight.reconstruct import reconstruct

    with step("reconstructing the path"):
        path = reconstruct(
            repeats if len(repeats) > 1 else repeats[0],
            camera=lab.camera,
            source=lab.source,
            medium=lab.medium,
            timing=timing,
            background=background,
            **reconstruct_options(lab),
        )
    path = replace(path, provenance=provenance_of_command("reconstruct", inputs, lab))
    for output in outputs:
        with writing(output):
            write_path(path, output)
    return path


def _laser_facts(
    path: LightPath, hist: Histograms, timing: TimingCalibration | None, response_fwhm_ps: float
) -> list[Fact]:
    """Width of the laser's pulse by deconvolution, and how long it looks on each leg."""
    from lightflight.reconstruct.laser import laser_pulse

    with step("taking the response off the widths"):
        pulse = laser_pulse(path, hist, timing=timing, response_fwhm_ps=response_fwhm_ps)
    width, looks = pulse.width, pulse.apparent_fwhm_ps
    words = f"{with_error(width.fwhm_ps, width.fwhm_std_ps)} ps FWHM"
    recorded = f"recorded {width.recorded_fwhm_ps:.1f} ps, {width.n_pulses:,} pulses"
    seen = ", ".join(f"{value:.1f}" for value in looks)
    return [
        Fact("laser pulse", "laser_fwhm_ps", width.fwhm_ps, f"{words} ({recorded})"),
        Fact("its error", "laser_fwhm_std_ps", width.fwhm_std_ps, f"{width.fwhm_std_ps:.2f} ps"),
        Fact("its length in a frame", "apparent_fwhm_ps", looks.tolist(), f"{seen} ps, by leg"),
    ]


def _print(path: LightPath, laser: list[Fact], outputs: tuple[Path, ...], *, as_json: bool) -> None:
    """Say on stdout what was found."""
    from lightflight.cli.paths import json_from_path, print_path

    if as_json:
        written = {"written": [str(output) for output in outputs]}
        print_json(json_from_path(path) | json_from_facts(laser) | written)
        return
    print_path(path)
    if laser:
        print_facts(laser)
    if outputs:
        print_written(outputs)


def _stop_at_the_picture(
    hist: Histograms,
    timing: TimingCalibration | None,
    lab: Lab,
    missing: list[str],
    outputs: tuple[Path, ...],
    *,
    as_json: bool,
) -> None:
    """Find the legs in (u, v, arrival time), and say what more a path in space needs."""
    from lightflight.errors import ConfigError
    from lightflight.reconstruct import find_legs
    from lightflight.timing.pulses.arrivals import find_arrivals

    with step("fitting the pulses"):
        arrivals = find_arrivals(hist, timing=timing)
    with step("looking for legs"):
        legs = find_legs(arrivals, n_legs=lab.reconstruct.get("n_legs"))
    if timing is None and hist.poisson:  # a computed cube has no clock of its own
        _warn_of_nominal_legs()
    unit = "codes" if hist.bin_width_ps is None else "ps"
    needs = f"To go on to (x, y, z, t) this needs {' and '.join(missing)}."
    if as_json:
        print_json({"legs": [_json_from_leg(leg, unit) for leg in legs], "needs": missing})
    else:
        _print_legs(legs, unit)
        print_sentences([needs])
    if outputs:
        names = ", ".join(map(str, outputs))
        raise ConfigError(f"{names} not written, the path stops at (u, v, t_a): {needs}")


def _warn_of_nominal_legs() -> None:
    """Say what legs in the picture are worth without a calibration of the clock."""
    import warnings

    from lightflight.errors import SuspectDataWarning

    warnings.warn(
        "these legs rest on a nominal clock: the delays between pixels, often hundreds of ps, go "
        "unseen, so legs may be short, missing or wrong; give --timing (lightflight calibrate)",
        SuspectDataWarning,
        stacklevel=2,
    )


def _print_legs(legs: tuple[ImageLeg, ...], unit: str) -> None:
    """Legs in the picture as a table."""
    rows: list[tuple[object, ...]] = []
    for i, leg in enumerate(legs):
        (u0, v0), (u1, v1) = leg.points_px(leg.extent_px)
        first, last = leg.span_ps
        rows.append(
            (
                f"{i + 1}",
                f"({u0:.2f}, {v0:.2f})",
                f"({u1:.2f}, {v1:.2f})",
                f"{first:,.2f}",
                f"{last:,.2f}",
                f"{1.0 / leg.apparent_speed_px_per_ps:.4f}",
                leg.n_pixels,
            )
        )
    print_table(
        (
            "leg",
            "from (u, v)",
            "to (u, v)",
            f"first arrival ({unit})",
            f"last arrival ({unit})",
            f"{unit} per px",
            "pixels",
        ),
        rows,
        title="Legs in the picture (u = col, v = row, in pixels)",
    )


def _json_from_leg(leg: ImageLeg, unit: str) -> dict[str, object]:
    """One leg in the picture for programs; px, and ps or codes."""
    return {
        "points_px": leg.points_px(leg.extent_px),
        f"arrival_{unit}": leg.span_ps,
        # Per one: "codes" is a plural, "ps" is not.
        f"apparent_speed_px_per_{unit.removesuffix('s') if unit == 'codes' else unit}": (
            leg.apparent_speed_px_per_ps
        ),
        "n_pixels": leg.n_pixels,
    }
