"""`lightflight movie`: the flight, or a recording, as a film."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from lightflight.cli._console import print_sentences, step
from lightflight.cli._options import (
    check_outputs,
    debug_option,
    hint_option,
    lab_options,
    outputs_option,
)

if TYPE_CHECKING:
    from lightflight.lab import Lab

MOVIE_SUFFIXES = (".mp4", ".gif")


def _size_from_text(
    _context: click.Context, _option: click.Parameter, text: str
) -> tuple[int, int]:
    width, cross, height = text.lower().partition("x")
    if not (cross and width.isdigit() and height.isdigit()):
        raise click.BadParameter(f"{text!r}: write WIDTHxHEIGHT in pixels, for example 1280x720")
    return int(width), int(height)


@click.command("movie", short_help="Make a film of a flight, or of a recording.")
@click.argument("file", type=click.Path(path_type=Path))
@click.option("--fps", type=click.FloatRange(1, 120), help="Frames per second.")
@click.option(
    "--size",
    "size_px",
    default="1280x720",
    show_default=True,
    callback=_size_from_text,
    help="Width x height, px, both even.",
)
@click.option(
    "--pace",
    type=click.FloatRange(min=1e-3),
    default=300.0,
    show_default=True,
    help="Of a flight: picoseconds shown in a second.",
)
@click.option(
    "--orbit",
    type=float,
    default=0.0,
    show_default=True,
    help="Of a flight: degrees the viewer goes around the scene.",
)
@click.option(
    "--from-lab-camera",
    is_flag=True,
    help="Of a flight: show what the camera of --lab would see, instead of the path's own.",
)
@click.option(
    "--viewpoint",
    "viewpoint_mm",
    nargs=3,
    type=float,
    metavar="X Y Z",
    help="Of a flight: show what a camera at this place (mm), turned towards the path, would see.",
)
@click.option(
    "--slice-codes",
    type=click.IntRange(min=1),
    default=1,
    show_default=True,
    help="Of a recording: TDC codes in one frame.",
)
@click.option("--title", default="", help="Of a recording: heading of the film.")
@outputs_option("Film to write (.mp4 .gif).", required=True)
@lab_options
@hint_option
@debug_option
def command(
    *,
    file: Path,
    fps: float | None,
    size_px: tuple[int, int],
    pace: float,
    orbit: float,
    from_lab_camera: bool,
    viewpoint_mm: tuple[float, float, float] | None,
    slice_codes: int,
    title: str,
    outputs: tuple[Path, ...],
    lab_path: Path | None,
    assignments: tuple[str, ...],
    hints: dict[str, Any],
    dry_run: bool,
) -> None:
    """Make a film of what FILE holds: a path (both clocks side by side) or a recording.

    A film of a recording shows at once whether a measurement worked: nothing is fitted for it.

    \b
    Examples:
      lightflight movie path.h5 -o flight.mp4
      lightflight movie path.h5 --pace 100 --orbit 60 -o flight.gif --size 640x360
      lightflight movie path.h5 --viewpoint 900 40 30 -o from-the-side.mp4
      lightflight movie recording.h5 -o recording.mp4
    """
    from lightflight.cli._records import lab_from_options, print_lab
    from lightflight.store import kind_of_record

    lab = lab_from_options(lab_path, assignments)
    if dry_run:
        print_lab(lab)
        return
    inputs = [p for p in (file, lab_path) if p is not None]
    check_outputs(outputs, inputs=inputs, suffixes=MOVIE_SUFFIXES, kinds=())
    if from_lab_camera and lab.camera is None:
        raise click.UsageError("--from-lab-camera needs a camera: --lab with [camera]")
    if from_lab_camera and viewpoint_mm is not None:
        raise click.UsageError("--from-lab-camera and --viewpoint exclude each other")
    kind = kind_of_record(file)
    if kind == "calibration":
        raise click.UsageError(f"{file.name} holds a calibration: there is nothing that moves")
    for output in outputs:
        with step(f"filming {output.name}") as report:
            if kind == "path":
                camera = lab.camera if from_lab_camera else None
                _film_path(
                    file, output, camera, viewpoint_mm, size_px, fps or 25.0, pace, orbit, report
                )
            else:
                _film_recording(
                    file, output, lab, hints, size_px, fps or 12.0, slice_codes, title, report
                )
    print_sentences([f"Written: {', '.join(map(str, outputs))}"])


def _film_path(
    file: Path,
    output: Path,
    camera: Any,
    viewpoint_mm: tuple[float, float, float] | None,
    size_px: tuple[int, int],
    fps: float,
    pace: float,
    orbit: float,
    report: Any,
) -> None:
    from lightflight.path import LightPath
    from lightflight.view.movie import MovieSettings, write_movie

    settings = MovieSettings(
        size_px=size_px, frames_per_second=fps, pace_ps_per_s=pace, orbit_deg=orbit
    )
    path = LightPath.load(file, try_newer=True)
    if viewpoint_mm is not None:
        from lightflight.view.observation import camera_towards

        camera = camera_towards(path, viewpoint_mm)
    write_movie(path, output, camera=camera, settings=settings, progress=report)


def _film_recording(
    file: Path,
    output: Path,
    lab: Lab,
    hints: dict[str, Any],
    size_px: tuple[int, int],
    fps: float,
    slice_codes: int,
    title: str,
    report: Any,
) -> None:
    from lightflight.cli._records import read_histograms
    from lightflight.view.movie_recording import write_recording_movie

    write_recording_movie(
        read_histograms(file, lab, hints),
        output,
        slice_codes=slice_codes,
        size_px=size_px,
        frames_per_second=fps,
        title=title or file.name,
        progress=report,
    )
