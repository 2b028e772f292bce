"""Crosstalk: a pixel that fires makes one of its four neighbours fire at the same moment.

Histograms need its mean and its times alone: `with_crosstalk` adds it to rates, `photons.py` to
drawn photons. In raw recordings cause and echo stand in one frame: `with_echoes`.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lightflight.simulate.clock import LOST, TrueClock

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Photons = tuple[Ints, Ints, Ints]
"""Pixel, code and frame of each photon, (n,)."""


def neighbours_of(
    pixel: Ints, side: Ints, shape: tuple[int, int]
) -> tuple[Ints, NDArray[np.bool_]]:
    """The neighbour of each pixel on one side.

    Parameters
    ----------
    pixel : array of int, shape (n,)
        Pixels, numbered row by row.
    side : array of int, shape (n,)
        0 up, 1 down, 2 left, 3 right.
    shape : (int, int)
        (rows, cols) of the array.

    Returns
    -------
    neighbour : array of int, shape (n,)
        Numbered row by row; meaningless where it does not exist.
    inside : array of bool, shape (n,)
        True where it exists.
    """
    rows, cols = shape
    row = pixel // cols + np.array([-1, 1, 0, 0])[side]
    col = pixel % cols + np.array([0, 0, -1, 1])[side]
    inside = (row >= 0) & (row < rows) & (col >= 0) & (col < cols)
    return row * cols + col, inside


def with_crosstalk(rate: Floats, probability: float) -> Floats:
    """Mean counts per pixel, plus those its four neighbours cause in it.

    Parameters
    ----------
    rate : array of float, shape (rows, cols)
        Mean counts without crosstalk.
    probability : float
        Chance that a count fires one of the four neighbours.

    Returns
    -------
    array of float, shape (rows, cols)
        Mean counts; at the rim of the array, crosstalk to the outside is lost.
    """
    if probability == 0.0:
        return rate
    rows, cols = rate.shape
    total: Floats = rate.astype(float)
    pixel = np.arange(rows * cols)
    for side in range(4):
        neighbour, inside = neighbours_of(pixel, np.full(len(pixel), side), (rows, cols))
        np.add.at(total.ravel(), neighbour[inside], 0.25 * probability * rate.ravel()[inside])
    return total


def with_echoes(
    photons: Photons,
    *,
    probability: float,
    clock: TrueClock,
    skew_ps: Floats,
    shape: tuple[int, int],
    one_per_frame: bool,
    rng: np.random.Generator,
) -> Photons:
    """Recorded photons and those they cause in their neighbours, in the order of frames.

    An echo comes at the moment of its cause, which is somewhere within the cause's code, and is
    read by the neighbour's own clock. Echoes cause none themselves.

    Parameters
    ----------
    photons : tuple of array of int
        Pixel, code and frame of each recorded photon.
    probability : float
        Chance that a photon fires one of the four neighbours.
    clock : TrueClock
        Reads causes and echoes.
    skew_ps : array of float, shape (pixels,)
        The pixels' own delays, ps.
    shape : (int, int)
        (rows, cols) of the array.
    one_per_frame : bool
        Of photons that meet in one pixel and frame the first is kept; which of them that is was
        decided among the many laser periods of a frame, by chance.
    rng : Generator
        Stream of the crosstalk.

    Returns
    -------
    tuple of array of int
        Pixel, code and frame of each photon.
    """
    pixel, code, frame = photons
    causes = np.flatnonzero(rng.random(len(pixel)) < probability)
    beside, inside = neighbours_of(pixel[causes], rng.integers(0, 4, len(causes)), shape)
    causes, beside = causes[inside], beside[inside]
    lower, upper = clock.intervals_of_codes(pixel[causes], code[causes])
    moment = lower + (upper - lower) * rng.random(len(causes)) - skew_ps[pixel[causes]]
    read = clock.codes_from_delays(beside, moment + skew_ps[beside])
    seen = read != LOST
    pixel = np.concatenate((pixel, beside[seen]))
    code = np.concatenate((code, read[seen]))
    frame = np.concatenate((frame, frame[causes][seen]))
    if one_per_frame:
        # `np.unique` keeps the first of equals: in a random order, a random one.
        by_chance = rng.permutation(len(pixel))
        place = (frame * (shape[0] * shape[1]) + pixel)[by_chance]
        first = by_chance[np.unique(place, return_index=True)[1]]
        pixel, code, frame = pixel[first], code[first], frame[first]
    order = np.argsort(frame, kind="stable")
    return pixel[order], code[order], frame[order]
