"""`lightflight paper`: the experiments of Zheng et al. 2020 on the twin, figure by figure."""

from __future__ import annotations

import os
import time
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from lightflight.cli._console import print_json, print_sentences, print_table, step
from lightflight.cli._options import debug_option, json_option, seed_option

if TYPE_CHECKING:
    from lightflight.zheng2020.table import Row

_CHOICES = ("all", "fig2", "fig4", "fig5a", "fig5b", "fig5c", "fig6", "discussion", "table")


@click.command("paper", short_help="Do the paper's experiments again, and compare.")
@click.argument("what", type=click.Choice(_CHOICES), default="all")
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
@seed_option
@json_option
@debug_option
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
      lightflight paper --quick
      lightflight paper fig6
      lightflight paper table --json
    """
    from lightflight.zheng2020.run import CHOICES, records_of_results
    from lightflight.zheng2020.table import rows_from_records

    started = time.perf_counter()
    names = CHOICES[what]
    output.mkdir(parents=True, exist_ok=True)
    workers = workers or min(4, os.cpu_count() or 1)
    with step("the paper's experiments", always=True) as report:

        def progress(name: str, done: int, total: int) -> None:
            report(done, total)
            click.echo(f"  {done:>3} of {total}  {name}", err=True)

        records = records_of_results(
            names,
            output / "units",
            quick=quick,
            seed=seed,
            workers=workers,
            fresh=fresh,
            progress=progress,
        )
    written = [] if what == "table" else _draw(records, output)
    rows = rows_from_records(records)
    about = _about(quick=quick, seed=seed)
    notes = _notes(records)
    if rows:
        written += _write_table(rows, about, output, what, notes=notes)
    seconds = time.perf_counter() - started
    if as_json:
        listed = [_json_of_row(row) for row in rows]
        print_json(
            {**about, "rows": listed, "notes": notes, "written": written,
             "seconds": round(seconds, 1)}
        )  # fmt: skip
        return
    if rows:
        _print_rows(rows)
    print_sentences([*notes, f"Written: {', '.join(written)}. {seconds:.0f} s."])
    if "fig6" in records:
        path = output / "units" / "legs-00-joint.h5"
        print_sentences([f"Visualization 1 as a film: lightflight movie {path} -o flight.mp4"])


def _about(*, quick: bool, seed: int) -> dict[str, Any]:
    from datetime import UTC, datetime

    from lightflight._version import __version__

    return {
        "lightflight": __version__,
        "seed": seed,
        "quick": quick,
        "made_utc": datetime.now(UTC).date().isoformat(),
    }


def _draw(records: dict[str, Any], output: Path) -> list[str]:
    """Write one figure per record, and the frames of the film; their names."""
    from lightflight.view import figures_zheng
    from lightflight.view.encode import write_pictures
    from lightflight.view.export import write_figure

    written = []
    with step("drawing"):
        for name, record in records.items():
            figure = getattr(figures_zheng, f"{name}_figure")(record)
            write_figure(figure, output / f"{name}.png")
            written.append(str(output / f"{name}.png"))
        if "fig6" in records:
            folder = output / "visualization1"
            n_frames = write_pictures(figures_zheng.visualization1_frames(records["fig6"]), folder)
            written.append(f"{folder} ({n_frames} frames)")
    return written


# --- the table -------------------------------------------------------------------------------


def _notes(records: dict[str, Any]) -> list[str]:
    """What must be said beside the numbers."""
    from lightflight.zheng2020.discussion import NOT_COVERED
    from lightflight.zheng2020.table import note_from_records

    return [
        note
        for note in (note_from_records(records), NOT_COVERED if "discussion" in records else "")
        if note
    ]


_COLUMNS = ("quantity", "unit", "the paper", "paper", "joint", "photon", "bound", "factor", "prior")


def _cells(row: Row) -> tuple[str, ...]:
    numbers = (row.reported, row.paper, row.joint, row.photon, row.bound, row.factor)
    return (row.quantity, row.unit, *(_number(value) for value in numbers), row.prior)


def _number(value: float | None) -> str:
    """Three digits; a dash for what does not apply."""
    if value is None:
        return "–"
    return f"{value:.3g}" if abs(value) < 100 else f"{value:,.0f}"


def _print_rows(rows: tuple[Row, ...]) -> None:
    print_table(
        ("quantity", "unit", "reported", "paper", "joint", "photon", "bound", "factor"),
        [_cells(row)[:-1] for row in rows],
        title="The paper's numbers: measured in its laboratory, and ours on the twin",
        n_text_columns=2,
    )


def _json_of_row(row: Row) -> dict[str, Any]:
    from dataclasses import asdict

    return asdict(row) | {"factor": row.factor}


def markdown_from_rows(
    rows: tuple[Row, ...], about: dict[str, Any], *, notes: Sequence[str] = ()
) -> str:
    """The table as Markdown, with notes, seed, version and date."""
    lines = [
        f"| {' | '.join(_COLUMNS)} |",
        "|---|---|" + "---:|" * 6 + "---|",
        *(f"| {' | '.join(_cells(row))} |" for row in rows),
        "",
        "*the paper*: measured in its laboratory. *paper*, *joint*, *photon*: estimators, on the "
        "twin. *bound*: Cramér-Rao bound of a perfect clock. *factor*: the paper's number over the "
        "better of joint and photon.",
        "",
        *(line for note in notes for line in (note, "")),
        f"lightflight {about['lightflight']}, seed {about['seed']}, {about['made_utc']}"
        + (", quick run" if about["quick"] else "")
        + ".",
        "",
    ]
    return "\n".join(lines)


def _write_table(
    rows: tuple[Row, ...], about: dict[str, Any], output: Path, what: str, *, notes: Sequence[str]
) -> list[str]:
    import json

    from lightflight.cli._console import json_value
    from lightflight.store import atomic_path

    name = "table" if what in ("all", "table") else f"{what}-table"
    texts = {
        ".md": markdown_from_rows(rows, about, notes=notes),
        ".json": json.dumps(
            json_value({**about, "rows": [_json_of_row(row) for row in rows]}),
            indent=2,
            ensure_ascii=False,
        ),
    }
    for suffix, text in texts.items():
        with atomic_path(output / f"{name}{suffix}") as fresh:
            fresh.write_text(text, encoding="utf-8")
    return [str(output / f"{name}{suffix}") for suffix in texts]
