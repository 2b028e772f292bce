"""One recording from file to path file: whole, or by way of what `pieces` and `tiles` make.

A `Job` is all a worker needs to know; what it makes is a file that appears whole or not at all,
and that carries the key of the job, so that a later run can tell whether it may be kept.
"""

from __future__ import annotations

import contextlib
import errno
import functools
import gc
import hashlib
import json
import os
import shutil
import sys
import threading
import warnings
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, ParamSpec, TypeVar

from lightflight._version import __version__
from lightflight.batch.campaign import Campaign
from lightflight.errors import FileFormatError, LightflightWarning
from lightflight.lab import Lab

if TYPE_CHECKING:
    from lightflight.histogram import Histograms
    from lightflight.path import LightPath
    from lightflight.recording import Recording
    from lightflight.timing.calibration import TimingCalibration

P = ParamSpec("P")
R = TypeVar("R")

BYTES_PER_MB = 1_000_000
_DISK_FULL = {errno.ENOSPC, errno.EFBIG, getattr(errno, "EDQUOT", errno.ENOSPC)}


class JobError(Exception):
    """Why a recording gave no path, in one sentence; `ends_run` where the others would fail too.

    Its arguments are plain, so that it comes back from a worker whatever was raised there.
    """

    def __init__(self, reason: str, ends_run: bool = False) -> None:
        super().__init__(reason, ends_run)
        self.reason, self.ends_run = reason, ends_run

    def __str__(self) -> str:
        return self.reason


@dataclass(frozen=True, eq=False)
class Job:
    """One recording to reconstruct."""

    recording: str
    """The file."""

    label: str
    """Its name in tables and reasons."""

    target: str
    """Path file to make."""

    parts: str
    """Folder for what is made on the way; removed at the end."""

    key: str
    """Tells results of this recording, set-up and version from all others."""

    lab: Lab
    """What is known of the lab."""

    timing: str | None
    """Calibration of the clock."""

    background: str | None
    """Recording without the pulse."""

    codes: tuple[int, int] | None
    """Codes that are kept."""

    piece_bytes: float
    """Longer recordings are counted in pieces."""

    tile_bytes: float
    """Larger cubes are fitted in tiles."""

    settings: Mapping[str, Any] = field(repr=False)
    """Everything the result depends on, for its provenance."""

    inputs: tuple[Mapping[str, Any], ...] = field(default=(), repr=False)
    """Provenance of the files that all jobs share."""


@dataclass(frozen=True)
class Plan:
    """What is left to do for a recording that one task should not do alone."""

    n_pieces: int
    """Pieces the recording is read in."""

    n_tiles: int = 0
    """Tiles its pulses are fitted in; 0: the pieces are counted and added up."""


# --- jobs ------------------------------------------------------------------------------------


def jobs_from_campaign(campaign: Campaign) -> list[Job]:
    """One job for each recording, in the order of the table.

    Raises
    ------
    FileFormatError
        Where the calibration or the background cannot be read.
    """
    from lightflight.provenance import input_record

    shared = [path for path in (campaign.timing, campaign.background) if path is not None]
    if campaign.timing is not None:
        timing_from_file(os.fspath(campaign.timing))
    if campaign.background is not None:
        read_recording(os.fspath(campaign.background), campaign.lab)
    inputs = tuple(input_record(path) for path in shared)
    common = json.dumps(
        [__version__, campaign.settings, [one["sha256"] for one in inputs]], default=str
    )
    return [
        Job(
            recording=os.fspath(shot.path),
            label=shot.label,
            target=os.fspath(campaign.output / "paths" / f"{shot.name}.h5"),
            parts=os.fspath(campaign.output / "parts" / shot.name),
            key=_key(shot.path, shot.label, common),
            lab=campaign.lab,
            timing=None if campaign.timing is None else os.fspath(campaign.timing),
            background=None if campaign.background is None else os.fspath(campaign.background),
            codes=campaign.codes,
            piece_bytes=campaign.piece_megabytes * BYTES_PER_MB,
            tile_bytes=campaign.tile_megabytes * BYTES_PER_MB,
            settings=campaign.settings,
            inputs=inputs,
        )
        for shot in campaign.shots
    ]


def _key(path: Path, label: str, common: str) -> str:
    """Digest of what a result depends on; the recording by name, size and time, as make does."""
    files = sorted(path.rglob("*")) if path.is_dir() else [path]
    marks = []
    for file in files:
        try:
            status = file.stat()
        except OSError:
            continue
        marks.append((file.name, status.st_size, status.st_mtime_ns))
    return hashlib.sha256(json.dumps([label, marks, common]).encode()).hexdigest()


def finished_path(job: Job) -> LightPath | None:
    """The path of a recording that an earlier run finished; None: it is still to be made."""
    from lightflight.path import LightPath

    try:
        path = LightPath.load(job.target)
    except (FileFormatError, OSError):
        return None
    return path if path.provenance.get("campaign_key") == job.key else None


# --- tasks -----------------------------------------------------------------------------------


def task(function: Callable[P, R]) -> Callable[P, R]:
    """Make what a function raises, over a job as its first argument, one `JobError`."""

    @functools.wraps(function)
    def guarded(*args: P.args, **kwargs: P.kwargs) -> R:
        try:
            return function(*args, **kwargs)
        except JobError:
            raise
        except Exception as error:
            job = args[0]
            assert isinstance(job, Job)
            raise _job_error(error, job) from error
        finally:
            _give_memory_back()

    return guarded


def _give_memory_back() -> None:
    """Let go of what a task leaves behind, before the next one adds to it.

    Arrays in rings of references, and memory that the C library keeps for later, grow from
    recording to recording: to twice what one recording needs.
    """
    gc.collect()
    if sys.platform == "linux":
        import ctypes

        with contextlib.suppress(OSError, AttributeError):  # a C library other than GNU's
            ctypes.CDLL(None).malloc_trim(0)


def _job_error(error: Exception, job: Job) -> JobError:
    code = error.errno if isinstance(error, OSError) else None
    if isinstance(error, MemoryError):
        text = "not enough memory: cut it into smaller pieces and tiles, or keep fewer codes"
    elif isinstance(error, OSError) and not hasattr(error, "exit_code"):
        text = f"{error.filename}: {error.strerror}" if error.filename else str(error)
    elif hasattr(error, "exit_code") or isinstance(error, ValueError | TypeError):
        text = str(error)
    else:
        text = f"internal error, {type(error).__name__}: {error}"
    text = " ".join(text.split()).replace(job.recording, job.label)
    return JobError(text.removeprefix(f"{job.label}: "), code in _DISK_FULL)


@task
def begin(job: Job) -> Plan | None:
    """Reconstruct a recording; None: done, else what is to be done in several tasks."""
    from lightflight.histogram import Histograms
    from lightflight.recording import histogram

    make_folder(Path(job.target).parent)
    record = read_recording(job.recording, job.lab)
    if not isinstance(record, Histograms):
        plan = plan_of(job, record)
        if plan is not None:
            return plan
    with caught_warnings() as said:
        finish(job, histogram(record, codes=job.codes), said)
    return None


def plan_of(job: Job, recording: Recording) -> Plan | None:
    """How to share a recording out; None: one task does it.

    Raises
    ------
    ConfigError
        Where it needs tiles and the method does not work in tiles.
    """
    from lightflight.batch.pieces import n_pieces_of
    from lightflight.batch.tiles import check_tiles, n_sorted_pieces_of, n_tiles_of

    n_tiles = n_tiles_of(recording, job.codes, job.tile_bytes)
    if n_tiles > 1:
        check_tiles(job)
        return Plan(n_sorted_pieces_of(recording, job.piece_bytes), n_tiles)
    n_pieces = n_pieces_of(recording, job.piece_bytes)
    return None if n_pieces == 1 else Plan(n_pieces)


def finish(job: Job, hist: Histograms, said: list[str]) -> None:
    """Reconstruct the path from all counts and keep it; `said` are warnings given so far."""
    from lightflight.batch.window import TimingWindow
    from lightflight.reconstruct import reconstruct
    from lightflight.recording import histogram

    lab = job.lab
    timing = None if job.timing is None else timing_from_file(job.timing)
    background = None
    if job.background is not None:
        background = histogram(read_recording(job.background, lab), codes=job.codes)
    if timing is not None and job.codes is not None:
        timing = TimingWindow.of(timing, codes=job.codes)
    with caught_warnings() as more:
        path = reconstruct(
            hist,
            camera=lab.camera,
            source=lab.source,
            medium=lab.medium,
            timing=timing,
            background=background,
            **reconstruct_options(lab),
        )
    keep_path(job, path, [*said, *more])


def reconstruct_options(lab: Lab) -> dict[str, Any]:
    """Options of `reconstruct` as the set-up states them."""
    options = dict(lab.reconstruct)
    waypoints = [(int(row[0]), row[1:4], row[4]) for row in options.pop("waypoints", ())]
    return {**options, "waypoints": waypoints}


def keep_path(job: Job, path: LightPath, said: list[str]) -> None:
    """Write the path file, whole or not at all, then remove what was made on the way."""
    from lightflight.provenance import provenance_record

    made = provenance_record(
        command="lightflight batch", inputs=[job.recording], settings=job.settings
    )
    made["inputs"] = [*made["inputs"], *job.inputs]
    made["campaign_key"] = job.key
    made["warnings"] = list(dict.fromkeys(said))
    replace(path, provenance=made).save(job.target)
    shutil.rmtree(job.parts, ignore_errors=True)


# --- helpers ---------------------------------------------------------------------------------


class _Said(threading.local):
    """Where the warnings of this thread go."""

    lists: tuple[list[str], ...] = ()


_said = _Said()
_listening = threading.Lock()
_n_listeners = 0
_restore = contextlib.ExitStack()


@contextmanager
def caught_warnings() -> Iterator[list[str]]:
    """Collect the warnings that this package gives in this thread, as texts.

    `warnings.catch_warnings` alone would mix up the threads of a worker that has several.
    """
    global _n_listeners  # noqa: PLW0603  (filters are global to the process, and so is their use)
    said: list[str] = []
    with _listening:
        if _n_listeners == 0:
            _restore.enter_context(warnings.catch_warnings())
            warnings.simplefilter("ignore")
            warnings.simplefilter("always", LightflightWarning)
            warnings.showwarning = _note
        _n_listeners += 1
    _said.lists = (*_said.lists, said)
    try:
        yield said
    finally:
        _said.lists = _said.lists[:-1]
        with _listening:
            _n_listeners -= 1
            if _n_listeners == 0:
                _restore.close()


def _note(message: Warning | str, *_: Any, **__: Any) -> None:
    if _said.lists:
        _said.lists[-1].append(" ".join(str(message).split()))


def read_recording(path: str, lab: Lab) -> Recording | Histograms:
    """Recording or histograms, with what the set-up tells of them."""
    from lightflight.recording import read

    return read(path, **lab.recording)


@functools.lru_cache(maxsize=2)
def timing_from_file(path: str) -> TimingCalibration:
    """Calibration of the clock; a worker reads it once."""
    from lightflight.timing.calibration import TimingCalibration

    return TimingCalibration.load(path)


def make_folder(folder: Path) -> None:
    """Make a folder and those above it, where they are missing."""
    folder.mkdir(parents=True, exist_ok=True)
