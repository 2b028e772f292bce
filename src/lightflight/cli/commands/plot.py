"""`lightflight plot`: figures of any record."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from lightflight.cli.console import print_headline, print_written
from lightflight.cli.options import (
    PLOT_SUFFIXES,
    check_outputs,
    debug_option,
    hint_option,
    outputs_option,
    refuse_given,
    timing_option,
    with_lab,
)
from lightflight.cli.progress import step, writing
from lightflight.view.records import CLOCK_FIGURES, PATH_FIGURES, figure_of

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from lightflight.lab import Lab

RECORDING_FIGURES = ("picture", "pixel", "cases")


@click.command("plot", short_help="Draw a figure of a path, a calibration or a recording.")
@click.argument("file", type=click.Path(path_type=Path))
@click.option(
    "--what",
    type=click.Choice([*PATH_FIGURES, *CLOCK_FIGURES, *RECORDING_FIGURES]),
    help="Which figure.  [default: the one that shows most]",
)
@timing_option("Calibration of the clock, for figures of a recording.")
@click.option(
    "--pixel", nargs=2, type=click.IntRange(min=0), help="Row and column, for --what pixel."
)
@click.option(
    "--dpi",
    type=click.FloatRange(min=10, max=2000),
    help="Dots per inch of pixels.  [default: 200]",
)
@outputs_option("Figure to write (.png .pdf .svg); may be given more than once.", required=True)
@with_lab
@hint_option
@debug_option
def command(
    *,
    file: Path,
    what: str | None,
    timing_path: Path | None,
    pixel: tuple[int, int] | None,
    dpi: float | None,
    outputs: tuple[Path, ...],
    lab: Lab,
    hints: dict[str, object],
) -> None:
    """Draw a figure of what FILE holds.

    \b
    Of a path: summary, space, times (Fig. 6b), errors, residuals, residual-map, pulls.
    Of a calibration: clock (all of it), gain, phases, delays, response, pixels.
    Of a recording: picture (Fig. 2c), pixel (with --pixel ROW COLUMN), cases (Fig. 2b).

    \b
    Examples:
      lightflight plot path.h5 -o summary.pdf
      lightflight plot path.h5 --what times -o fig6b.svg
      lightflight plot recording.h5 --timing calibration.h5 --what pixel --pixel 12 16 -o p.png
    """
    check_outputs(outputs, suffixes=PLOT_SUFFIXES, kinds=())
    from lightflight.view.export.files import write_figure

    figure = _figure_of(file, what, timing_path, pixel, lab, hints)
    for output in outputs:
        with writing(output):
            write_figure(figure, output, dots_per_inch=dpi)
    print_written(outputs)


def _figure_of(
    file: Path,
    what: str | None,
    timing_path: Path | None,
    pixel: tuple[int, int] | None,
    lab: Lab,
    hints: dict[str, object],
) -> Figure:
    """Figure of what a file holds; UsageError where it cannot be drawn of that."""
    from lightflight.files.store import kind_of_record

    known: tuple[str, ...]
    match kind_of_record(file):
        case "path":
            from lightflight.path.light_path import LightPath

            kind, known = "path", PATH_FIGURES
            record: Any = LightPath.load(file, try_newer=True)
            print_headline(record.verdict)
        case "calibration":
            from lightflight.timing.clock.calibration import TimingCalibration

            kind, known = "calibration", CLOCK_FIGURES
            record = TimingCalibration.load(file)
        case _:
            kind, known = "recording", RECORDING_FIGURES
            record = None
    what = known[0] if what is None else what
    if what not in known:
        raise click.UsageError(
            f"--what {what}: {file.name} holds a {kind}, of which can be drawn: {', '.join(known)}"
        )
    if what != "pixel":
        refuse_given("pixel", why="goes with --what pixel, of a recording")
    if kind == "recording":
        return _recording_figure(file, what, timing_path, pixel, lab, hints)
    refuse_given("timing_path", "hints", why=f"goes with a recording: {file.name} holds a {kind}")
    return figure_of(record, what)


def _recording_figure(
    file: Path,
    what: str,
    timing_path: Path | None,
    pixel: tuple[int, int] | None,
    lab: Lab,
    hints: dict[str, object],
) -> Figure:
    """Figure of a recording, whose pulses are fitted for it."""
    from lightflight import view
    from lightflight.cli.records import calibration_from_option, read_histograms
    from lightflight.timing.pulses.arrivals import arrivals_from_pulses
    from lightflight.timing.pulses.pulses import fit_pulses

    if what == "pixel" and pixel is None:
        raise click.UsageError("--what pixel needs --pixel ROW COLUMN")
    hist = read_histograms(file, lab, hints)
    timing = calibration_from_option(timing_path)
    with step(f"fitting the pulses of {file.name}"):
        pulses = fit_pulses(hist, timing=timing)
    if what == "cases":
        return view.pixel_cases_figure(hist, pulses, timing=timing)
    if what == "pixel":
        row, col = pixel  # type: ignore[misc]
        rows, cols = hist.shape
        if row >= rows or col >= cols:
            raise click.UsageError(f"--pixel {row} {col}: the camera has {rows} x {cols} pixels")
        ax = view.draw_pixel_histogram(hist, row, col, pulses=pulses, timing=timing)
    else:
        # Without a time per code there is a picture all the same, in codes.
        known = timing is not None or hist.bin_width_ps is not None
        arrivals = arrivals_from_pulses(pulses, timing=timing)
        ax = view.draw_camera_picture(arrivals, unit="ps" if known else "codes")
    figure = ax.get_figure(root=True)
    assert figure is not None
    return figure
