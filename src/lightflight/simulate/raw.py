"""Raw recordings: frames of TDC codes, or single photon events.

A recording is made block by block, each a short recording of its own whose photons are then
put into frames. Because photons fall on frames at random, the frames that a pixel's recorded
photons occupy are a random subset, and their codes come in random order.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lightflight.simulate.detector import Detector

Ints = NDArray[np.int64]

_FRAMES_PER_BLOCK = 16_384
_BLOCKS_WITHOUT_FRAMES = 16


@dataclass(frozen=True)
class Block:
    """One part of a recording.

    Attributes
    ----------
    number : int
        0, 1, 2 ...
    first_frame : int
        Its first frame.
    n_frames : int or None
        Its frames; None where there are none.
    start : float
        Where it starts, as a share of the recording.
    end : float
        Where it ends.
    """

    number: int
    first_frame: int
    n_frames: int | None
    start: float
    end: float

    @property
    def share(self) -> float:
        """Its length as a share of the recording."""
        return self.end - self.start


def blocks_from_frames(n_frames: int | None, *, drifts: bool) -> Iterator[Block]:
    """The parts a recording is made in: fixed sizes, so that a seed means one recording.

    Parameters
    ----------
    n_frames : int or None
        Frames of the recording; None: it has none.
    drifts : bool
        True where delays change with time: a recording without frames is then cut up as well.

    Yields
    ------
    Block
        In the order of time.
    """
    if n_frames is None:
        n_blocks = _BLOCKS_WITHOUT_FRAMES if drifts else 1
        for k in range(n_blocks):
            yield Block(k, 0, None, k / n_blocks, (k + 1) / n_blocks)
        return
    for k, first in enumerate(range(0, n_frames, _FRAMES_PER_BLOCK)):
        last = min(first + _FRAMES_PER_BLOCK, n_frames)
        yield Block(k, first, last - first, first / n_frames, last / n_frames)


def _photons_of_pixel(counts: Ints) -> Iterator[tuple[int, Ints]]:
    """(pixel, its codes, each as often as counted) for pixels with photons."""
    for pixel in np.flatnonzero(counts.any(axis=1)):
        codes = np.flatnonzero(counts[pixel])
        yield int(pixel), np.repeat(codes, counts[pixel, codes])


def fill_frames(
    frames: NDArray[np.uint16], counts: Ints, rng: np.random.Generator
) -> NDArray[np.uint16]:
    """Put counted photons into empty frames, one per pixel and frame, at random.

    Parameters
    ----------
    frames : array of uint16, shape (n, rows, cols)
        Frames that hold "no photon" everywhere; they are written to.
    counts : array of int, shape (pixels, codes)
        Photons of each pixel, n at most.
    rng : Generator
        Stream of the frames.

    Returns
    -------
    array of uint16, shape (n, rows, cols)
        `frames`.
    """
    for pixel, codes in _photons_of_pixel(counts):
        row, col = divmod(pixel, frames.shape[2])
        # Which frames is a matter of chance: within a block nothing changes with time.
        frames[rng.choice(len(frames), len(codes), replace=False), row, col] = codes
    return frames


def events_of_block(
    counts: Ints, block: Block, *, one_per_frame: bool, rng: np.random.Generator
) -> tuple[Ints, Ints, Ints | None]:
    """Pixel, code and frame of each counted photon, in the order of time.

    Parameters
    ----------
    counts : array of int, shape (pixels, codes)
        Photons of each pixel.
    block : Block
        The part of the recording that they are of.
    one_per_frame : bool
        True where a pixel records one photon per frame at most.
    rng : Generator
        Stream of the frames.

    Returns
    -------
    pixel, code : array of int, shape (n,)
        Pixels are numbered row by row.
    frame : array of int, shape (n,), or None
        Frame in the whole recording; None where it has no frames.
    """
    pixels, codes, frames = [], [], []
    for pixel, own in _photons_of_pixel(counts):
        pixels.append(np.full(len(own), pixel))
        codes.append(own)
        if block.n_frames is not None:
            choice = rng.choice(block.n_frames, len(own), replace=not one_per_frame)
            frames.append(block.first_frame + choice)
    nothing = [np.empty(0, dtype=np.int64)]
    pixel_of, code_of = np.concatenate(pixels or nothing), np.concatenate(codes or nothing)
    if block.n_frames is None:
        order = rng.permutation(len(pixel_of))
        return pixel_of[order], code_of[order], None
    frame_of = np.concatenate(frames or nothing)
    order = np.argsort(frame_of, kind="stable")
    return pixel_of[order], code_of[order], frame_of[order]


def check_can_write(detector: Detector, kind: str) -> None:
    """Check that a detector can write a kind of recording.

    Parameters
    ----------
    detector : Detector
        The detector.
    kind : str
        One of `recordings.RECORDING_KINDS`.

    Raises
    ------
    ValueError
        For frames of a detector that keeps several photons, or has no code for none.
    """
    if kind == "frames" and (detector.no_photon_code is None or not detector.first_photon_only):
        raise ValueError(
            "this detector cannot write frames: they need first_photon_only=True and a "
            'no_photon_code; take kind="events", or the pf32 preset'
        )
