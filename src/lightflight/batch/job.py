"""One recording of a campaign: what a worker must know of it, and how its path is kept.

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
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, ParamSpec, TypeVar

from lightflight._version import __version__
from lightflight.batch.campaign import Campaign
from lightflight.batch.warnings_said import caught_warnings
from lightflight.batch.window import TimingWindow
from lightflight.errors import FileFormatError
from lightflight.files.names import readable
from lightflight.formats.registry import read
from lightflight.lab import Lab, reconstruct_options
from lightflight.path.light_path import LightPath
from lightflight.provenance import input_record, provenance_record
from lightflight.recording.counting import histogram
from lightflight.recording.histograms import Histograms
from lightflight.recording.recording import Recording
from lightflight.timing.clock.calibration import TimingCalibration

if TYPE_CHECKING:
    from lightflight.timing.clock.code_clock import CodeClock

P = ParamSpec("P")
R = TypeVar("R")

BYTES_PER_MB = 1_000_000
_DISK_FULL = {errno.ENOSPC, errno.EFBIG, getattr(errno, "EDQUOT", errno.ENOSPC)}


class JobError(Exception):
    """Why a recording gave no path, in one sentence; `ends_run` where the others would fail too.

    Its arguments are plain, so that it comes back from a worker whatever was raised there.

    Attributes
    ----------
    reason : str
        The sentence, without the recording's name.
    ends_run : bool
        True for a full disk, which the next recording would meet too.
    """

    def __init__(self, reason: str, ends_run: bool = False) -> None:
        # Pickle makes the copy from these arguments.
        super().__init__(reason, ends_run)
        self.reason, self.ends_run = reason, ends_run

    def __str__(self) -> str:
        return self.reason


@dataclass(frozen=True, eq=False)
class Job:
    """One recording to reconstruct.

    Attributes
    ----------
    recording : str
        The file.
    label : str
        Its name in tables and reasons.
    target : str
        Path file to make.
    parts : str
        Folder for what is made on the way; removed at the end.
    key : str
        Tells results of this recording, set-up and version from all others.
    lab : Lab
        What is known of the lab.
    timing : str or None
        Calibration of the clock.
    background : str or None
        Recording without the pulse.
    codes : (int, int) or None
        Codes that are kept.
    piece_bytes : float
        Longer recordings are counted in pieces.
    tile_bytes : float
        Larger cubes are fitted in tiles.
    settings : mapping of str
        Everything the result depends on, for its provenance.
    inputs : tuple[mapping of str, ...]
        Provenance of the files that all jobs share, the calibration's first.
    """

    recording: str
    label: str
    target: str
    parts: str
    key: str
    lab: Lab
    timing: str | None
    background: str | None
    codes: tuple[int, int] | None
    piece_bytes: float
    tile_bytes: float
    settings: Mapping[str, object] = field(repr=False)
    inputs: tuple[Mapping[str, object], ...] = field(default=(), repr=False)


@dataclass(frozen=True)
class Shares:
    """What is left to do for a recording that one task should not do alone.

    Attributes
    ----------
    n_pieces : int
        Pieces the recording is read in.
    n_tiles : int
        Tiles its pulses are fitted in; 0: the pieces are counted and added up.
    """

    n_pieces: int
    n_tiles: int = 0


# --- jobs ------------------------------------------------------------------------------------


def jobs_from_campaign(campaign: Campaign) -> list[Job]:
    """One job for each recording, in the order of the table.

    Parameters
    ----------
    campaign : Campaign
        As it was understood.

    Returns
    -------
    list of Job
        As long as the table; whatever is finished is among them.

    Raises
    ------
    FileFormatError
        Where the calibration or the background cannot be read.
    """
    shared = [path for path in (campaign.timing, campaign.background) if path is not None]
    # Read once here: a fault that all recordings share is one error, not a row for each.
    if campaign.timing is not None:
        TimingCalibration.load(campaign.timing)
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
    # Sorted, since a folder lists its files in any order.
    files = sorted(path.rglob("*")) if path.is_dir() else [path]
    marks = []
    for file in files:
        try:
            status = file.stat()
        except OSError:  # a recording that is not there has a row too, which says so
            continue
        marks.append((file.name, status.st_size, status.st_mtime_ns))
    return hashlib.sha256(json.dumps([label, marks, common]).encode()).hexdigest()


def finished_path(job: Job) -> LightPath | None:
    """The path of a recording that an earlier run finished.

    Parameters
    ----------
    job : Job
        The recording.

    Returns
    -------
    LightPath or None
        None: it is still to be made, since there is no file, or a damaged one, or one of another
        recording, set-up or version.
    """
    try:
        path = LightPath.load(job.target)
    except (FileFormatError, OSError):
        return None
    return path if path.provenance.get("campaign_key") == job.key else None


def damage_of(job: Job) -> str:
    """Why the path file of an earlier run is of no use, in one sentence; empty for any other.

    Parameters
    ----------
    job : Job
        The recording.

    Returns
    -------
    str
        Empty without a file, and for one of another recording, set-up or version.
    """
    if not Path(job.target).exists():
        return ""
    try:
        LightPath.load(job.target)
    except (FileFormatError, OSError) as error:
        return str(error)
    return ""


# --- tasks -----------------------------------------------------------------------------------


def task(function: Callable[P, R]) -> Callable[P, R]:
    """Make what a function raises, over a job as its first argument, one `JobError`.

    Parameters
    ----------
    function : callable
        Work on a worker; its first argument is the `Job`.

    Returns
    -------
    callable
        The same, which also gives its memory back when it ends.
    """

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
    """The sentence of an error as one about the recording, without this machine's paths."""
    code = error.errno if isinstance(error, OSError) else None
    if isinstance(error, MemoryError):
        text = "not enough memory: cut it into smaller pieces and tiles, or keep fewer codes"
    elif isinstance(error, OSError) and not hasattr(error, "exit_code"):
        text = f"{error.filename}: {error.strerror}" if error.filename else str(error)
    elif hasattr(error, "exit_code") or isinstance(error, ValueError | TypeError):
        text = str(error)
    else:
        text = f"internal error, {type(error).__name__}: {error}"
    # A reason stands in the table, which must not depend on where the campaign's folder lies.
    text = " ".join(text.split()).replace(job.recording, job.label)
    text = readable(text)
    return JobError(text.removeprefix(f"{job.label}: "), code in _DISK_FULL)


def finish(job: Job, hist: Histograms, said: list[str]) -> None:
    """Reconstruct the path from all counts and keep it.

    Parameters
    ----------
    job : Job
        The recording.
    hist : Histograms
        All counts, cut to the codes that are kept.
    said : list of str
        Warnings given so far.
    """
    from lightflight.reconstruct import reconstruct

    lab = job.lab
    timing: CodeClock | None = None
    if job.timing is not None:
        whole = timing_of(job)
        timing = whole if job.codes is None else TimingWindow.of(whole, codes=job.codes)
    background = None
    if job.background is not None:
        background = histogram(read_recording(job.background, lab), codes=job.codes)
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


def keep_path(job: Job, path: LightPath, said: list[str]) -> None:
    """Write the path file, whole or not at all, then remove what was made on the way.

    Parameters
    ----------
    job : Job
        The recording.
    path : LightPath
        What was found.
    said : list of str
        Warnings given on the way; each is kept once.
    """
    made = provenance_record(
        command="lightflight batch", inputs=[job.recording], settings=job.settings
    )
    made["inputs"] = [*made["inputs"], *job.inputs]
    made["campaign_key"] = job.key
    made["warnings"] = list(dict.fromkeys(said))
    # In this order: whatever ends the run between the two costs disk, not work.
    replace(path, provenance=made).save(job.target)
    shutil.rmtree(job.parts, ignore_errors=True)


def read_recording(path: str, lab: Lab) -> Recording | Histograms:
    """Recording or histograms, with what the set-up tells of them.

    Parameters
    ----------
    path : str
        The file.
    lab : Lab
        The set-up, whose [recording] has the hints.

    Returns
    -------
    Recording or Histograms
        Photons stay in the file until they are asked for.
    """
    return read(path, **lab.recording)


def recording_of(job: Job) -> Recording:
    """The recording of a job that is shared out: histograms never are."""
    recording = read_recording(job.recording, job.lab)
    assert isinstance(recording, Recording)
    return recording


def timing_of(job: Job) -> TimingCalibration:
    """Calibration of the clock, as it was when the campaign began.

    Parameters
    ----------
    job : Job
        One with a calibration.

    Returns
    -------
    TimingCalibration
        The clock; a worker reads it once.

    Raises
    ------
    JobError
        Where the file was replaced meanwhile: the result would carry another one's name.
    """
    assert job.timing is not None
    status = Path(job.timing).stat()
    timing, sha256 = _timing_from_file(
        job.timing, (status.st_ino, status.st_size, status.st_mtime_ns)
    )
    if job.inputs and job.inputs[0]["sha256"] != sha256:
        raise JobError(f"{job.inputs[0]['name']} was replaced while the campaign ran: run it again")
    return timing


@functools.lru_cache(maxsize=2)
def _timing_from_file(path: str, mark: tuple[int, ...]) -> tuple[TimingCalibration, str]:
    """The clock and the file's digest; workers of a lab's cluster outlive files: `mark` tells."""
    sha256 = input_record(path)["sha256"]
    return TimingCalibration.load(path), sha256


def make_folder(folder: Path) -> None:
    """Make a folder and those above it, where they are missing."""
    folder.mkdir(parents=True, exist_ok=True)
