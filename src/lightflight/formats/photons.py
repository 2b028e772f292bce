"""The photons of any recording, block by block, for the formats that keep photons."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lightflight.counting import check_codes
from lightflight.recording import Recording, pixel_dtype

_CHUNK_BYTES = 8 << 20


@dataclass(frozen=True, eq=False)
class PhotonBlock:
    """Photons of a run of frames, or of a run of photons where frames are unknown."""

    pixel: NDArray[Any]
    """(n,), row * cols + col."""

    code: NDArray[Any]
    """(n,), TDC code."""

    photons_per_frame: NDArray[np.uint32] | None
    """(frames of the block,); None where frames are unknown."""


def photon_blocks(
    recording: Recording, *, chunk_bytes: int = _CHUNK_BYTES
) -> Iterator[PhotonBlock]:
    """Photons in order, in blocks of bounded size; a block holds until the next is asked for.

    Raises ValueError for dense frames without `no_photon_code` (every code would be a photon)
    and for codes a recording cannot hold.
    """
    if recording.kind == "frames":
        yield from _blocks_of_frames(recording, chunk_bytes)
    elif recording.frame_starts is not None:
        yield from _blocks_of_framed_events(recording, chunk_bytes)
    else:
        pixel, code = recording.pixel, recording.code
        assert pixel is not None
        assert code is not None
        for first in range(0, code.shape[0], chunk_bytes // 4):
            part = slice(first, first + chunk_bytes // 4)
            yield PhotonBlock(np.asarray(pixel[part]), np.asarray(code[part]), None)


def _blocks_of_frames(recording: Recording, chunk_bytes: int) -> Iterator[PhotonBlock]:
    from lightflight._kernels.frames import SPARE, list_photons

    source, absent = recording.frames, recording.no_photon_code
    assert source is not None
    if absent is None:
        raise ValueError("frames without a no_photon_code are not photons: give no_photon_code")
    n_pixels = recording.shape[0] * recording.shape[1]
    step = max(1, chunk_bytes // (2 * n_pixels))
    pixels = np.empty(step * n_pixels + SPARE, pixel_dtype(recording.shape))
    codes = np.empty(step * n_pixels + SPARE, np.uint16)
    for first in range(0, source.shape[0], step):
        block = np.ascontiguousarray(source[first : first + step], np.uint16)
        block = block.reshape(-1, n_pixels)
        counts = np.empty(block.shape[0], np.uint32)
        n = list_photons(block, np.uint16(absent), pixels, codes, counts)
        if n and codes[:n].max() >= recording.n_codes:
            check_codes(recording, block, first)
        yield PhotonBlock(pixels[:n], codes[:n], counts)


def _blocks_of_framed_events(recording: Recording, chunk_bytes: int) -> Iterator[PhotonBlock]:
    pixel, code, all_starts = recording.pixel, recording.code, recording.frame_starts
    assert pixel is not None
    assert code is not None
    assert all_starts is not None
    assert recording.n_frames is not None
    n_pixels = recording.shape[0] * recording.shape[1]
    step = max(1, chunk_bytes // (4 * n_pixels))
    for first in range(0, recording.n_frames, step):
        starts = np.asarray(all_starts[first : first + step + 1])
        part = slice(int(starts[0]), int(starts[-1]))
        counts = np.diff(starts).astype(np.uint32)
        yield PhotonBlock(np.asarray(pixel[part]), np.asarray(code[part]), counts)
