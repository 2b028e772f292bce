"""`lightflight info`: what a file holds."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from lightflight.cli.console import Fact, report
from lightflight.cli.options import (
    PLOT_SUFFIXES,
    check_outputs,
    debug_option,
    hint_option,
    json_option,
    path_option,
    timing_option,
    with_lab,
)
from lightflight.cli.progress import step, writing

if TYPE_CHECKING:
    from lightflight.lab import Lab
    from lightflight.path.light_path import LightPath


@click.command("info", short_help="Say what a file holds.")
@click.argument("file", type=click.Path(path_type=Path))
@path_option(
    "--plot",
    help="Draw where and when the photons of a recording fall, into this file (.png .pdf .svg).",
)
@timing_option("Calibration of the clock: says how far it has drifted, FILE being a new flat.")
@click.option(
    "--slices",
    type=click.IntRange(min=2),
    help="Cut a long recording into this many stretches and say how its pulses move.",
)
@with_lab
@hint_option
@json_option
@debug_option
def command(
    *,
    file: Path,
    timing_path: Path | None,
    slices: int | None,
    plot: Path | None,
    lab: Lab,
    hints: dict[str, object],
    as_json: bool,
) -> None:
    """Say what FILE holds: a recording of any known format, a calibration or a path.

    \b
    Examples:
      lightflight info recording.h5 --plot recording.png
      lightflight info streak.mat --hint axes=tyx --hint bin_width_ps=7.5
      lightflight info new_flat.h5 --timing calibration.h5
      lightflight info long.h5 --slices 10
    """
    if plot is not None:
        check_outputs([plot], suffixes=PLOT_SUFFIXES, option="--plot")
    # Before anything is drawn: a file that cannot be read leaves no figure behind.
    path = _path_in(file)
    facts, sentences = _facts_of(file, lab, hints) if path is None else _path_facts(path)
    if plot is not None:
        _draw(file, lab, hints, plot)
        sentences = [*sentences, f"Written: {plot}"]
    facts = [Fact("file", "file", file.name), *facts]
    if timing_path is not None or slices is not None:
        from lightflight.cli.drift import drift_facts

        moved, words = drift_facts(file, lab, hints, timing_path=timing_path, slices=slices)
        facts, sentences = [*facts, *moved], [*sentences, *words]
    more = {}
    if path is not None:
        from lightflight.cli.paths import json_from_verdict, print_verdict

        more = json_from_verdict(path)
        if not as_json:
            print_verdict(path)
    report(facts, sentences, as_json=as_json, notes=sentences, **more)


def _path_in(file: Path) -> LightPath | None:
    """The path that a file holds; None where it holds anything else."""
    from lightflight.files.store import kind_of_record
    from lightflight.path.light_path import LightPath

    return LightPath.load(file) if kind_of_record(file) == "path" else None


def _facts_of(file: Path, lab: Lab, hints: dict[str, object]) -> tuple[list[Fact], list[str]]:
    """Facts and sentences about what a file holds."""
    from lightflight.files.store import kind_of_record

    match kind_of_record(file):
        case "calibration":
            return _calibration_facts(file)
        case "pulses" | "arrivals" as kind:
            return _table_facts(file, kind)
    return _recording_facts(file, lab, hints)


def _draw(file: Path, lab: Lab, hints: dict[str, object], plot: Path) -> None:
    """Draw where and when the photons of a recording fall."""
    from lightflight.cli.records import read_histograms
    from lightflight.files.store import kind_of_record

    if not file.is_dir() and kind_of_record(file) not in (None, "histograms", "recording"):
        raise click.UsageError(f"--plot draws recordings: lightflight plot {file.name} -o {plot}")
    from lightflight.view.export.files import write_figure
    from lightflight.view.figures.recording import recording_figure

    hist = read_histograms(file, lab, hints)
    with writing(plot):
        write_figure(recording_figure(hist, title=file.name), plot)


def _recording_facts(
    file: Path, lab: Lab, hints: dict[str, object]
) -> tuple[list[Fact], list[str]]:
    """Clock, photons and settings of a recording, and remarks about it."""
    from lightflight.cli.records import clock_facts, photon_facts, read_hinted
    from lightflight.recording.description import describe_recording

    record = read_hinted(file, lab, hints)
    with step(f"counting {file.name}") as progress:
        found = describe_recording(record, progress=progress)
    extra = {str(name): value for name, value in record.settings.items() if _fits_a_line(value)}
    facts = [
        Fact("holds", "kind", found.kind, f"recording ({found.kind})"),
        *clock_facts(record),
        *photon_facts(found),
        *(Fact(name, f"setting_{name}", value) for name, value in extra.items()),
    ]
    notes = [*found.remarks, *found.missing]
    if record.truth is not None:
        notes.append("Made by a simulation, whose truth is in the file.")
    return facts, notes


def _fits_a_line(value: object) -> bool:
    """Whether a setting can be told in a line: no array, no long text."""
    return isinstance(value, int | float | bool) or (isinstance(value, str) and len(value) < 200)


def _calibration_facts(file: Path) -> tuple[list[Fact], list[str]]:
    """What a calibration file holds."""
    from lightflight.cli.commands.calibrate import calibration_facts
    from lightflight.timing.clock.calibration import TimingCalibration

    calibration = TimingCalibration.load(file)
    holds = Fact("holds", "kind", "calibration", "calibration of a clock")
    return [holds, *calibration_facts(calibration)], list(calibration.notes)


def _path_facts(path: LightPath) -> tuple[list[Fact], list[str]]:
    """What a path file holds."""
    from lightflight.cli.paths import path_facts

    holds = Fact("holds", "kind", "path", "path of a pulse")
    return [holds, *path_facts(path)], list(path.statements)


def _table_facts(file: Path, kind: str) -> tuple[list[Fact], list[str]]:
    """Rows and settings of a table of pulses."""
    from lightflight.files.store import load_record

    arrays, attributes = load_record(file, kind=kind)
    rows = max((len(array) for array in arrays.values() if array.ndim), default=0)
    extra = [Fact(name, name, value) for name, value in attributes.items() if _fits_a_line(value)]
    return [Fact("holds", "kind", kind), Fact("rows", "rows", rows), *extra], []
