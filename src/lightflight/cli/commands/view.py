"""`lightflight view`: one offline page about a reconstruction."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from lightflight.cli.console import print_headline, print_written
from lightflight.cli.options import (
    check_outputs,
    check_viewpoint,
    debug_option,
    hint_option,
    outputs_option,
    path_option,
    refuse_given,
    timing_option,
    viewpoint_options,
    with_lab,
)
from lightflight.cli.progress import step

if TYPE_CHECKING:
    from lightflight.camera.model import Camera
    from lightflight.lab import Lab
    from lightflight.path.light_path import LightPath

PAGE_SUFFIXES = (".html", ".htm")


@click.command("view", short_help="Make a page that shows a path, to open in any browser.")
@click.argument("paths", nargs=-1, required=True, type=click.Path(path_type=Path))
@path_option(
    "--recording",
    "recording_path",
    help="Recording the path was made from: adds the pixels' histograms.",
)
@timing_option("Calibration of the clock it was made with.")
@viewpoint_options(
    "Add what the camera of --lab would see of the path, as a second viewpoint.",
    "Add what a camera at this place (mm), turned towards the path, would see of it.",
)
@click.option("--title", default="", help="Heading of the page.")
@click.option("--open", "show", is_flag=True, help="Open the page in the browser.")
@outputs_option("Page to write (.html).  [default: the path's name, ending in .html]")
@with_lab
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
    lab: Lab,
    hints: dict[str, object],
) -> None:
    """Make one self-contained page about the path in PATHS (path files of `reconstruct`).

    The page needs nothing but a browser, and no network: it can be sent by e-mail. With several
    path files, an index with a small picture of each is written, and a page for each beside it.
    These share parts in their folder: give such a page in place of a path file to make it whole.

    \b
    Examples:
      lightflight view path.h5 --recording recording.h5 --timing calibration.h5
      lightflight view path.h5 --viewpoint 900 40 30
      lightflight view run-*/path.h5 -o campaign.html
      lightflight view campaign_pages/0001.html -o first.html
    """
    if len(outputs) > 1:
        raise click.UsageError("-o may be given once: there is one page")
    pages = [one for one in paths if one.suffix.lower() in PAGE_SUFFIXES]
    if len(paths) > 1:
        output = outputs[0] if outputs else Path("campaign.html")
    elif pages:
        output = outputs[0] if outputs else paths[0].with_stem(f"{paths[0].stem}_whole")
    else:
        output = outputs[0] if outputs else paths[0].with_suffix(".html")
    check_outputs([output], suffixes=PAGE_SUFFIXES, kinds=())
    check_viewpoint(lab, from_lab_camera=from_lab_camera, viewpoint_mm=viewpoint_mm)
    if pages:
        options = (recording_path, timing_path, from_lab_camera, viewpoint_mm, title)
        _write_whole(paths, options, output)
        print_written([output])
        if show:
            click.launch(str(output))
        return
    # What goes with one path alone would have to be of all of them.
    if len(paths) > 1:
        of_one = ("recording_path", "from_lab_camera", "viewpoint_mm")
        refuse_given(*of_one, why="goes with one path file, got several")
        _write_campaign(paths, timing_path, title, output)
    else:
        camera = lab.camera if from_lab_camera else None
        _write_one(
            paths[0], recording_path, timing_path, lab, hints, title, camera, viewpoint_mm, output
        )
    print_written([output])
    if show:
        click.launch(str(output))


def _write_one(
    path_file: Path,
    recording_path: Path | None,
    timing_path: Path | None,
    lab: Lab,
    hints: dict[str, object],
    title: str,
    second_camera: Camera | None,
    viewpoint_mm: tuple[float, float, float] | None,
    output: Path,
) -> None:
    """Write the page of one path."""
    from lightflight.cli.records import calibration_from_option, read_histograms
    from lightflight.path.light_path import LightPath
    from lightflight.view.page import write_page

    path = LightPath.load(path_file, try_newer=True)
    print_headline(path.verdict)
    for given in (recording_path, timing_path):
        if given is not None:
            _warn_of_another(path, given)
    timing = calibration_from_option(timing_path)
    recording = None if recording_path is None else read_histograms(recording_path, lab, hints)
    if viewpoint_mm is not None:
        from lightflight.path.second_view import camera_towards

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


def _warn_of_another(path: LightPath, given: Path) -> None:
    """Say that a path was not made from a file, where it says what it was made from."""
    import warnings

    from lightflight.errors import SuspectDataWarning
    from lightflight.provenance import input_record

    made_from = [one for one in path.provenance.get("inputs", ()) if "sha256" in one]
    if not made_from or not given.exists():
        return
    if input_record(given)["sha256"] in {one["sha256"] for one in made_from}:
        return
    names = ", ".join(one["name"] for one in made_from)
    warnings.warn(
        f"{given}: the path was not made from it, but from {names}: what the page shows of single "
        "pixels may be of another flight",
        SuspectDataWarning,
        stacklevel=2,
    )


def _write_whole(paths: tuple[Path, ...], options: tuple[object, ...], output: Path) -> None:
    """Write a page of a campaign with its parts in it."""
    if len(paths) > 1:
        raise click.UsageError("a page is made whole alone: give one, or path files only")
    if any(options):
        raise click.UsageError("a page is made whole as it is: give no options but -o and --open")
    from lightflight.files.whole_file import write_text
    from lightflight.view.page.parts import whole_html

    write_text(output, whole_html(paths[0]))


def _write_campaign(
    paths: tuple[Path, ...], timing_path: Path | None, title: str, output: Path
) -> None:
    """Write an index of several paths, and a page for each beside it."""
    from lightflight.cli.records import calibration_from_option
    from lightflight.view.page.campaign import write_campaign

    timing = calibration_from_option(timing_path)
    with step(f"writing {output.name} and {len(paths)} pages") as report:
        write_campaign(paths, output, timing=timing, title=title, progress=report)
