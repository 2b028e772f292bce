"""The photons of any recording, block by block, for the formats that keep photons."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lightflight.files.mapped import rows_of
from lightflight.recording.counting import check_codes
from lightflight.recording.recording import Recording, pixel_dtype

_CHUNK_BYTES = 8 << 20


@dataclass(frozen=True, eq=False)
class PhotonBlock:
    """Photons of a run of frames, or of a run of photons where frames are unknown.

    Attributes
    ----------
    pixel : array, shape (n,)
        Row * cols + col.
    code : array, shape (n,)
        TDC code.
    photons_per_frame : array of uint32 or None
        (frames of the block,); None where frames are unknown.
    """

    pixel: NDArray[np.integer]

    code: NDArray[np.integer]

    photons_per_frame: NDArray[np.uint32] | None


def photon_blocks(recording: Recording) -> Iterator[PhotonBlock]:
    """Photons in order, in blocks of bounded size; a block holds until the next is asked for.

    Parameters
    ----------
    recording : Recording
        Of frames or of events.

    Yields
    ------
    PhotonBlock
        A run of frames, or of photons where frames are unknown.

    Raises
    ------
    ValueError
        For dense frames without `no_photon_code` (every code would be a photon) and for codes a
        recording cannot hold.
    """
    if recording.kind == "frames":
        yield from _blocks_of_frames(recording)
    elif recording.frame_starts is not None:
        yield from _blocks_of_framed_events(recording)
    else:
        pixel, code = recording.pixel, recording.code
        assert pixel is not None
        assert code is not None
        for first in range(0, code.shape[0], _CHUNK_BYTES // 4):
            part = slice(first, first + _CHUNK_BYTES // 4)
            yield PhotonBlock(np.asarray(pixel[part]), np.asarray(code[part]), None)


def _blocks_of_frames(recording: Recording) -> Iterator[PhotonBlock]:
    """Blocks of dense frames, listed by a compiled kernel into the same two arrays."""
    from lightflight._kernels.frames import SPARE, list_photons

    source, absent = recording.frames, recording.no_photon_code
    assert source is not None
    if absent is None:
        raise ValueError("frames without a no_photon_code are not photons: give no_photon_code")
    n_pixels = recording.shape[0] * recording.shape[1]
    step = max(1, _CHUNK_BYTES // (2 * n_pixels))
    # Used again for every block: a block holds until the next is asked for.
    pixels = np.empty(step * n_pixels + SPARE, pixel_dtype(recording.shape))
    codes = np.empty(step * n_pixels + SPARE, np.uint16)
    for first in range(0, source.shape[0], step):
        block = np.ascontiguousarray(rows_of(source, first, first + step), np.uint16)
        block = block.reshape(-1, n_pixels)
        counts = np.empty(block.shape[0], np.uint32)
        n = list_photons(block, np.uint16(absent), pixels, codes, counts)
        if n and codes[:n].max() >= recording.n_codes:
            check_codes(recording, block, first)
        yield PhotonBlock(pixels[:n], codes[:n], counts)


def _blocks_of_framed_events(recording: Recording) -> Iterator[PhotonBlock]:
    """Blocks of whole frames of events."""
    pixel, code, all_starts = recording.pixel, recording.code, recording.frame_starts
    assert pixel is not None
    assert code is not None
    assert all_starts is not None
    assert recording.n_frames is not None
    n_pixels = recording.shape[0] * recording.shape[1]
    step = max(1, _CHUNK_BYTES // (4 * n_pixels))
    for first in range(0, recording.n_frames, step):
        starts = np.asarray(all_starts[first : first + step + 1])
        part = slice(int(starts[0]), int(starts[-1]))
        counts = np.diff(starts).astype(np.uint32)
        yield PhotonBlock(np.asarray(pixel[part]), np.asarray(code[part]), counts)
