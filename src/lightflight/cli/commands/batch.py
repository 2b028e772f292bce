"""`lightflight batch`: a whole campaign of recordings on Dask."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

import click

from lightflight.cli.console import (
    Fact,
    json_from_facts,
    print_facts,
    print_json,
    print_sentences,
    print_table,
    print_written,
    with_error,
)
from lightflight.cli.errors import NotTrustedError
from lightflight.cli.options import (
    debug_option,
    json_option,
    output_option,
    set_option,
    strict_option,
    trust_option,
)
from lightflight.cli.progress import duration, moving, step

if TYPE_CHECKING:
    from lightflight.batch.campaign import Campaign
    from lightflight.batch.runner import Status
    from lightflight.batch.table import CampaignTable, Repeats

_MOST_LINES = 20
_LINE_EVERY_S = 10.0


class InterruptedCampaignError(Exception):
    """Ctrl-C: what was finished is kept."""

    exit_code = 130


@click.command("batch", short_help="Reconstruct many recordings, on many cores or a cluster.")
@click.argument("campaign_file", type=click.Path(path_type=Path))
@click.option(
    "--scheduler",
    metavar="TCP://HOST:PORT",
    help="Dask scheduler of a cluster whose workers see the same folders.  [default: this machine]",
)
@click.option(
    "--tls",
    "certificates",
    nargs=3,
    type=click.Path(path_type=Path, exists=True, dir_okay=False),
    metavar="CA CERT KEY",
    help="Certificates for --scheduler tls://...: of its authority, of this machine, and its key.",
)
@click.option(
    "--workers",
    type=click.IntRange(min=1),
    help="Workers on this machine.  [default: one per core]",
)
@output_option("Folder for the results; stands over [campaign] output.", required=False)
@click.option("--page", is_flag=True, help="Also write index.html, with a page for each path.")
@strict_option
@set_option("campaign file")
@click.option(
    "--dry-run",
    is_flag=True,
    help="Print what was understood, every recording by name, as TOML, and stop.",
)
@json_option
@trust_option
@debug_option
def command(
    *,
    campaign_file: Path,
    scheduler: str | None,
    certificates: tuple[Path, Path, Path] | None,
    workers: int | None,
    output: Path | None,
    page: bool,
    strict: bool,
    assignments: tuple[str, ...],
    dry_run: bool,
    as_json: bool,
) -> None:
    """Reconstruct all recordings that CAMPAIGN_FILE names: a set-up file with groups of repeats.

    In the folder of results: table.csv and table.parquet (a row per recording), paths/ (a path
    file each) and summary.png. Run the same command again after an interruption, a crash or a
    full disk: what was finished is kept, and the table comes out the same.

    \b
    Examples:
      lightflight batch campaign.toml --dry-run
      lightflight batch campaign.toml -o results --workers 8
      lightflight batch campaign.toml --scheduler tls://head-node:8786 --tls ca.pem me.pem key.pem
    """
    if scheduler is not None and workers is not None:
        raise click.UsageError("--workers is for this machine: a --scheduler has its own")
    if certificates and scheduler is None:
        raise click.UsageError("--tls is for a --scheduler: this machine's workers have their own")
    from lightflight.batch.campaign import campaign_from_toml, toml_from_campaign

    campaign = campaign_from_toml(campaign_file, assignments=assignments, output=output)
    if dry_run:
        click.echo(toml_from_campaign(campaign).rstrip())
        return
    _check_ready(campaign)
    table = _run(campaign, scheduler, workers, certificates)
    written = _write_results(campaign, table, page=page)
    _report(campaign, table, written, as_json=as_json)
    if table.n_failed == len(table.rows):
        from lightflight.errors import NothingFoundError

        raise NothingFoundError(
            f"none of {len(table.rows)} recordings gave a path: table.csv says why"
        )
    n_trusted = table.n_by_verdict["trust"]
    if strict and n_trusted < len(table.rows):
        raise NotTrustedError(
            f"--strict: {len(table.rows) - n_trusted} of {len(table.rows)} recordings gave no path "
            'of the verdict "trust": table.csv says which'
        )


def _check_ready(campaign: Campaign) -> None:
    """Refuse, before any work, what cannot come to a good end."""
    from lightflight.errors import ConfigError

    folder = campaign.output
    if folder.exists() and not folder.is_dir():
        raise click.UsageError(f"-o {folder}: is a file, name a folder")
    # A folder of results is known by its paths: it is gone on with, any other is left alone.
    if folder.is_dir() and any(folder.iterdir()) and not (folder / "paths").is_dir():
        raise click.UsageError(f"-o {folder}: holds other things, name a new folder")
    if campaign.lab.camera is None:
        raise ConfigError(
            f"{campaign.file}: no path without a camera: [camera] lacks "
            f"{' and '.join(campaign.lab.camera_needs)} (here, or in the file of lab = ...)"
        )


def _run(
    campaign: Campaign,
    scheduler: str | None,
    workers: int | None,
    certificates: tuple[Path, Path, Path] | None,
) -> CampaignTable:
    """Table of the campaign; an interruption becomes a sentence that says how to go on."""
    from lightflight.batch.runner import run_campaign

    try:
        with _progress() as progress:
            return run_campaign(
                campaign,
                scheduler=scheduler,
                certificates=certificates or None,
                n_workers=workers,
                progress=progress,
            )
    except KeyboardInterrupt:  # the exit code is a shell's for Ctrl-C, the sentence is ours
        raise InterruptedCampaignError(
            "interrupted; what is finished is kept: run the same command again to go on"
        ) from None


# --- progress --------------------------------------------------------------------------------


@contextmanager
def _progress() -> Iterator[Callable[[Status], None]]:
    """Say on stderr how far it is: a bar on a terminal, else a line now and then."""
    if not sys.stderr.isatty():
        yield _Lines()
        return
    from rich.progress import BarColumn, SpinnerColumn, TextColumn

    words = TextColumn("{task.description}", markup=False)
    with moving(SpinnerColumn(), BarColumn(bar_width=32), words) as bar:
        task = bar.add_task("starting", total=1.0)
        yield lambda status: bar.update(task, completed=status.share, description=_words(status))


class _Lines:
    """A line when something has changed, every ten seconds at most, and one at the end."""

    def __init__(self) -> None:
        self._last, self._next = "", time.monotonic() + 2.0

    def __call__(self, status: Status) -> None:
        text, now = _words(status), time.monotonic()
        is_end = status.n_done + status.n_failed == status.n_all
        # The time that is left changes all the while: it alone is no news.
        same = text.partition(", about")[0] == self._last
        if not same and (now >= self._next or is_end):
            click.echo(f"{text} ...", err=True)
            self._last, self._next = text.partition(", about")[0], now + _LINE_EVERY_S


def _words(status: Status) -> str:
    """How far a campaign is, in words."""
    text = f"{status.n_done} of {status.n_all} recordings"
    if status.n_kept:
        text += f" ({status.n_kept} from before)"
    if status.n_failed:
        text += f", {status.n_failed} failed"
    return text if status.left_s is None else f"{text}, about {duration(status.left_s)} left"


# --- results ---------------------------------------------------------------------------------


def _write_results(campaign: Campaign, table: CampaignTable, *, page: bool) -> list[Path]:
    """Write table, summary and pages; the files that were written."""
    from lightflight.batch.table import write_table_csv, write_table_parquet
    from lightflight.errors import MissingExtraError
    from lightflight.view.export.files import write_figure
    from lightflight.view.figures.campaign import campaign_figure

    folder = campaign.output
    written = [folder / "table.csv"]
    with step("writing the table"):
        write_table_csv(table, written[0])
        try:
            write_table_parquet(table, folder / "table.parquet")
        except MissingExtraError as error:  # the same rows are in table.csv
            click.echo(f"warning: no table.parquet: {error}", err=True)
        else:
            written.append(folder / "table.parquet")
    with step("drawing the summary"):
        figure = campaign_figure(
            table.repeats(campaign.leg), title=campaign.title, verdicts=table.n_by_verdict
        )
        write_figure(figure, folder / "summary.png")
        written.append(folder / "summary.png")
    if page:
        from lightflight.view import write_campaign

        done = [
            folder / "paths" / f"{shot.name}.h5"
            for shot, row in zip(campaign.shots, table.rows, strict=True)
            if row["status"] == "done"
        ]
        with step("writing the pages") as report:
            write_campaign(done, folder / "index.html", title=campaign.title, progress=report)
        written.append(folder / "index.html")
    return written


def _report(
    campaign: Campaign, table: CampaignTable, written: list[Path], *, as_json: bool
) -> None:
    """Say on stdout what became of the recordings, group by group."""
    n = len(table.rows)
    facts = [
        Fact("recordings", "n_recordings", n),
        Fact("with a path", "n_done", n - table.n_failed),
        Fact("failed", "n_failed", table.n_failed),
    ]
    facts += [
        Fact(f"verdict {level}", f"n_{level}", count) for level, count in table.n_by_verdict.items()
    ]
    doubtful = [row for row in table.rows if row.get("verdict") not in (None, "trust")]
    failed = [row for row in table.rows if row["status"] == "failed"]
    groups = table.repeats(campaign.leg)
    if as_json:
        print_json(
            json_from_facts(facts)
            | {
                "groups": [_json_from_group(group) for group in groups],
                "not_trusted": {
                    row["recording"]: {k: row[k] for k in ("verdict", "findings")}
                    for row in doubtful
                },
                "failed": {row["recording"]: row["reason"] for row in failed},
                "written": [str(path) for path in written],
            }
        )
        return
    if campaign.title:
        print_sentences([campaign.title])
    print_facts(facts)
    _print_some(
        ("not to be trusted", "verdict", "findings, likely first"),
        [(row["recording"], row["verdict"], row["findings"]) for row in doubtful],
    )
    _print_groups(groups, campaign.leg)
    _print_some(("failed", "reason"), [(row["recording"], row["reason"]) for row in failed])
    print_written(written)


def _print_some(columns: tuple[str, ...], rows: list[tuple[object, ...]]) -> None:
    """A table of texts, as many rows as fit a screen; nothing without one."""
    if not rows:
        return
    print_table(columns, rows[:_MOST_LINES], n_text_columns=len(columns))
    if len(rows) > _MOST_LINES:
        print_sentences([f"... and {len(rows) - _MOST_LINES} more: see table.csv."])


def _print_groups(groups: tuple[Repeats, ...], leg: int) -> None:
    """Elevations by group as a table, as many as fit a screen."""
    rows: list[tuple[object, ...]] = [
        (
            group.name or "all",
            group.angle_deg.size,
            group.set_point_deg,
            with_error(group.mean_deg, group.mean_std_deg),
            group.scatter_deg,
        )
        for group in groups[:_MOST_LINES]
    ]
    print_table(
        ("group", "paths", "set-point (deg)", f"elevation, leg {leg} (deg)", "scatter (deg)"), rows
    )
    if len(groups) > _MOST_LINES:
        print_sentences([f"... and {len(groups) - _MOST_LINES} groups more: see table.csv."])


def _json_from_group(group: Repeats) -> dict[str, object]:
    """One group for programs; angles in deg."""
    return {
        "name": group.name,
        "n_paths": group.angle_deg.size,
        "set_point_deg": group.set_point_deg,
        "mean_deg": group.mean_deg,
        "mean_std_deg": group.mean_std_deg,
        "scatter_deg": group.scatter_deg,
        "pulls": group.pulls,
    }
