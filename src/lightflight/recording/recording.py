"""Recordings: what the camera wrote, as frames of TDC codes or as photon events.

Files of any length come in by `formats.registry`; `counting` adds the photons up to `Histograms`.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from lightflight.arguments import pixels_of_shape, refuse_masks, whole_number
from lightflight.display import Card, Shown, clock_facts, count_facts, size_facts
from lightflight.recording.clock_fields import check_clock_fields, clock_fields_of

Progress = Callable[[int, int], None]
"""Called now and then with (done, in all), in frames or in photons."""


class SlicedArray(Protocol):
    """Anything with a shape and a dtype that gives NumPy arrays when sliced.

    NumPy arrays, memory maps, HDF5 datasets, Zarr arrays and `formats` readers are such.
    """

    @property
    def shape(self) -> tuple[int, ...]:
        """Length of each axis."""

    @property
    def dtype(self) -> np.dtype[np.generic]:
        """Type of the elements."""

    def __getitem__(self, key: Any) -> Any:
        """Part of it, as an array."""


@dataclass(frozen=True, eq=False, repr=False)
class Recording(Shown):
    """Raw photons: either dense `frames` of codes, or `pixel` and `code` of each event.

    Forward code `k` holds delays [f + k w, f + (k+1) w) after the laser sync; a reversed code
    (photon starts, sync stops) holds (P - f - (k+1) w, P - f - k w]; both modulo the period P.

    The arrays are not copied and may be memory maps or lie in a file; `histogram` streams them.
    Raises ValueError or TypeError where they do not fit together.

    Attributes
    ----------
    shape : (int, int)
        (rows, cols).
    n_codes : int
        Number of TDC codes (PF32: 1,024); a code is 0 ... n_codes - 1.
    frames : SlicedArray or None
        (n_frames, rows, cols) uint16 or uint8, TDC codes; None for events.
    pixel : SlicedArray or None
        (n_photons,) unsigned, row * cols + col of each photon, frame by frame; None for frames.
    code : SlicedArray or None
        (n_photons,) unsigned, TDC code of each photon; None for frames.
    frame_starts : SlicedArray or None
        (n_frames + 1,) integers: photons frame_starts[i] ... frame_starts[i + 1] - 1 belong to
        frame i. None: dense frames, or events that know of no frames.
    bin_width_ps : float or None
        Nominal width w of one code, ps. None: unknown, and times stay in codes.
    laser_period_ps : float or None
        Period P of the laser, ps. None: one sweep, nothing folds.
    n_frames : int or None
        Frames recorded, empty ones included. Filled in where the arrays tell.
    periods_per_frame : int or None
        Laser periods in one frame (PF32 of the paper: 4,000).
    reversed_codes : bool
        True where a larger code is an earlier photon (reverse start-stop).
    first_edge_ps : float
        f: start of code 0 after the sync (reversed: before the next sync), ps.
    no_photon_code : int or None
        Code that means "no photon in this frame" (PF32: 0).
    truth : object
        What made the recording, where a simulator knows it.
    settings : mapping of str
        Unknown metadata carried along (temperature, exposure, file of origin ...).
    footers : SlicedArray or None
        (n_frames, bytes) uint8, what the camera wrote after each frame, uninterpreted.
    """

    shape: tuple[int, int]

    n_codes: int = field(kw_only=True)

    frames: SlicedArray | None = field(default=None, kw_only=True, repr=False)

    pixel: SlicedArray | None = field(default=None, kw_only=True, repr=False)

    code: SlicedArray | None = field(default=None, kw_only=True, repr=False)

    frame_starts: SlicedArray | None = field(default=None, kw_only=True, repr=False)

    bin_width_ps: float | None = field(default=None, kw_only=True)

    laser_period_ps: float | None = field(default=None, kw_only=True)

    n_frames: int | None = field(default=None, kw_only=True)

    periods_per_frame: int | None = field(default=None, kw_only=True)

    reversed_codes: bool = field(default=False, kw_only=True)

    first_edge_ps: float = field(default=0.0, kw_only=True)

    no_photon_code: int | None = field(default=None, kw_only=True)

    truth: Any = field(default=None, kw_only=True, repr=False)

    settings: Mapping[str, Any] = field(default_factory=dict, kw_only=True, repr=False)

    footers: SlicedArray | None = field(default=None, kw_only=True, repr=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "shape", pixels_of_shape(self.shape))
        for name in ("frames", "pixel", "code"):
            refuse_masks(name, getattr(self, name))
        if not 1 <= whole_number("n_codes", self.n_codes) <= 1 << 16:
            raise ValueError(f"n_codes must be 1 ... 65536, got {self.n_codes}")
        if self.frames is not None:
            _check_frames(self)
        else:
            _check_events(self)
        # No frames at all is a recording (of nothing); of histograms the number is then unknown.
        clock = clock_fields_of(self) | {"n_frames": None if self.n_frames == 0 else self.n_frames}
        check_clock_fields(clock, n_codes=self.n_codes)

    def _card(self) -> Card:
        # No picture: to count the photons could take minutes.
        facts = [*size_facts(self.shape), ("kind", self.kind), *clock_facts(self)]
        facts += count_facts(frames=self.n_frames, photon_events=self.n_photons)
        return Card("Recording", facts)

    @property
    def kind(self) -> str:
        """Which of the two it is: "frames" or "events"."""
        return "frames" if self.frames is not None else "events"

    @property
    def n_photons(self) -> int | None:
        """Number of photon events; None for frames, which must be counted (`histogram`)."""
        return None if self.code is None else self.code.shape[0]

    @classmethod
    def from_frames(cls, frames: SlicedArray, *, n_codes: int, **clock: Any) -> Recording:
        """Recording of dense frames.

        Parameters
        ----------
        frames : array of int, shape (n_frames, rows, cols)
            uint16 or uint8 TDC codes; may be a memory map or lie in a file.
        n_codes : int
            Number of TDC codes.
        **clock : object
            The other fields of `Recording`.

        Raises
        ------
        ValueError
            For another shape.
        """
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
        row, col, code : array of int, shape (n,)
            Pixel and TDC code of each photon.
        shape : (int, int)
            (rows, cols) of the camera.
        n_codes : int
            Number of TDC codes.
        frame : array of int, shape (n,), optional
            Frame of each photon, 0 ... n_frames - 1; photons are sorted by it.
        n_frames : int, optional
            Frames recorded, empty ones included; needed with `frame`.
        **clock : object
            The other fields of `Recording`.

        Returns
        -------
        Recording
            Of events, frame by frame.

        Raises
        ------
        ValueError
            For arrays of different lengths, and numbers that cannot be.
        TypeError
            For arrays that hold no integers.
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


def pixel_dtype(shape: tuple[int, int]) -> type[np.unsignedinteger]:
    """Smallest type that can number the pixels of a camera."""
    return np.uint16 if shape[0] * shape[1] <= 1 << 16 else np.uint32


def _check_range(name: str, values: NDArray[np.generic], end: int) -> None:
    """Raise where values are no integers or reach beyond 0 ... end - 1."""
    if values.dtype.kind not in "iu":
        raise TypeError(f"{name} must hold integers, got dtype {values.dtype}")
    if values.size and (values.min() < 0 or values.max() >= end):
        raise ValueError(f"{name} must be 0 ... {end - 1}, got {values.min()} ... {values.max()}")


def _check_frames(recording: Recording) -> None:
    """Raise where dense frames are not what the other fields say; fill in `n_frames`."""
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
    """Raise where photon events are not what the other fields say; fill in `n_frames`."""
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
