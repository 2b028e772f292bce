"""Run a campaign: every recording on some worker, finished ones kept, faults told.

`run_campaign` first takes up what an earlier run finished, then hands the rest out. A recording
that fails is a row with its reason, and the others go on; a full disk ends the run, since the
others would fail too. Whatever ends it, the path files that are there are whole.
"""

from __future__ import annotations

import contextlib
import queue
import time
import uuid
import warnings
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

from lightflight.batch import cluster, pieces, tiles, work
from lightflight.batch.campaign import Campaign
from lightflight.batch.job import (
    Job,
    JobError,
    Shares,
    damage_of,
    finished_path,
    jobs_from_campaign,
)
from lightflight.batch.table import CampaignTable, row_from_failure, row_from_path
from lightflight.errors import FileFormatError, SuspectDataWarning
from lightflight.files.litter import temporary_folder

_LOOK_S = 0.2
"""How often the caller is told, while nothing ends, s."""

_MOST_BEGINS = 4
"""A recording whose worker was lost this often is given up."""

_NOT_THERE = (
    "its path file is not where the worker wrote it: workers need the same folders as this machine"
)


@dataclass(frozen=True)
class Status:
    """How far a campaign is.

    Attributes
    ----------
    n_done : int
        Recordings with a path, those of earlier runs included.
    n_failed : int
        Recordings that gave none.
    n_all : int
        Recordings of the campaign.
    n_kept : int
        Of `n_done`, those that an earlier run had finished.
    share : float
        Part of this run's work that is done, by size of the recordings, 0 ... 1.
    left_s : float or None
        Time this run still needs, s; None: not known yet.
    """

    n_done: int
    n_failed: int
    n_all: int
    n_kept: int
    share: float
    left_s: float | None


class StoppedError(OSError):
    """The disk is full, or the scheduler gone: the run ended early. What was finished is kept."""

    exit_code = 3


Report = Callable[[Status], None]
Task = Callable[..., object]


def run_campaign(
    campaign: Campaign,
    *,
    scheduler: str | None = None,
    certificates: cluster.Certificates | None = None,
    n_workers: int | None = None,
    progress: Report | None = None,
    loud: bool = False,
) -> CampaignTable:
    """Reconstruct every recording of a campaign.

    Parameters
    ----------
    campaign : Campaign
        From `campaign_from_toml`.
    scheduler : str, optional
        Address of a Dask scheduler; None: workers on this machine.
    certificates : (path, path, path), optional
        For a scheduler by TLS: of its authority, our own, and its key (PEM).
    n_workers : int, optional
        Workers on this machine; None: one per core.
    progress : callable, optional
        Called with a `Status`, a few times a second at most.
    loud : bool, optional
        Let Dask say what it does.

    Returns
    -------
    CampaignTable
        One row per recording, whatever became of it.

    Raises
    ------
    StoppedError
        Where the disk is full, or the scheduler is gone.
    ConfigError
        Where nobody answers at `scheduler`.
    FileFormatError
        Where calibration or background cannot be read.
    """
    _refuse_links(campaign.output)
    jobs = jobs_from_campaign(campaign)
    (campaign.output / "paths").mkdir(parents=True, exist_ok=True)
    rows: dict[int, dict[str, object]] = {}
    for i, job in enumerate(jobs):
        path = finished_path(job)
        if path is not None:
            rows[i] = row_from_path(campaign.shots[i], path)
        elif damage := damage_of(job):
            warnings.warn(f"{damage}; it is made again", SuspectDataWarning, stacklevel=2)
    run = _Run(campaign, jobs, rows, progress)
    run.report()
    with temporary_folder() as folder:  # which takes away what a killed run left, work or none
        if run.left:
            with cluster.workers(
                scheduler=scheduler,
                certificates=certificates,
                n_workers=n_workers,
                scratch=folder,
                loud=loud,
            ) as client:
                run.drive(client)
    with contextlib.suppress(OSError):  # it holds what a failed recording left, for the next run
        (campaign.output / "parts").rmdir()
    return CampaignTable(tuple(rows[i] for i in range(len(jobs))))


_OURS = ["table.csv", "table.parquet", "summary.png", "index.html", "paths", "parts", "index_pages"]
"""What a campaign writes into its folder."""


def _refuse_links(folder: Path) -> None:
    """Raise FileFormatError where a result would be written through a link, to somewhere else."""
    pending = [folder / name for name in _OURS]
    while pending:
        place = pending.pop()
        if place.is_symlink():
            raise FileFormatError(
                f"holds a link ({place.relative_to(folder)}), through which nothing is written: "
                "take it away, or name another folder",
                path=folder,
            )
        if place.is_dir():
            pending += place.iterdir()


@dataclass(eq=False)
class _Run:
    """One run: what is under way, and what became of it."""

    campaign: Campaign
    jobs: list[Job]
    rows: dict[int, dict[str, object]]
    progress: Report | None
    futures: dict[int, list[cluster.Future]] = field(default_factory=dict)
    ended: queue.SimpleQueue[tuple[int, int, str, cluster.Future]] = field(
        default_factory=queue.SimpleQueue
    )
    done_share: dict[int, float] = field(default_factory=dict)
    n_tasks: dict[int, int] = field(default_factory=dict)
    n_begun: dict[int, int] = field(default_factory=dict)
    nonce: str = field(default_factory=lambda: uuid.uuid4().hex)
    started: float = field(default_factory=time.monotonic)

    def __post_init__(self) -> None:
        self.n_kept = len(self.rows)
        self.left = [i for i in range(len(self.jobs)) if i not in self.rows]
        # By bytes, not by number: recordings of a campaign may differ a thousandfold.
        sizes = {i: float(_size_of(self.jobs[i].recording)) for i in self.left}
        total = sum(sizes.values()) or 1.0
        self.weight = {i: size / total for i, size in sizes.items()}

    def drive(self, client: cluster.Client) -> None:
        """Hand out all recordings, and answer what comes back until none is left."""
        self.started = time.monotonic()
        for i in self.left:
            self._begin(client, i)
        waiting = set(self.left)
        while waiting:
            try:
                i, begun, role, future = self.ended.get(timeout=_LOOK_S)
            except queue.Empty:
                self.report()
                continue
            if i not in waiting or begun != self.n_begun.get(i, 1):
                continue  # of a recording that has failed, or was begun again
            if self._answer(client, i, role, future):
                waiting.discard(i)
                self.futures.pop(i, None)
                self.report()

    def _name(self, i: int, role: str, *numbers: int) -> str:
        """Name of a task; new in every run, so that a scheduler does not answer from memory."""
        begun = self.n_begun.get(i, 1)
        return "-".join([f"lightflight_{role}", self.nonce, str(i), *map(str, (begun, *numbers))])

    def _watch(self, i: int, role: str, future: cluster.Future) -> None:
        """Take note when a task ends; of which beginning it is goes with it."""
        # Dask drops a task, and what waits for it, when the last future of it is gone.
        self.futures.setdefault(i, []).append(future)
        begun = self.n_begun.get(i, 1)
        future.add_done_callback(lambda one: self.ended.put((i, begun, role, one)))

    def _answer(self, client: cluster.Client, i: int, role: str, future: cluster.Future) -> bool:
        """Take up one finished task; True where nothing more is to come for its recording."""
        if cluster.is_lost(future):
            return self._begin_again(client, i)
        if future.status != "finished":
            self._failed(i, _exception_of(future))
            return True
        if role == "piece":
            self.done_share[i] = self.done_share.get(i, 0.0) + 1.0 / self.n_tasks[i]
            return False
        # The file says that a recording is done, whatever the task says: rows are made from it.
        path = finished_path(self.jobs[i])
        if path is not None:
            self.rows[i] = row_from_path(self.campaign.shots[i], path)
            return True
        try:
            shares = future.result()
        except OSError:  # the worker that held it is gone
            return self._begin_again(client, i)
        if isinstance(shares, Shares):
            self._hand_out(client, i, shares)
            return False
        self._failed(i, JobError(_NOT_THERE))
        return True

    def _begin_again(self, client: cluster.Client, i: int) -> bool:
        """Where an answer was lost: what its tasks kept is there, so little is done twice."""
        if not cluster.answers(client):
            raise self._stopped("the scheduler is gone", "see to it")
        self.n_begun[i] = self.n_begun.get(i, 1) + 1
        if self.n_begun[i] > _MOST_BEGINS:
            self._failed(i, JobError(f"its worker was lost {_MOST_BEGINS} times"))
            return True
        self._begin(client, i)
        return False

    def _begin(self, client: cluster.Client, i: int) -> None:
        """Hand out a recording: one task, which does it or says how to share it out."""
        name = self._name(i, "begin")
        self.futures[i] = []
        self._watch(i, "begin", cluster.submit(client, work.begin, self.jobs[i], name=name))

    def _hand_out(self, client: cluster.Client, i: int, shares: Shares) -> None:
        """The tasks of a recording that is done in pieces or tiles."""

        def submitted(
            role: str, function: Task, *arguments: object, number: tuple[int, ...]
        ) -> cluster.Future:
            name = self._name(i, role, *number)
            return cluster.submit(client, function, self.jobs[i], *arguments, name=name)

        self.n_tasks[i] = shares.n_pieces + shares.n_tiles
        read = tiles.sort_piece if shares.n_tiles else pieces.count_piece
        parts = [
            submitted("piece", read, k, shares.n_pieces, number=(k,))
            for k in range(shares.n_pieces)
        ]
        for part in parts:
            self._watch(i, "piece", part)
        if shares.n_tiles:
            fitted = [
                submitted("tile", tiles.fit_pulses_of_tile, k, *parts, number=(k,))
                for k in range(shares.n_tiles)
            ]
            for tile in fitted:
                self._watch(i, "piece", tile)
            last = submitted("finish", tiles.finish_tiles, parts, fitted, number=())
        else:
            level = 0
            # One piece alone is added up too: what comes out is a sum, not a file.
            while len(parts) > 1 or not level:
                groups = [
                    parts[k : k + pieces.BRANCHES] for k in range(0, len(parts), pieces.BRANCHES)
                ]
                parts = [
                    submitted("sum", pieces.add_up, *group, number=(level, k))
                    for k, group in enumerate(groups)
                ]
                level += 1
            last = submitted("finish", pieces.finish_pieces, parts[0], number=())
        self._watch(i, "finish", last)

    def _failed(self, i: int, error: BaseException | None) -> None:
        """Make a row of a fault, or end the run where the others would fail too."""
        reason = cluster.reason_of(error)
        if isinstance(error, JobError) and error.ends_run:
            raise self._stopped(error.reason, "free some space")
        if reason is None:
            reason = str(error) if isinstance(error, JobError) else f"internal error, {error!r}"
        self.rows[i] = row_from_failure(self.campaign.shots[i], reason)

    def _stopped(self, why: str, remedy: str) -> StoppedError:
        """The error that ends a run, and how to go on."""
        return StoppedError(
            f"{why}; {self._n_done} of {len(self.jobs)} recordings are finished and kept: "
            f"{remedy} and run the same command again"
        )

    @property
    def _n_done(self) -> int:
        return sum(row["status"] == "done" for row in self.rows.values())

    def report(self) -> None:
        """Tell the caller how far the run is."""
        if self.progress is None:
            return
        # Below 1 until the path is there: fitting it comes after the last piece.
        share = sum(
            weight * (1.0 if i in self.rows else min(self.done_share.get(i, 0.0), 0.99))
            for i, weight in self.weight.items()
        )
        taken = time.monotonic() - self.started
        left = taken * (1.0 - share) / share if share > 0 and self.futures else None
        n_failed = len(self.rows) - self._n_done
        self.progress(Status(self._n_done, n_failed, len(self.jobs), self.n_kept, share, left))


def _size_of(path: str) -> int:
    """Bytes of a recording, for shares of the work; 1 where it cannot be told."""
    with contextlib.suppress(OSError):
        file = Path(path)
        if file.is_dir():
            return sum(one.stat().st_size for one in file.rglob("*")) or 1
        return file.stat().st_size or 1
    return 1


def _exception_of(future: cluster.Future) -> BaseException | None:
    """What a task raised; where asking raises, that."""
    try:
        return future.exception()
    except BaseException as error:  # noqa: BLE001  (a cancelled future raises instead)
        return error
