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

from lightflight.batch.work import Job, caught_warnings, finish, make_folder, read_recording, task
from lightflight.errors import FileFormatError
from lightflight.histogram import Histograms
from lightflight.recording import Recording, SlicedArray, histogram

KIND = "counted piece"
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
    def dtype(self) -> np.dtype[Any]:
        """As the whole."""
        return self.whole.dtype

    @property
    def path(self) -> Any:
        """The file it lies in, for errors about its content."""
        return getattr(self.whole, "path", None)

    def __getitem__(self, key: slice) -> Any:
        first, last, _ = key.indices(self.end - self.start)
        return self.whole[self.start + first : self.start + max(first, last)]


def bytes_of(recording: Recording) -> int:
    """Bytes that counting a recording takes in."""
    arrays = (recording.frames, recording.pixel, recording.code)
    return sum(math.prod(a.shape) * a.dtype.itemsize for a in arrays if a is not None)


def n_pieces_of(recording: Recording, piece_bytes: float) -> int:
    """Pieces a recording is counted in: as few as are no longer than `piece_bytes`."""
    most = recording.n_frames if _knows_frames(recording) else recording.n_photons
    return max(1, min(math.ceil(bytes_of(recording) / piece_bytes), most or 1))


def _knows_frames(recording: Recording) -> bool:
    return recording.kind == "frames" or recording.frame_starts is not None


def piece_of(recording: Recording, index: int, n_pieces: int) -> tuple[Recording, dict[str, Any]]:
    """(recording, options of `histogram`) of one piece: a run of frames, else of photons."""
    if _knows_frames(recording):
        assert recording.n_frames is not None
        return recording, {"frames": _share(recording.n_frames, index, n_pieces)}
    assert recording.pixel is not None
    assert recording.code is not None
    start, end = _share(recording.pixel.shape[0], index, n_pieces)
    part = replace(
        recording,
        pixel=PartOfArray(recording.pixel, start, end),
        code=PartOfArray(recording.code, start, end),
        n_frames=None,
    )
    return part, {}


def _share(length: int, index: int, n_pieces: int) -> tuple[int, int]:
    return length * index // n_pieces, length * (index + 1) // n_pieces


# --- tasks -----------------------------------------------------------------------------------


@task
def count_piece(job: Job, index: int, n_pieces: int) -> str:
    """Count one piece into a file, unless an earlier run did; gives the file."""
    from lightflight.store import save_record

    file = Path(job.parts) / f"piece-{index:05d}-of-{n_pieces:05d}.h5"
    if counts_of_piece(file, job.key) is not None:
        return str(file)
    recording = read_recording(job.recording, job.lab)
    assert isinstance(recording, Recording)
    part, options = piece_of(recording, index, n_pieces)
    hist = histogram(part, codes=job.codes, **options)
    make_folder(file.parent)
    save_record(file, kind=KIND, arrays={"counts": hist.counts}, attributes={"key": job.key})
    return str(file)


def counts_of_piece(file: Path, key: str) -> NDArray[Any] | None:
    """Counts of a piece that an earlier task of the same job kept; None where there is none."""
    from lightflight.store import load_record

    try:
        arrays, attributes = load_record(file, kind=KIND)
    except FileFormatError:
        return None
    return arrays["counts"] if attributes.get("key") == key else None


@task
def add_up(job: Job, *parts: str | NDArray[Any]) -> NDArray[Any]:
    """Sum of pieces (files) and of sums (arrays), uint64."""
    total: NDArray[Any] | None = None
    for part in parts:
        counts = counts_of_piece(Path(part), job.key) if isinstance(part, str) else part
        if counts is None:
            raise FileFormatError("a counted piece is gone: run the campaign again", path=str(part))
        if total is None:
            total = counts.astype(np.uint64)
        else:
            total += counts
    assert total is not None
    return total


@task
def finish_pieces(job: Job, total: NDArray[Any]) -> None:
    """Reconstruct the path from the sum of all pieces."""
    recording = read_recording(job.recording, job.lab)
    assert isinstance(recording, Recording)
    with caught_warnings() as said:
        hist = histograms_from_sum(recording, total, job.codes)
        finish(job, hist, said)


def histograms_from_sum(
    recording: Recording, total: NDArray[Any], codes: tuple[int, int] | None
) -> Histograms:
    """What `histogram` gives for the whole recording, from the sum over its pieces."""
    # An empty piece has the clock, the window and the settings of the whole.
    if _knows_frames(recording):
        empty = histogram(recording, codes=codes, frames=(0, 1))
    else:
        empty = histogram(piece_of(recording, 0, 1 << 62)[0], codes=codes)
    absent = empty.no_photon_code
    photons = total.sum(axis=2) if absent is None else total.sum(axis=2) - total[..., absent]
    if absent is not None and recording.n_frames is not None:
        total[..., absent] = np.uint64(recording.n_frames) - photons
    most = max(recording.n_photons or 0, recording.n_frames or 0)
    counts = total.astype(np.uint32 if most <= np.iinfo(np.uint32).max else np.uint64)
    counts.setflags(write=False)
    return replace(empty, counts=counts, n_frames=recording.n_frames or None)
