"""Counting kernels: dense frames of TDC codes, or photon events, into counts per pixel and code.

Sparse frames are first listed as photons, a few frames at a time so that the list stays in the
nearest cache, and then counted. No kernel checks its input: codes and pixels must lie within
`counts`, or within `slot` and the TDC.

`counts` may have more columns than codes. Rows of 1,024 uint32 are one page long, and a pulse
that every pixel has at the same code then falls on a few cache sets: counting is four times
slower than with `padded_columns`.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from lightflight._kernels.jit import jit
from lightflight._kernels.lanes import (
    LANES,
    count_of_bits,
    fetch_ahead,
    lanes_other_than,
    lowest_bit,
)

SPARE = 4
"""Places beyond the last photon that `list_photons` may write to."""

CHECKED_TOGETHER = 1 << 14
"""Photons that are checked before they are counted."""

_AHEAD = 2048
"""Codes between what is looked at and what is asked of memory; without, scanning takes twice as
long and more."""

_PHOTONS_AHEAD = 64
"""Photons between the one that is counted and the one whose count is asked of memory."""

_PAGE_BYTES = 4096
_LINE_BYTES = 64


def padded_columns(n_codes: int, item_bytes: int) -> int:
    """Columns that keep the rows of `counts` from lying whole pages apart."""
    is_page = n_codes * item_bytes % _PAGE_BYTES == 0
    return n_codes + _LINE_BYTES // item_bytes if is_page else n_codes


@jit
def list_photons(
    frames: NDArray[np.uint16],
    absent: np.uint16,
    pixels: NDArray[Any],
    codes: NDArray[np.uint16],
    photons_per_frame: NDArray[Any],
) -> int:
    """List pixel and code of every photon of contiguous frames (n, pixels); returns how many.

    `absent` (uint16) is the code that means no photon. The lists have room for every pixel of
    every frame and `SPARE` more. Of 32 pixels the first four that may hold a photon are written
    without asking, since at usual occupancies a branch for each would be guessed wrong.
    """
    n_frames, n_pixels = frames.shape
    whole = n_pixels // LANES * LANES
    n = 0
    for i in range(n_frames):
        row = frames[i]
        before = n
        for start in range(0, whole, LANES):
            fetch_ahead(row, start + _AHEAD)
            lit = lanes_other_than(row, start, absent)
            end = n + count_of_bits(lit)
            for j in range(SPARE):
                pixel = start + (lowest_bit(lit) & (LANES - 1))
                pixels[n + j] = pixel
                codes[n + j] = row[pixel]
                lit &= lit - np.uint32(1)
            n += SPARE
            while n < end:
                pixel = start + lowest_bit(lit)
                pixels[n] = pixel
                codes[n] = row[pixel]
                lit &= lit - np.uint32(1)
                n += 1
            n = end
        for pixel in range(whole, n_pixels):
            if row[pixel] != absent:
                pixels[n] = pixel
                codes[n] = row[pixel]
                n += 1
        photons_per_frame[i] = n - before
    return n


@jit
def largest_of(values: NDArray[Any]) -> Any:
    """Largest of at least one value."""
    largest = values[0]
    for i in range(values.size):
        largest = max(largest, values[i])
    return largest


@jit
def add_photons(pixels: NDArray[Any], codes: NDArray[Any], counts: NDArray[Any]) -> None:
    """Add photons to `counts` (pixels, codes), whose rows lie one after another."""
    flat, n_columns = counts.reshape(counts.size), counts.shape[1]
    n_told = max(0, pixels.size - _PHOTONS_AHEAD)
    for i in range(n_told):
        later = i + _PHOTONS_AHEAD
        fetch_ahead(flat, np.int64(pixels[later]) * n_columns + codes[later])
        flat[np.int64(pixels[i]) * n_columns + codes[i]] += 1
    for i in range(n_told, pixels.size):
        flat[np.int64(pixels[i]) * n_columns + codes[i]] += 1


@jit
def add_photons_in_window(
    pixels: NDArray[Any],
    codes: NDArray[Any],
    slot: NDArray[np.int64],
    first_code: int,
    n_kept: int,
    counts: NDArray[Any],
) -> None:
    """Add photons to `counts` (slots, `n_kept` codes from `first_code`); slot -1 is left out."""
    for i in range(pixels.size):
        place = slot[pixels[i]]
        k = np.int64(codes[i]) - first_code
        if place >= 0 and 0 <= k < n_kept:
            counts[place, k] += 1


@jit
def add_all_codes(
    frames: NDArray[Any],
    slot: NDArray[np.int64],
    first_code: int,
    n_kept: int,
    counts: NDArray[Any],
) -> None:
    """Add every code of frames (n, pixels), for cameras without a code for "no photon"."""
    n_frames, n_pixels = frames.shape
    for i in range(n_frames):
        for pixel in range(n_pixels):
            k = np.int64(frames[i, pixel]) - first_code
            if slot[pixel] >= 0 and 0 <= k < n_kept:
                counts[slot[pixel], k] += 1


@jit
def add_frames(
    frames: NDArray[np.uint16],
    absent: np.uint16,
    n_codes: int,
    slot: NDArray[np.int64],
    first_code: int,
    n_kept: int,
    is_whole: bool,
    pixels: NDArray[Any],
    codes: NDArray[np.uint16],
    counts: NDArray[Any],
) -> bool:
    """Add the photons of frames (n, pixels) to `counts`, as many frames at a time as fit.

    `is_whole`: every pixel and code is kept, in order. `pixels` and `codes` are scratch, as for
    `list_photons`. Returns False, and stops, where a frame holds a code not below `n_codes`.
    """
    n_frames, n_pixels = frames.shape
    step = (pixels.size - SPARE) // n_pixels
    per_frame = np.empty(step, np.uint32)
    for first in range(0, n_frames, step):
        n = list_photons(frames[first : first + step], absent, pixels, codes, per_frame)
        if n > 0 and largest_of(codes[:n]) >= n_codes:
            return False
        if is_whole:
            add_photons(pixels[:n], codes[:n], counts)
        else:
            add_photons_in_window(pixels[:n], codes[:n], slot, first_code, n_kept, counts)
    return True


@jit
def add_events(
    pixels: NDArray[Any],
    codes: NDArray[Any],
    n_codes: int,
    slot: NDArray[np.int64],
    first_code: int,
    n_kept: int,
    is_whole: bool,
    counts: NDArray[Any],
) -> bool:
    """Add photons to `counts`; False, and stops, where one is of no pixel or code there is.

    Photons are checked some thousands at a time, so that they are read from memory once.
    """
    for start in range(0, pixels.size, CHECKED_TOGETHER):
        some_pixels = pixels[start : start + CHECKED_TOGETHER]
        some_codes = codes[start : start + CHECKED_TOGETHER]
        if largest_of(some_pixels) >= slot.size or largest_of(some_codes) >= n_codes:
            return False
        if is_whole:
            add_photons(some_pixels, some_codes, counts)
        else:
            add_photons_in_window(some_pixels, some_codes, slot, first_code, n_kept, counts)
    return True
