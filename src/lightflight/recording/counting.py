"""`histogram`: frames and events, counted block by block into one cube.

Memory is bounded whatever the length of the recording, and the result does not depend on how it
is cut into blocks.
"""

from __future__ import annotations

import mmap
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lightflight.arguments import shown, whole_number
from lightflight.errors import FileFormatError
from lightflight.files.filecheck import allowed_memory_bytes, memory_sentence
from lightflight.files.mapped import map_of, rows_of
from lightflight.recording.clock_fields import clock_fields_of
from lightflight.recording.histograms import Histograms
from lightflight.recording.recording import Progress, Recording

_CHUNK_BYTES = 16 << 20
_PADDED_BYTES = 1 << 26


def histogram(
    recording: Recording | Histograms,
    *,
    codes: tuple[int, int] | None = None,
    rows: tuple[int, int] | None = None,
    cols: tuple[int, int] | None = None,
    frames: tuple[int, int] | None = None,
    progress: Progress | None = None,
    chunk_bytes: int = _CHUNK_BYTES,
) -> Histograms:
    """Counts per pixel and code, streamed: memory does not grow with the recording.

    Parameters
    ----------
    recording : Recording or Histograms
        Histograms are only cut.
    codes, rows, cols : (start, end), optional
        Keep these codes and pixels alone, so that the cube of a megapixel camera fits.
        The times of the codes that are kept do not change (`first_edge_ps` moves along).
    frames : (start, end), optional
        Count these frames alone.
    progress : callable, optional
        Called as progress(done, in all), in frames or in photons.
    chunk_bytes : int
        Bytes taken from the recording at a time; the result does not depend on it.

    Returns
    -------
    Histograms
        `counts` is (rows, cols, codes) uint32, or uint64 where a uint32 could wrap. Where the
        recording has a `no_photon_code`, its column holds the frames without a photon among
        the codes that are kept.

    Raises
    ------
    ValueError
        If a window is empty or reaches beyond the recording, the cube does not fit into memory,
        or the recording holds a code or a pixel it cannot have (the text says where; from a
        file this is a FileFormatError).
    """
    if not isinstance(recording, Recording | Histograms):
        raise TypeError(f"recording cannot be {shown(recording)}: give what read() returns")
    window = _Window(
        _checked_range("rows", rows, recording.shape[0]),
        _checked_range("cols", cols, recording.shape[1]),
        _checked_range("codes", codes, recording.n_codes),
    )
    if isinstance(recording, Histograms):
        if frames is not None:
            raise ValueError("frames cannot be chosen: these are histograms already")
        cube, n_frames = recording.counts[window.slices], recording.n_frames
    else:
        count = _count_frames if recording.kind == "frames" else _count_events
        cube, n_frames = count(recording, window, frames, progress, chunk_bytes)
    return _histograms_from_counts(recording, window, cube, n_frames)


@dataclass(frozen=True)
class _Window:
    """The pixels and codes that are kept, each as (start, end)."""

    rows: tuple[int, int]
    cols: tuple[int, int]
    codes: tuple[int, int]

    @property
    def slices(self) -> tuple[slice, slice, slice]:
        return slice(*self.rows), slice(*self.cols), slice(*self.codes)

    @property
    def start(self) -> tuple[int, int, int]:
        return self.rows[0], self.cols[0], self.codes[0]

    @property
    def shape(self) -> tuple[int, int, int]:
        rows, cols, codes = (end - start for start, end in (self.rows, self.cols, self.codes))
        return rows, cols, codes

    def empty_cube(self, *, most: int) -> NDArray[np.unsignedinteger]:
        """Zeros (rows, cols, codes or a few more), of a type that `most` counts cannot wrap."""
        from lightflight._kernels.frames import padded_columns

        dtype = np.dtype(np.uint32 if most <= np.iinfo(np.uint32).max else np.uint64)
        rows, cols, codes = self.shape
        needed = dtype.itemsize * rows * cols * codes
        if needed > allowed_memory_bytes():
            raise ValueError(
                f"a cube of {rows} x {cols} pixels and {codes} codes needs {needed / 1e9:.3g} GB: "
                f"keep a part with codes=, rows= or cols=; {memory_sentence()}"
            )
        # Padding is taken off by a copy, which a large cube may leave no room for.
        is_small = needed <= _PADDED_BYTES
        columns = padded_columns(codes, dtype.itemsize) if is_small else codes
        return np.zeros((rows, cols, columns), dtype)

    def trimmed(self, cube: NDArray[np.generic]) -> NDArray[np.generic]:
        """The cube without the codes that were added to it; not copied where there are none."""
        return cube if cube.shape == self.shape else cube[..., : self.shape[2]].copy()

    def slot_from_pixel(self, shape: tuple[int, int]) -> NDArray[np.int64]:
        """(rows * cols,), place of each pixel in the cube, -1 where it is left out."""
        needed = np.dtype(np.int64).itemsize * shape[0] * shape[1]
        if needed > allowed_memory_bytes():
            raise ValueError(
                f"a camera of {shape[0]} x {shape[1]} pixels needs {needed / 1e9:.3g} GB to be "
                f"looked up in: see whether its shape is right; {memory_sentence()}"
            )
        # -1: the kernel passes over the pixel.
        slot = np.full(shape, -1, dtype=np.int64)
        kept = slot[self.slices[:2]]
        kept[...] = np.arange(kept.size).reshape(kept.shape)
        return slot.ravel()


def _checked_range(name: str, wanted: tuple[int, int] | None, length: int) -> tuple[int, int]:
    """(start, end) within 0 ... length; all of it for None."""
    if wanted is None:
        return 0, length
    must = f"be (start, end) within 0 ... {length}"
    try:
        start, end = (whole_number(name, edge) for edge in wanted)
    except (TypeError, ValueError):
        raise ValueError(f"{name} must {must}, got {shown(wanted)}") from None
    if not 0 <= start < end <= length:
        raise ValueError(
            f"{name} = ({start}, {end}) must ascend and lie within 0 ... {length}: the end is "
            "the first that is left out"
        )
    return start, end


def _count_frames(
    recording: Recording,
    window: _Window,
    frames: tuple[int, int] | None,
    progress: Progress | None,
    chunk_bytes: int,
) -> tuple[NDArray[np.generic], int]:
    """(cube, number of frames), of dense frames."""
    from lightflight._kernels import frames as kernels

    source, absent, n_codes = recording.frames, recording.no_photon_code, recording.n_codes
    assert source is not None
    start, end = _checked_range("frames", frames, source.shape[0])
    slot = window.slot_from_pixel(recording.shape)
    cube = window.empty_cube(most=end - start)
    counts = cube.reshape(-1, cube.shape[2])
    kept = window.codes[0], window.shape[2]
    # Whole pictures need no look-up of where a pixel and a code go.
    is_whole = window.shape == (*recording.shape, n_codes)
    lit, codes = np.empty((2, kernels.PIECE + kernels.SPARE), np.uint16)
    places = np.empty((2, kernels.PIECE), np.uint64)

    def add(block: NDArray[np.uint16]) -> bool:
        given = block, np.uint16(absent or 0), n_codes
        if is_whole:
            return kernels.add_frames(*given, lit, places, counts)
        return kernels.add_frames_in_window(*given, slot, *kept, lit, codes, counts)

    for first, last in _chunks(start, end, chunk_bytes // (slot.size * source.dtype.itemsize)):
        block = np.ascontiguousarray(rows_of(source, first, last), np.uint16).reshape(-1, slot.size)
        if absent is None:
            check_codes(recording, block, first)
            kernels.add_all_codes(block, slot, *kept, counts)
        elif not add(block):
            check_codes(recording, block, first)
        _release_pages(source)
        if progress is not None:
            progress(last - start, end - start)
    _fill_no_photon_code(recording, counts, window, end - start)
    return window.trimmed(cube), end - start


def _chunks(start: int, end: int, step: int) -> Iterator[tuple[int, int]]:
    """(first, last) of runs of `step`, the last one shorter."""
    step = max(1, step)
    for first in range(start, end, step):
        yield first, min(first + step, end)


def check_codes(recording: Recording, block: NDArray[np.uint16], first_frame: int) -> None:
    """Raise where a block of frames holds a code it cannot, saying where.

    Parameters
    ----------
    recording : Recording
        Whose frames they are.
    block : array of uint16, shape (n, pixels)
        Some of its frames.
    first_frame : int
        Number of the first.

    Raises
    ------
    ValueError
        Naming frame, pixel and code; a FileFormatError where the frames lie in a file.
    """
    if block.size == 0 or block.max() < recording.n_codes:
        return
    bad = np.argwhere(block >= recording.n_codes)
    if len(bad):
        frame, pixel = (int(index) for index in bad[0])
        row, col = divmod(pixel, recording.shape[1])
        raise _bad_content(
            recording.frames,
            f"frame {first_frame + frame}, pixel ({row}, {col}) holds code {block[frame, pixel]}, "
            f"but the recording has {recording.n_codes} codes: check shape, footers and byte order",
        )


def _bad_content(source: object, message: str) -> ValueError:
    """Error about what an array holds, naming its file where it lies in one."""
    path = getattr(source, "path", None) or getattr(source, "filename", None)
    return ValueError(message) if path is None else FileFormatError(message, path=path)


def _count_events(
    recording: Recording,
    window: _Window,
    frames: tuple[int, int] | None,
    progress: Progress | None,
    chunk_bytes: int,
) -> tuple[NDArray[np.generic], int | None]:
    """(cube, number of frames), of photon events."""
    from lightflight._kernels.frames import add_events

    pixel, code = recording.pixel, recording.code
    assert pixel is not None
    assert code is not None
    start, end, n_frames = _photons_of_frames(recording, frames)
    slot = window.slot_from_pixel(recording.shape)
    cube = window.empty_cube(most=max(end - start, n_frames or 0))
    counts = cube.reshape(-1, cube.shape[2])
    kept = window.codes[0], window.shape[2]
    is_whole = window.shape == (*recording.shape, recording.n_codes)
    # A photon takes four bytes: pixel and code, two each.
    for first, last in _chunks(start, end, chunk_bytes // 4):
        pixels, codes = (
            np.asarray(rows_of(pixel, first, last)),
            np.asarray(rows_of(code, first, last)),
        )
        if not add_events(pixels, codes, recording.n_codes, slot, *kept, is_whole, counts):
            raise _no_such_photon(recording, pixels, codes, first)
        _release_pages(pixel)
        _release_pages(code)
        if progress is not None:
            progress(last - start, end - start)
    _fill_no_photon_code(recording, counts, window, n_frames)
    return window.trimmed(cube), n_frames


def _no_such_photon(
    recording: Recording, pixels: NDArray[np.integer], codes: NDArray[np.integer], first: int
) -> ValueError:
    """Error that says which photon is of a pixel or a code that does not exist."""
    n_pixels, n_codes = recording.shape[0] * recording.shape[1], recording.n_codes
    bad = int(np.argmax((pixels >= n_pixels) | (codes >= n_codes)))
    return _bad_content(
        recording.code,
        f"photon {first + bad} is of pixel {pixels[bad]} and code {codes[bad]}, but the recording "
        f"has {n_pixels} pixels and {n_codes} codes: the file is damaged",
    )


def _photons_of_frames(
    recording: Recording, frames: tuple[int, int] | None
) -> tuple[int, int, int | None]:
    """(first photon, end, number of frames) of a range of frames, or of all."""
    starts, n_frames = recording.frame_starts, recording.n_frames
    if frames is None:
        return 0, recording.n_photons or 0, n_frames
    if starts is None or n_frames is None:
        raise ValueError("frames cannot be chosen: these events do not tell their frames")
    first, end = _checked_range("frames", frames, n_frames)
    return int(starts[first : first + 1][0]), int(starts[end : end + 1][0]), end - first


def _fill_no_photon_code(
    recording: Recording, counts: NDArray[np.generic], window: _Window, n_frames: int | None
) -> None:
    """Frames without a photon, in the column of the code that says so; 0 where unknown."""
    column = _column_without_photon(recording, window)
    if column is None:
        return
    counts[:, column] = 0
    if n_frames is None:
        return
    photons = counts.sum(axis=1, dtype=np.uint64)
    if photons.max() > n_frames:
        raise _bad_content(
            recording.code,
            f"a pixel has {photons.max()} photons in {n_frames} frames, but a recording with a "
            "no_photon_code holds one per frame: set no_photon_code to None",
        )
    counts[:, column] = n_frames - photons


def _column_without_photon(record: Recording | Histograms, window: _Window) -> int | None:
    """Column of the code that means no photon, where it is kept."""
    absent, (start, end) = record.no_photon_code, window.codes
    return absent - start if absent is not None and start <= absent < end else None


def _release_pages(source: object) -> None:
    """Give back the pages of a read-only memory map, which would count as our memory."""
    if isinstance(source, np.memmap) and source.mode == "r" and hasattr(mmap, "MADV_DONTNEED"):
        whole = map_of(source)
        if whole is not None:
            whole.madvise(mmap.MADV_DONTNEED)


def _histograms_from_counts(
    record: Recording | Histograms, window: _Window, cube: NDArray[np.generic], n_frames: int | None
) -> Histograms:
    """Record of a cube: the clock of the recording, moved to the first code that is kept."""
    clock = clock_fields_of(record)
    clock["n_frames"] = n_frames or None
    # Where the width of a code is unknown, times count in codes.
    clock["first_edge_ps"] += window.codes[0] * (record.bin_width_ps or 1.0)
    clock["no_photon_code"] = _column_without_photon(record, window)
    settings = dict(record.settings)
    if cube.shape != (*record.shape, record.n_codes):
        settings["window_start"] = list(window.start)
    cube.setflags(write=False)
    return Histograms(
        cube,
        **clock,
        poisson=getattr(record, "poisson", True),
        truth=record.truth,
        settings=settings,
    )
