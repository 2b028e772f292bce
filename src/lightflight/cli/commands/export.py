"""`lightflight export`: a path in the formats of other programs."""

from __future__ import annotations

from pathlib import Path

import click

from lightflight.cli.console import print_headline, print_written
from lightflight.cli.options import check_outputs, debug_option, outputs_option, refuse_given
from lightflight.cli.progress import writing
from lightflight.view.suffixes import EXPORT_SUFFIXES, TABLE_SUFFIXES


@click.command("export", short_help="Write a path for other programs.")
@click.argument("file", type=click.Path(path_type=Path))
@click.option(
    "--what",
    type=click.Choice(["samples", "pulses", "vertices"]),
    default="samples",
    show_default=True,
    help="Table for .csv and .parquet.",
)
@click.option(
    "--samples",
    type=click.IntRange(min=2, max=10_000_000),
    default=1000,
    show_default=True,
    help="Points along the path, at equal event times.",
)
@outputs_option(
    "File to write: table (.csv .parquet), MATLAB (.mat), ParaView (.vtu), slides (.glb); may be "
    "given more than once.",
    required=True,
)
@debug_option
def command(*, file: Path, what: str, samples: int, outputs: tuple[Path, ...]) -> None:
    """Write the path in FILE (a path file of `reconstruct`) for other programs.

    \b
    Examples:
      lightflight export path.h5 -o path.csv -o path.mat
      lightflight export path.h5 --what pulses -o pulses.parquet
      lightflight export path.h5 -o path.vtu -o path.glb
    """
    check_outputs(outputs, suffixes=EXPORT_SUFFIXES, kinds=())
    if not any(output.suffix.lower() in TABLE_SUFFIXES for output in outputs):
        refuse_given("what", why=f"goes with a table: {' or '.join(TABLE_SUFFIXES)}")
    from lightflight.path.light_path import LightPath
    from lightflight.view.export.files import export_path

    path = LightPath.load(file)
    print_headline(path.verdict)
    for output in outputs:
        with writing(output):
            export_path(path, output, what=what, samples=samples)
    print_written(outputs)
