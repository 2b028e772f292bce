"""A long recording in pieces: each is counted by itself, and the counts are added up by tree.

Counts are whole numbers, so neither the pieces nor the order of the sums show in the result.
A counted piece is kept as a file until the path is there: what was counted need not be again.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lightflight.batch.job import Job, finish, make_folder, recording_of, task
from lightflight.batch.kept import is_kept_whole, kept_arrays
from lightflight.batch.warnings_said import caught_warnings
from lightflight.errors import FileFormatError
from lightflight.files.mapped import rows_of
from lightflight.recording.counting import histogram
from lightflight.recording.histograms import Histograms
from lightflight.recording.recording import Recording, SlicedArray

PIECE_KIND = "counted piece"
BRANCHES = 8
"""Pieces (or sums) that one task of the tree adds up."""


@dataclass(frozen=True, eq=False)
class PartOfArray:
    """Elements start ... end - 1 of an array that stays where it is."""

    whole: SlicedArray
    start: int
    end: int

    @property
    def shape(self) -> tuple[int, ...]:
        """As the whole, but for the first axis."""
        return (self.end - self.start, *self.whole.shape[1:])

    @property
    def dtype(self) -> np.dtype[np.generic]:
        """As the whole."""
        return self.whole.dtype

    @property
    def path(self) -> Path | None:
        """The file it lies in, for errors about its content."""
        return getattr(self.whole, "path", None)

    def __getitem__(self, key: slice) -> Any:
        first, last, _ = key.indices(self.end - self.start)
        return rows_of(self.whole, self.start + first, self.start + max(first, last))


def bytes_of(recording: Recording) -> int:
    """Bytes that counting a recording takes in.

    Parameters
    ----------
    recording : Recording
        Frames, or photon events.

    Returns
    -------
    int
        As the arrays are in memory, packed or not on disk.
    """
    arrays = (recording.frames, recording.pixel, recording.code)
    return sum(math.prod(a.shape) * a.dtype.itemsize for a in arrays if a is not None)


def n_pieces_of(recording: Recording, piece_bytes: float) -> int:
    """Pieces a recording is counted in: as few as are no longer than `piece_bytes`.

    Parameters
    ----------
    recording : Recording
        Frames, or photon events.
    piece_bytes : float
        Longest piece, bytes.

    Returns
    -------
    int
        1: it is counted whole.
    """
    most = recording.n_frames if _knows_frames(recording) else recording.n_photons
    return max(1, min(math.ceil(bytes_of(recording) / piece_bytes), most or 1))


def _knows_frames(recording: Recording) -> bool:
    """Whether a recording can be cut between frames."""
    return recording.kind == "frames" or recording.frame_starts is not None


def piece_of(recording: Recording, index: int, n_pieces: int) -> tuple[Recording, dict[str, Any]]:
    """One piece of a recording: a run of frames, else of photons.

    Parameters
    ----------
    recording : Recording
        All of it.
    index, n_pieces : int
        Which piece, of how many.

    Returns
    -------
    recording : Recording
        The piece, or the whole where `histogram` can be told which part to take.
    options : dict of str
        What to tell `histogram`.
    """
    if _knows_frames(recording):
        assert recording.n_frames is not None
        return recording, {"frames": share_of(recording.n_frames, index, n_pieces)}
    # Nobody knows how many frames a run of photons spans: n_frames is of the whole alone.
    assert recording.pixel is not None
    return photons_between(recording, *share_of(recording.pixel.shape[0], index, n_pieces)), {}


def photons_between(recording: Recording, start: int, end: int) -> Recording:
    """Photons start ... end - 1 of a list of them, which no longer tells their frames.

    Parameters
    ----------
    recording : Recording
        Of events.
    start, end : int
        First photon, and the one after the last.
    """
    assert recording.pixel is not None
    assert recording.code is not None
    return replace(
        recording,
        pixel=PartOfArray(recording.pixel, start, end),
        code=PartOfArray(recording.code, start, end),
        frame_starts=None,
        n_frames=None,
    )


def share_of(length: int, index: int, n_pieces: int) -> tuple[int, int]:
    """(start, end) of one of `n_pieces` runs of nearly equal length."""
    return length * index // n_pieces, length * (index + 1) // n_pieces


# --- tasks -----------------------------------------------------------------------------------


@task
def count_piece(job: Job, index: int, n_pieces: int) -> str:
    """Count one piece into a file, unless an earlier run did.

    Parameters
    ----------
    job : Job
        The recording.
    index, n_pieces : int
        Which piece, of how many.

    Returns
    -------
    str
        The file: counts would fill the memory of the scheduler.
    """
    from lightflight.files.store import save_record

    file = Path(job.parts) / f"piece-{index:05d}-of-{n_pieces:05d}.h5"
    if is_kept_whole(file, PIECE_KIND, job.key):
        return str(file)
    part, options = piece_of(recording_of(job), index, n_pieces)
    hist = histogram(part, codes=job.codes, **options)
    make_folder(file.parent)
    save_record(file, kind=PIECE_KIND, arrays={"counts": hist.counts}, attributes={"key": job.key})
    return str(file)


@task
def add_up(job: Job, *parts: str | NDArray[np.generic]) -> NDArray[np.generic]:
    """Sum of pieces (files) and of sums (arrays).

    Parameters
    ----------
    job : Job
        The recording.
    *parts : str or array of int, shape (rows, cols, codes)
        What to add.

    Returns
    -------
    array of uint64, shape (rows, cols, codes)
        Exact in any order.

    Raises
    ------
    JobError
        Where a piece is gone.
    """
    total: NDArray[np.uint64] | None = None
    for part in parts:
        counts: NDArray[Any] = _counts_of_piece(part, job.key) if isinstance(part, str) else part
        # 64 bits while adding, whatever a piece was counted in.
        if total is None:
            total = counts.astype(np.uint64)
        else:
            total += counts
    assert total is not None
    return total


def _counts_of_piece(file: str, key: str) -> NDArray[Any]:
    """Counts that a task of the same job kept; FileFormatError where they are no more."""
    try:
        return kept_arrays(Path(file), PIECE_KIND, key)["counts"]
    except FileFormatError:
        raise FileFormatError(
            "a counted piece is gone: run the campaign again", path=file
        ) from None


@task
def finish_pieces(job: Job, total: NDArray[np.generic]) -> None:
    """Reconstruct the path from the sum of all pieces.

    Parameters
    ----------
    job : Job
        The recording.
    total : array of uint64, shape (rows, cols, codes)
        From `add_up`.
    """
    recording = recording_of(job)
    with caught_warnings() as said:
        hist = histograms_from_sum(recording, total, job.codes)
        finish(job, hist, said)


def histograms_from_sum(
    recording: Recording, total: NDArray[np.generic], codes: tuple[int, int] | None
) -> Histograms:
    """What `histogram` gives for the whole recording, from the sum over its pieces.

    Parameters
    ----------
    recording : Recording
        All of it.
    total : array of uint64, shape (rows, cols, codes)
        Sum of the counts of its pieces; changed in place where frames without a photon are counted.
    codes : (int, int) or None
        Codes that are kept, (start, end).

    Returns
    -------
    Histograms
        Equal to the last bit.
    """
    # An empty piece has the clock, the window and the settings of the whole.
    if _knows_frames(recording):
        empty = histogram(recording, codes=codes, frames=(0, 1))
    else:
        empty = histogram(piece_of(recording, 0, 1 << 62)[0], codes=codes)
    absent = empty.no_photon_code
    photons = total.sum(axis=2) if absent is None else total.sum(axis=2) - total[..., absent]
    # Frames without a photon are in no piece of photons: they are what the whole leaves over.
    if absent is not None and recording.n_frames is not None:
        total[..., absent] = np.uint64(recording.n_frames) - photons
    most = max(recording.n_photons or 0, recording.n_frames or 0)
    counts = total.astype(np.uint32 if most <= np.iinfo(np.uint32).max else np.uint64)
    counts.setflags(write=False)
    return replace(empty, counts=counts, n_frames=recording.n_frames or None)
