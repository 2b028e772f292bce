"""One recording from file to path file: whole, or shared out into `pieces` or `tiles`."""

from __future__ import annotations

from pathlib import Path

from lightflight.batch.job import Job, Shares, finish, make_folder, read_recording, task
from lightflight.batch.pieces import n_pieces_of
from lightflight.batch.tiles import check_tiles, n_sorted_pieces_of, n_tiles_of
from lightflight.batch.warnings_said import caught_warnings
from lightflight.recording.counting import histogram
from lightflight.recording.histograms import Histograms
from lightflight.recording.recording import Recording


@task
def begin(job: Job) -> Shares | None:
    """Reconstruct a recording, or say how it is to be shared out.

    Parameters
    ----------
    job : Job
        The recording.

    Returns
    -------
    Shares or None
        None: done.
    """
    make_folder(Path(job.target).parent)
    record = read_recording(job.recording, job.lab)
    if not isinstance(record, Histograms):  # those are counted already, and fit into memory
        shares = shares_of(job, record)
        if shares is not None:
            return shares
    with caught_warnings() as said:
        finish(job, histogram(record, codes=job.codes), said)
    return None


def shares_of(job: Job, recording: Recording) -> Shares | None:
    """How to share a recording out.

    Parameters
    ----------
    job : Job
        The recording.
    recording : Recording
        What the file holds.

    Returns
    -------
    Shares or None
        None: one task does it.

    Raises
    ------
    ConfigError
        Where it needs tiles and the method does not work in tiles.
    """
    # Tiles first: a cube that is too large for one task is so however its photons are counted.
    n_tiles = n_tiles_of(recording, job.codes, job.tile_bytes)
    if n_tiles > 1:
        check_tiles(job)
        return Shares(n_sorted_pieces_of(recording, job.piece_bytes), n_tiles)
    n_pieces = n_pieces_of(recording, job.piece_bytes)
    return None if n_pieces == 1 else Shares(n_pieces)
