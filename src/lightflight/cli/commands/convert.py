"""`lightflight convert`: a recording in another format."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from lightflight.cli.console import print_json, print_sentences
from lightflight.cli.options import (
    Command,
    debug_option,
    hint_option,
    json_option,
    outputs_option,
    with_lab,
)
from lightflight.cli.progress import Progress, step, writing

if TYPE_CHECKING:
    from lightflight.lab import Lab
    from lightflight.recording.histograms import Histograms
    from lightflight.recording.recording import Recording

SUFFIXES = (".h5", ".hdf5", ".npz", ".mat", ".zarr", ".bin", ".raw", ".csv", ".parquet")
"""What can be written without naming a format; ".photon.h5" ends in one of them."""

_COUNTED = (".npz", ".mat", ".zarr")
"""Formats that hold histograms alone."""


def _range_option(name: str, what: str) -> Callable[[Command], Command]:
    """Option that keeps a run of codes, rows, columns or frames."""
    return click.option(
        f"--{name}",
        nargs=2,
        type=click.IntRange(min=0),
        metavar="START END",
        help=f"Keep {what} START ... END - 1 alone.",
    )


@click.command("convert", short_help="Write a recording in another format.")
@click.argument("file", type=click.Path(path_type=Path))
@click.option("--counted", is_flag=True, help="Count photons into histograms, whatever the format.")
@_range_option("codes", "codes")
@_range_option("rows", "rows")
@_range_option("cols", "columns")
@_range_option("frames", "frames")
@outputs_option(
    "File to write (.h5 .photon.h5 .zarr .npz .mat .bin .csv .parquet); may be given more than "
    "once.",
    required=True,
)
@with_lab
@hint_option
@json_option
@debug_option
def command(
    *,
    file: Path,
    counted: bool,
    codes: tuple[int, int] | None,
    rows: tuple[int, int] | None,
    cols: tuple[int, int] | None,
    frames: tuple[int, int] | None,
    outputs: tuple[Path, ...],
    lab: Lab,
    hints: dict[str, object],
    as_json: bool,
) -> None:
    """Write the recording in FILE, of any format that can be read, in other formats.

    .h5, .photon.h5, .csv and .parquet keep single photons; .npz, .mat and .zarr hold histograms,
    for which photons are counted, as they are to keep a part (--codes, --rows, --cols, --frames).
    Paths are written for other programs by `lightflight export`.

    \b
    Examples:
      lightflight convert frames.bin -o recording.h5
      lightflight convert series.mat --hint axes=tyx --hint bin_width_ps=55 -o recording.h5
      lightflight convert recording.h5 --codes 200 400 -o window.npz -o window.mat
    """
    from lightflight.cli.records import read_hinted

    _check_targets(outputs, file)
    record = read_hinted(file, lab, hints)
    parts = {"codes": codes, "rows": rows, "cols": cols, "frames": frames}
    window = {name: part for name, part in parts.items() if part is not None}
    counts: Histograms | None = None
    written = []
    for output in outputs:
        what = record
        if counted or window or output.suffix.lower() in _COUNTED:
            if counts is None:  # once, for all outputs that hold counts
                with step(f"counting {file.name}") as report:
                    counts = _counted(record, window, report)
            what = counts
        with writing(output):
            _write(what, output, file)
        written.append(_said(what, record, output))
    if as_json:
        print_json({"written": [str(output) for output in outputs]})
        return
    print_sentences(written)


def _check_targets(outputs: Iterable[Path], file: Path) -> None:
    """Refuse, before any work, outputs that cannot or must not be written."""
    for output in outputs:
        if output.suffix.lower() not in SUFFIXES:
            raise click.UsageError(f"-o {output}: the name must end in {' or '.join(SUFFIXES)}")
        if not output.parent.is_dir():
            raise click.UsageError(f"-o {output}: make the folder {output.parent} first")
        if output.exists():
            raise click.UsageError(
                f"-o {output}: exists; a recording is never replaced, choose another name"
            )
    # Zarr is a folder that is one recording.
    if file.is_dir() and file.suffix.lower() != ".zarr":
        raise click.UsageError(f"{file}: is a folder, name a file in it")


def _counted(
    record: Recording | Histograms, window: Mapping[str, Any], report: Progress
) -> Histograms:
    """Histograms of a recording, or of a part of it."""
    from lightflight.recording.counting import histogram

    return histogram(record, progress=report, **window)


def _write(record: Recording | Histograms, output: Path, file: Path) -> None:
    """Write a record; formats that can say so are told where it came from."""
    from lightflight.formats.registry import format_to_write, write
    from lightflight.provenance import provenance_record

    options = {}
    if "provenance" in format_to_write(output).options:
        options["provenance"] = provenance_record(command="lightflight convert", inputs=[file])
    write(record, output, **options)


def _said(what: Recording | Histograms, record: Recording | Histograms, output: Path) -> str:
    """What was written, in a sentence."""
    if what is not record:
        return f"Written: {output} (histograms)."
    kind = getattr(record, "kind", "histograms")
    return f"Written: {output} ({'photons' if kind != 'histograms' else kind})."
