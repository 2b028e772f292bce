"""`lightflight movie`: the flight, or a recording, as a film."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import click

from lightflight.cli.console import print_headline, print_written
from lightflight.cli.options import (
    check_outputs,
    check_viewpoint,
    debug_option,
    hint_option,
    outputs_option,
    refuse_given,
    timing_option,
    viewpoint_options,
    with_lab,
)
from lightflight.cli.progress import Progress, writing
from lightflight.view.suffixes import MOVIE_SUFFIXES

if TYPE_CHECKING:
    from lightflight.camera.model import Camera
    from lightflight.lab import Lab


def _size_from_text(
    _context: click.Context, _option: click.Parameter, text: str
) -> tuple[int, int]:
    """(width, height), px, from "1280x720"."""
    width, cross, height = text.lower().partition("x")
    if not (cross and width.isdigit() and height.isdigit()):
        raise click.BadParameter(f"{text!r}: write WIDTHxHEIGHT in pixels, for example 1280x720")
    return int(width), int(height)


@click.command("movie", short_help="Make a film of a flight, or of a recording.")
@click.argument("file", type=click.Path(path_type=Path))
@click.option(
    "--fps",
    type=click.FloatRange(1, 120),
    help="Frames per second.  [default: 25; of a recording 12]",
)
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
@viewpoint_options(
    "Of a flight: show what the camera of --lab would see, instead of the path's own.",
    "Of a flight: show what a camera at this place (mm), turned towards the path, would see.",
)
@click.option(
    "--slice-codes",
    type=click.IntRange(min=1),
    help="Of a recording: TDC codes in one frame.  [default: 1; more of a long one]",
)
@timing_option("Of a recording: calibration, whose clocks put its pixels in time.")
@click.option("--title", default="", help="Of a recording: heading of the film.")
@outputs_option("Film to write (.mp4 .gif).", required=True)
@with_lab
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
    slice_codes: int | None,
    timing_path: Path | None,
    title: str,
    outputs: tuple[Path, ...],
    lab: Lab,
    hints: dict[str, object],
) -> None:
    """Make a film of what FILE holds: a path (both clocks side by side) or a recording.

    A film of a recording shows at once whether a measurement worked: nothing is fitted for it.

    \b
    Examples:
      lightflight movie path.h5 -o flight.mp4
      lightflight movie path.h5 --pace 100 --orbit 60 -o flight.gif --size 640x360
      lightflight movie path.h5 --viewpoint 900 40 30 -o from-the-side.mp4
      lightflight movie recording.h5 --timing calibration.h5 -o recording.mp4
    """
    from lightflight.files.store import kind_of_record

    check_outputs(outputs, suffixes=MOVIE_SUFFIXES, kinds=())
    check_viewpoint(lab, from_lab_camera=from_lab_camera, viewpoint_mm=viewpoint_mm)
    kind = kind_of_record(file)
    if kind == "calibration":
        raise click.UsageError(f"{file.name} holds a calibration: there is nothing that moves")
    size = Size(size_px, fps)
    film: Film
    if kind == "path":
        of_recording = ("slice_codes", "timing_path", "title", "hints")
        refuse_given(*of_recording, why=f"goes with a recording: {file.name} holds a path")
        camera = lab.camera if from_lab_camera else None
        film = _film_of_path(file, camera, viewpoint_mm, size, pace, orbit)
    else:
        of_path = ("pace", "orbit", "from_lab_camera", "viewpoint_mm")
        refuse_given(*of_path, why=f"goes with a path: {file.name} holds a recording")
        film = _film_of_recording(file, lab, hints, size, slice_codes, timing_path, title)
    for output in outputs:
        with writing(output, verb="filming") as report:
            film(output, report)
    print_written(outputs)


class Size(NamedTuple):
    """Of a film."""

    px: tuple[int, int]
    """Width and height."""
    fps: float | None
    """Frames per second, as told."""


Film = Callable[[Path, Progress], None]
"""Writes itself to a file."""


def _film_of_path(
    file: Path,
    camera: Camera | None,
    viewpoint_mm: tuple[float, float, float] | None,
    size: Size,
    pace: float,
    orbit: float,
) -> Film:
    """Film of a flight, from the path's own camera, the lab's, or one at a place."""
    from lightflight.path.light_path import LightPath
    from lightflight.view.film.flight import MovieSettings, write_movie

    settings = MovieSettings(
        size_px=size.px, frames_per_second=size.fps or 25.0, pace_ps_per_s=pace, orbit_deg=orbit
    )
    path = LightPath.load(file, try_newer=True)
    print_headline(path.verdict)
    if viewpoint_mm is not None:
        from lightflight.path.second_view import camera_towards

        camera = camera_towards(path, viewpoint_mm)
    return lambda output, report: write_movie(
        path, output, camera=camera, settings=settings, progress=report
    )


def _film_of_recording(
    file: Path,
    lab: Lab,
    hints: dict[str, object],
    size: Size,
    slice_codes: int | None,
    timing_path: Path | None,
    title: str,
) -> Film:
    """Film of the counts of a recording, slice by slice."""
    from lightflight.cli.records import calibration_from_option, read_histograms
    from lightflight.view.film.recording import write_recording_movie

    hist = read_histograms(file, lab, hints)
    timing = calibration_from_option(timing_path)
    return lambda output, report: write_recording_movie(
        hist,
        output,
        slice_codes=slice_codes,
        timing=timing,
        size_px=size.px,
        frames_per_second=size.fps or 12.0,
        title=title or file.name,
        progress=report,
    )
