"""`python -m studies.zheng2020`: the paper's experiments on the twin, figure by figure."""

from __future__ import annotations

import json
import os
import time
from collections.abc import Iterable, Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import click

from lightflight._version import __version__
from lightflight.cli.console import print_json, print_sentences, print_table
from lightflight.cli.options import json_option, seed_option
from lightflight.cli.progress import step
from lightflight.files.json_values import json_value
from lightflight.files.whole_file import atomic_path
from lightflight.view.export.files import write_figure
from lightflight.view.film.encode import Frame
from studies.zheng2020.discussion import NOT_COVERED
from studies.zheng2020.figures import visualization1_frames
from studies.zheng2020.run import CHOICES, EXPERIMENTS, records_of_results
from studies.zheng2020.table import (
    COLUMNS,
    Row,
    cells_of_row,
    markdown_from_rows,
    note_from_records,
    rows_from_records,
    values_of_row,
)


@click.command("zheng2020")
@click.argument("what", type=click.Choice(tuple(CHOICES)), default="all")
@click.option(
    "-o",
    "--output",
    type=click.Path(path_type=Path, file_okay=False),
    default=Path("out/paper"),
    show_default=True,
    help="Folder for figures, the table and finished pieces of work; made if needed.",
)
@click.option(
    "--quick", is_flag=True, help="Few angles and recordings: a minute instead of half an hour."
)
@click.option("--fresh", is_flag=True, help="Do again what the folder holds already.")
@click.option(
    "--workers",
    type=click.IntRange(min=1),
    help="Processes that share the work.  [default: one per core, at most 4]",
)
@seed_option()
@json_option
def command(
    *,
    what: str,
    output: Path,
    quick: bool,
    fresh: bool,
    workers: int | None,
    seed: int,
    as_json: bool,
) -> None:
    """Simulate the paper's experiments, reconstruct them every way, draw its figures.

    WHAT is one figure, the discussion, the table of every number, or all. Each finished piece
    of work is kept in OUTPUT/units: a run that was stopped goes on where it was.

    \b
    Examples:
      make paper-quick
      make paper ARGS="fig6"
      make paper ARGS="table --json"
    """
    started = time.perf_counter()
    output.mkdir(parents=True, exist_ok=True)
    with step("the paper's experiments", always=True) as report:

        def progress(name: str, done: int, total: int) -> None:
            report(done, total)
            click.echo(f"  {done:>3} of {total}  {name}", err=True)

        records = records_of_results(
            CHOICES[what],
            output / "units",
            quick=quick,
            seed=seed,
            workers=workers or min(4, os.cpu_count() or 1),
            fresh=fresh,
            progress=progress,
        )
    written = [] if what == "table" else _draw(records, output)
    rows = rows_from_records(records)
    about = {
        "lightflight": __version__,
        "seed": seed,
        "quick": quick,
        "made_utc": datetime.now(UTC).date().isoformat(),
    }
    notes = [note_from_records(records), NOT_COVERED if "discussion" in records else ""]
    notes = [note for note in notes if note]
    if rows:
        name = "table" if what in ("all", "table") else f"{what}-table"
        written += _write_table(rows, about, output / name, notes=notes)
    seconds = time.perf_counter() - started
    if as_json:
        listed = [values_of_row(row) for row in rows]
        print_json(
            {**about, "rows": listed, "notes": notes, "written": written,
             "seconds": round(seconds, 1)}
        )  # fmt: skip
        return
    if rows:
        print_table(
            COLUMNS[:-1],
            [cells_of_row(row)[:-1] for row in rows],
            title="The paper's numbers: measured in its laboratory, and ours on the twin",
            n_text_columns=2,
        )
    print_sentences([*notes, f"Written: {', '.join(written)}. {seconds:.0f} s."])
    if "fig6" in records:
        path = output / "units" / "legs-00-joint.h5"
        print_sentences([f"Visualization 1 as a film: lightflight movie {path} -o flight.mp4"])


def _draw(records: dict[str, Any], output: Path) -> list[str]:
    """Write one figure per record, and the frames of the film; their names."""
    written = []
    with step("drawing"):
        for name, record in records.items():
            write_figure(EXPERIMENTS[name].draw(record), output / f"{name}.png")
            written.append(str(output / f"{name}.png"))
        if "fig6" in records:
            folder = output / "visualization1"
            n_frames = write_pictures(visualization1_frames(records["fig6"]), folder)
            written.append(f"{folder} ({n_frames} frames)")
    return written


def write_pictures(frames: Iterable[Frame], folder: Path) -> int:
    """Write frames as frame-0000.png ... into a folder, in place of those there; how many.

    Parameters
    ----------
    frames : iterable of arrays
        Pictures (height, width, 3).
    folder : Path
        Where to; made if it is not there.
    """
    from PIL import Image

    folder.mkdir(parents=True, exist_ok=True)
    # Frames of a longer film before would be taken for the end of this one.
    for old in folder.glob("frame-????.png"):
        old.unlink()
    n_frames = 0
    for frame in frames:
        with atomic_path(folder / f"frame-{n_frames:04d}.png") as fresh:
            Image.fromarray(frame).save(fresh, format="PNG", compress_level=3)
        n_frames += 1
    return n_frames


def _write_table(
    rows: tuple[Row, ...], about: dict[str, Any], stem: Path, *, notes: Sequence[str]
) -> list[str]:
    """Write the table as Markdown and as JSON; their names."""
    values = json_value({**about, "rows": [values_of_row(row) for row in rows]})
    texts = {
        ".md": markdown_from_rows(rows, about, notes=notes),
        ".json": json.dumps(values, indent=2, ensure_ascii=False),
    }
    for suffix, text in texts.items():
        with atomic_path(stem.with_name(stem.name + suffix)) as fresh:
            fresh.write_text(text, encoding="utf-8")
    return [f"{stem}{suffix}" for suffix in texts]
