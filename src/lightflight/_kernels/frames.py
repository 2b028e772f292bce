"""Counting kernels: dense frames of TDC codes, or photon events, into counts per pixel and code.

`slot` maps a pixel to its row in `counts` (-1: left out). `counts` is (slots, codes of the
window), any unsigned type; the window starts at `first_code`.
"""

from __future__ import annotations

from typing import Any

from numpy.typing import NDArray

from lightflight._kernels.jit import jit


@jit
def count_frames(
    frames: NDArray[Any],
    slot: NDArray[Any],
    no_photon_code: int,
    n_codes: int,
    first_code: int,
    counts: NDArray[Any],
) -> int:
    """Add frames (n, pixels) to `counts`; codes equal to `no_photon_code` are skipped.

    Returns the flat index of the first code that is not below `n_codes`, or -1.
    """
    n_frames, n_pixels = frames.shape
    n_kept = counts.shape[1]
    for i in range(n_frames):
        for pixel in range(n_pixels):
            code = int(frames[i, pixel])
            if code != no_photon_code:
                if code >= n_codes:
                    return i * n_pixels + pixel
                k = code - first_code
                if slot[pixel] >= 0 and 0 <= k < n_kept:
                    counts[slot[pixel], k] += 1
    return -1


@jit
def count_events(
    pixels: NDArray[Any],
    codes: NDArray[Any],
    slot: NDArray[Any],
    no_photon_code: int,
    n_codes: int,
    first_code: int,
    counts: NDArray[Any],
) -> int:
    """Add photon events (n,) to `counts`.

    Returns the index of the first event whose pixel or code does not exist, or -1.
    """
    n_kept = counts.shape[1]
    for i in range(pixels.size):
        pixel = int(pixels[i])
        code = int(codes[i])
        if pixel >= slot.size or code >= n_codes:
            return i
        k = code - first_code
        if code != no_photon_code and slot[pixel] >= 0 and 0 <= k < n_kept:
            counts[slot[pixel], k] += 1
    return -1


@jit
def events_from_frames(
    frames: NDArray[Any],
    no_photon_code: int,
    n_codes: int,
    pixels: NDArray[Any],
    codes: NDArray[Any],
    photons_per_frame: NDArray[Any],
) -> int:
    """List the photons of frames (n, pixels), frame by frame, and count them per frame.

    `pixels` and `codes` have room for every pixel of every frame. Returns how many photons were
    listed, or -1 - index where that (flat) index holds a code that is not below `n_codes`.
    """
    n_frames, n_pixels = frames.shape
    n = 0
    for i in range(n_frames):
        before = n
        for pixel in range(n_pixels):
            code = int(frames[i, pixel])
            if code != no_photon_code:
                if code >= n_codes:
                    return -1 - (i * n_pixels + pixel)
                pixels[n] = pixel
                codes[n] = code
                n += 1
        photons_per_frame[i] = n - before
    return n
