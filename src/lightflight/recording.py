"""Recordings: what the camera wrote, and the histograms they add up to.

- the record: `Recording` (frames of TDC codes, or photon events)
- files: `read`, `write` (one translator per format in `formats`)
- recording to histograms, streamed: `histogram` (the work is in `counting`)

Takes files of any length or arrays, gives the `Histograms` that `timing` fits.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from lightflight.histogram import Histograms

Progress = Callable[[int, int], None]
"""Called now and then with (done, in all), in frames or in photons."""

_CHUNK_BYTES = 16 << 20


class SlicedArray(Protocol):
    """Anything with a shape and a dtype that gives NumPy arrays when sliced.

    NumPy arrays, memory maps, HDF5 datasets, Zarr arrays and `formats` readers are such.
    """

    @property
    def shape(self) -> tuple[int, ...]:
        """Length of each axis."""

    @property
    def dtype(self) -> np.dtype[Any]:
        """Type of the elements."""

    def __getitem__(self, key: Any) -> Any:
        """Part of it, as an array."""


@dataclass(frozen=True, eq=False)
class Recording:
    """Raw photons: either dense `frames` of codes, or `pixel` and `code` of each event.

    Forward code `k` holds delays [f + k w, f + (k+1) w) after the laser sync; a reversed code
    (photon starts, sync stops) holds (P - f - (k+1) w, P - f - k w]; both modulo the period P.

    The arrays are not copied and may be memory maps or lie in a file; `histogram` streams them.
    Raises ValueError or TypeError where they do not fit together.
    """

    shape: tuple[int, int]
    """(rows, cols)."""

    n_codes: int = field(kw_only=True)
    """Number of TDC codes (PF32: 1,024); a code is 0 ... n_codes - 1."""

    frames: SlicedArray | None = field(default=None, kw_only=True, repr=False)
    """(n_frames, rows, cols) uint16 or uint8, TDC codes; None for events."""

    pixel: SlicedArray | None = field(default=None, kw_only=True, repr=False)
    """(n_photons,) unsigned, row * cols + col of each photon, frame by frame; None for frames."""

    code: SlicedArray | None = field(default=None, kw_only=True, repr=False)
    """(n_photons,) unsigned, TDC code of each photon; None for frames."""

    frame_starts: SlicedArray | None = field(default=None, kw_only=True, repr=False)
    """(n_frames + 1,) integers: photons frame_starts[i] ... frame_starts[i + 1] - 1 belong to
    frame i. None: dense frames, or events that know of no frames."""

    bin_width_ps: float | None = field(default=None, kw_only=True)
    """Nominal width w of one code, ps. None: unknown, and times stay in codes."""

    laser_period_ps: float | None = field(default=None, kw_only=True)
    """Period P of the laser, ps. None: one sweep, nothing folds."""

    n_frames: int | None = field(default=None, kw_only=True)
    """Frames recorded, empty ones included. Filled in where the arrays tell."""

    periods_per_frame: int | None = field(default=None, kw_only=True)
    """Laser periods in one frame (PF32 of the paper: 4,000)."""

    reversed_codes: bool = field(default=False, kw_only=True)
    """True where a larger code is an earlier photon (reverse start-stop)."""

    first_edge_ps: float = field(default=0.0, kw_only=True)
    """f: start of code 0 after the sync (reversed: before the next sync), ps."""

    no_photon_code: int | None = field(default=None, kw_only=True)
    """Code that means "no photon in this frame" (PF32: 0)."""

    truth: Any = field(default=None, kw_only=True, repr=False)
    """What made the recording, where a simulator knows it."""

    settings: Mapping[str, Any] = field(default_factory=dict, kw_only=True, repr=False)
    """Unknown metadata carried along (temperature, exposure, file of origin ...)."""

    footers: SlicedArray | None = field(default=None, kw_only=True, repr=False)
    """(n_frames, bytes) uint8, what the camera wrote after each frame, uninterpreted."""

    def __post_init__(self) -> None:
        rows, cols = (int(length) for length in self.shape)
        if rows < 1 or cols < 1:
            raise ValueError(f"shape must be (rows, cols) of at least one pixel, got {self.shape}")
        object.__setattr__(self, "shape", (rows, cols))
        if not 1 <= self.n_codes <= 1 << 16:
            raise ValueError(f"n_codes must be 1 ... 65536, got {self.n_codes}")
        if self.frames is not None:
            _check_frames(self)
        else:
            _check_events(self)
        if self.n_frames is not None and self.n_frames < 0:
            raise ValueError(f"n_frames must not be negative, got {self.n_frames}")
        # The clock is described, and therefore checked, exactly as for histograms.
        _empty_histograms(self)

    def _repr_html_(self) -> str:
        """What a notebook shows."""
        from lightflight.display import html_from_record

        return html_from_record(self)

    @property
    def kind(self) -> str:
        """Which of the two it is: "frames" or "events"."""
        return "frames" if self.frames is not None else "events"

    @property
    def n_photons(self) -> int | None:
        """Number of photon events; None for frames, which must be counted (`histogram`)."""
        return None if self.code is None else self.code.shape[0]

    @classmethod
    def from_frames(cls, frames: Any, *, n_codes: int, **clock: Any) -> Recording:
        """Recording of dense frames (n_frames, rows, cols) uint16; `clock` as for `Recording`."""
        cube = frames if hasattr(frames, "dtype") else np.asarray(frames)
        if len(cube.shape) != 3:
            raise ValueError(f"frames must have shape (n_frames, rows, cols), got {cube.shape}")
        return cls(cube.shape[1:], n_codes=n_codes, frames=cube, **clock)

    @classmethod
    def from_events(
        cls,
        row: ArrayLike,
        col: ArrayLike,
        code: ArrayLike,
        *,
        shape: tuple[int, int],
        n_codes: int,
        frame: ArrayLike | None = None,
        n_frames: int | None = None,
        **clock: Any,
    ) -> Recording:
        """Recording of single photons, in any order.

        Parameters
        ----------
        row, col, code : (n,) integers
            Pixel and TDC code of each photon.
        shape : (rows, cols)
            Pixels of the camera.
        n_codes : int
            Number of TDC codes.
        frame : (n,) integers, optional
            Frame of each photon, 0 ... n_frames - 1; photons are sorted by it.
        n_frames : int, optional
            Frames recorded, empty ones included; needed with `frame`.
        **clock
            The other fields of `Recording`.
        """
        rows, cols, codes = (np.asarray(values) for values in (row, col, code))
        if not rows.shape == cols.shape == codes.shape or rows.ndim != 1:
            raise ValueError(
                f"row, col and code must be of one length, got shapes {rows.shape}, {cols.shape} "
                f"and {codes.shape}"
            )
        for name, values, end in (("row", rows, shape[0]), ("col", cols, shape[1])):
            _check_range(name, values, end)
        _check_range("code", codes, n_codes)
        pixel = (rows.astype(np.int64) * shape[1] + cols).astype(pixel_dtype(shape))
        codes = codes.astype(np.uint16)
        starts = None
        if frame is not None:
            if n_frames is None:
                raise ValueError("frame needs n_frames: how many frames were recorded in all")
            frames = np.asarray(frame)
            if frames.shape != codes.shape:
                raise ValueError(f"frame must have shape {codes.shape}, got {frames.shape}")
            _check_range("frame", frames, n_frames)
            order = np.argsort(frames, kind="stable")
            pixel, codes = pixel[order], codes[order]
            starts = np.searchsorted(frames[order], np.arange(n_frames + 1)).astype(np.uint64)
        return cls(
            shape,
            n_codes=n_codes,
            pixel=pixel,
            code=codes,
            frame_starts=starts,
            n_frames=n_frames,
            **clock,
        )


CLOCK_FIELDS = (
    "bin_width_ps",
    "laser_period_ps",
    "n_frames",
    "periods_per_frame",
    "reversed_codes",
    "first_edge_ps",
    "no_photon_code",
)
"""Fields that `Recording` and `Histograms` share: how codes are read as times."""


def clock_of(record: Recording | Histograms) -> dict[str, Any]:
    """Fields of a record that say how its codes are read as times."""
    return {name: getattr(record, name) for name in CLOCK_FIELDS}


def _empty_histograms(recording: Recording) -> Histograms:
    clock = clock_of(recording)
    clock["n_frames"] = clock["n_frames"] or None
    return Histograms(np.zeros((1, 1, recording.n_codes), np.uint8), **clock)


def pixel_dtype(shape: tuple[int, int]) -> type[np.unsignedinteger[Any]]:
    """Smallest type that can number the pixels of a camera."""
    return np.uint16 if shape[0] * shape[1] <= 1 << 16 else np.uint32


def _check_range(name: str, values: NDArray[Any], end: int) -> None:
    if values.dtype.kind not in "iu":
        raise TypeError(f"{name} must hold integers, got dtype {values.dtype}")
    if values.size and (values.min() < 0 or values.max() >= end):
        raise ValueError(f"{name} must be 0 ... {end - 1}, got {values.min()} ... {values.max()}")


def _check_frames(recording: Recording) -> None:
    frames = recording.frames
    assert frames is not None
    if recording.pixel is not None or recording.code is not None:
        raise ValueError("give either frames, or pixel and code, not both")
    if len(frames.shape) != 3 or tuple(frames.shape[1:]) != recording.shape:
        raise ValueError(
            f"frames must have shape (n_frames, {recording.shape[0]}, {recording.shape[1]}), "
            f"got {tuple(frames.shape)}"
        )
    if frames.dtype not in (np.uint16, np.uint8):
        raise TypeError(f"frames must be uint16 or uint8 codes, got dtype {frames.dtype}")
    if recording.n_frames not in (None, frames.shape[0]):
        raise ValueError(f"n_frames = {recording.n_frames}, but there are {frames.shape[0]} frames")
    object.__setattr__(recording, "n_frames", int(frames.shape[0]))


def _check_events(recording: Recording) -> None:
    pixel, code, starts = recording.pixel, recording.code, recording.frame_starts
    if pixel is None or code is None:
        raise ValueError("give either frames, or both pixel and code")
    for name, values in (("pixel", pixel), ("code", code)):
        if len(values.shape) != 1 or values.dtype.kind != "u":
            raise TypeError(
                f"{name} must be a list of unsigned integers, got shape {tuple(values.shape)}, "
                f"dtype {values.dtype}"
            )
    if pixel.shape != code.shape:
        raise ValueError(f"{pixel.shape[0]} pixels do not match {code.shape[0]} codes")
    if starts is None:
        return
    n_frames = starts.shape[0] - 1
    if len(starts.shape) != 1 or n_frames < 0 or starts.dtype.kind not in "iu":
        raise TypeError(f"frame_starts must be (n_frames + 1,) integers, got {starts.shape}")
    if recording.n_frames not in (None, n_frames):
        raise ValueError(f"n_frames = {recording.n_frames}, but frame_starts tells {n_frames}")
    if int(starts[0:1][0]) != 0 or int(starts[n_frames : n_frames + 1][0]) != code.shape[0]:
        raise ValueError(f"frame_starts must run from 0 to {code.shape[0]}, the number of photons")
    object.__setattr__(recording, "n_frames", int(n_frames))


# --- files ------------------------------------------------------------------------------


def read(path: str | os.PathLike[str], **hints: Any) -> Recording | Histograms:
    """Read a recording or histograms from a file of any known format.

    The format is recognised by content first, then by suffix. Large recordings stay on disk
    and are streamed by `histogram`.

    Parameters
    ----------
    path : path
        File (or Zarr folder) to read.
    **hints
        What the file does not say; each format lists its own (`formats`). Common to all:
        format, bin_width_ps, laser_period_ps, reversed_codes, first_edge_ps, no_photon_code,
        n_frames, periods_per_frame, poisson. Arrays of unknown order take axes ("tyx").

    Raises
    ------
    FileFormatError
        If the file is missing, empty, truncated, foreign, damaged or not understood.
    TypeError
        If a hint is unknown to the format; the text names the nearest valid one.
    MissingExtraError
        If the format needs a package that is not installed.
    """
    from lightflight.formats.registry import read_file

    return read_file(path, hints)


def write(record: Recording | Histograms, path: str | os.PathLike[str], **options: Any) -> None:
    """Write a recording or histograms; the format follows from the suffix, or `format`.

    The file appears whole or not at all, and an existing one is replaced only at the end.

    Raises
    ------
    ValueError
        If no format has this suffix, or the format cannot hold such a record.
    OSError
        If the file cannot be written.
    """
    from lightflight.formats.registry import write_file

    write_file(record, path, options)


# --- recording to histograms ------------------------------------------------------------


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
    from lightflight.counting import counted

    return counted(
        recording,
        codes=codes,
        rows=rows,
        cols=cols,
        frames=frames,
        progress=progress,
        chunk_bytes=chunk_bytes,
    )
