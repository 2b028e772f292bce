"""`lightflight view`: one offline page about a reconstruction."""

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

PAGE_SUFFIXES = (".html", ".htm")


@click.command("view", short_help="Make a page that shows a path, to open in any browser.")
@click.argument("paths", nargs=-1, required=True, type=click.Path(path_type=Path))
@click.option(
    "--recording",
    "recording_path",
    type=click.Path(path_type=Path),
    help="Recording the path was made from: adds the pixels' histograms.",
)
@click.option(
    "--timing",
    "timing_path",
    type=click.Path(path_type=Path),
    help="Calibration of the clock it was made with.",
)
@click.option(
    "--from-lab-camera",
    is_flag=True,
    help="Add what the camera of --lab would see of the path, as a second viewpoint.",
)
@click.option(
    "--viewpoint",
    "viewpoint_mm",
    nargs=3,
    type=float,
    metavar="X Y Z",
    help="Add what a camera at this place (mm), turned towards the path, would see of it.",
)
@click.option("--title", default="", help="Heading of the page.")
@click.option("--open", "show", is_flag=True, help="Open the page in the browser.")
@outputs_option("Page to write (.html).  [default: the path's name, ending in .html]")
@lab_options
@hint_option
@debug_option
def command(
    *,
    paths: tuple[Path, ...],
    recording_path: Path | None,
    timing_path: Path | None,
    from_lab_camera: bool,
    viewpoint_mm: tuple[float, float, float] | None,
    title: str,
    show: bool,
    outputs: tuple[Path, ...],
    lab_path: Path | None,
    assignments: tuple[str, ...],
    hints: dict[str, Any],
    dry_run: bool,
) -> None:
    """Make one self-contained page about the path in PATHS (path files of `reconstruct`).

    The page needs nothing but a browser, and no network: it can be sent by e-mail. With several
    path files, an index with a small picture of each is written, and a page for each beside it.

    \b
    Examples:
      lightflight view path.h5 --recording recording.h5 --timing calibration.h5
      lightflight view path.h5 --viewpoint 900 40 30
      lightflight view run-*/path.h5 -o campaign.html
    """
    from lightflight.cli._records import lab_from_options, print_lab

    lab = lab_from_options(lab_path, assignments)
    if dry_run:
        print_lab(lab)
        return
    inputs = [p for p in (*paths, recording_path, timing_path, lab_path) if p is not None]
    if len(outputs) > 1:
        raise click.UsageError("-o may be given once: there is one page")
    if len(paths) > 1:
        output = outputs[0] if outputs else Path("campaign.html")
    else:
        output = outputs[0] if outputs else paths[0].with_suffix(".html")
    check_outputs([output], inputs=inputs, suffixes=PAGE_SUFFIXES, kinds=())
    if from_lab_camera and lab.camera is None:
        raise click.UsageError("--from-lab-camera needs a camera: --lab with [camera]")
    if from_lab_camera and viewpoint_mm is not None:
        raise click.UsageError("--from-lab-camera and --viewpoint exclude each other")
    if len(paths) > 1:
        for name, given in (
            ("recording", recording_path is not None),
            ("from-lab-camera", from_lab_camera),
            ("viewpoint", viewpoint_mm is not None),
        ):
            if given:
                raise click.UsageError(f"--{name} goes with one path file, got several")
        _write_campaign(paths, timing_path, title, output)
    else:
        camera = lab.camera if from_lab_camera else None
        _write_one(
            paths[0], recording_path, timing_path, lab, hints, title, camera, viewpoint_mm, output
        )
    print_sentences([f"Written: {output}"])
    if show:
        click.launch(str(output))


def _write_one(
    path_file: Path,
    recording_path: Path | None,
    timing_path: Path | None,
    lab: Lab,
    hints: dict[str, Any],
    title: str,
    second_camera: Any,
    viewpoint_mm: tuple[float, float, float] | None,
    output: Path,
) -> None:
    from lightflight.cli._records import calibration_from_option, read_histograms
    from lightflight.path import LightPath
    from lightflight.view.page import write_page

    path = LightPath.load(path_file, try_newer=True)
    timing = calibration_from_option(timing_path)
    recording = None if recording_path is None else read_histograms(recording_path, lab, hints)
    if viewpoint_mm is not None:
        from lightflight.view.observation import camera_towards

        second_camera = camera_towards(path, viewpoint_mm)
    with step(f"writing {output.name}"):
        write_page(
            path,
            output,
            recording=recording,
            timing=timing,
            title=title,
            second_camera=second_camera,
        )


def _write_campaign(
    paths: tuple[Path, ...], timing_path: Path | None, title: str, output: Path
) -> None:
    from lightflight.cli._records import calibration_from_option
    from lightflight.view.page.campaign import write_campaign

    timing = calibration_from_option(timing_path)
    with step(f"writing {output.name} and {len(paths)} pages") as report:
        write_campaign(paths, output, timing=timing, title=title, progress=report)
