"""Light that the counts would not show, though it moves the path.

A second pulse of size s adds s c to the counts of a pixel, c its column. Of c the pixel's own delay
takes up t (`Pixels.taken_of`), so its time moves by s t, and the path by the gain of the fit times
that. The counts show s at s sqrt(I) sigma, I what the score test knows of it (`Sums.information`),
or in a single cell where the path leaves none. What the fit has a place for itself (haze, halo,
glare where it measured their strengths) moves no path by more than is stated; of another pulse it
takes a part for late light, which is taken off. All of this is linear: light beyond the background
it stands on moves the path by half as much.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lightflight.path.verdict import BlindSpot, FindingName
from lightflight.reconstruct.fit.joint import JointFit
from lightflight.reconstruct.model import light
from lightflight.reconstruct.model.sizes import PLAUSIBLE
from lightflight.reconstruct.model.spread import HALO_LATE, HALO_PX, Beam, wide_light
from lightflight.reconstruct.other_light.around import Group
from lightflight.reconstruct.verdict.blind import Vertices
from lightflight.reconstruct.verdict.count_tests import (
    Cause,
    Columns,
    Sums,
    clear_of_pulses,
)
from lightflight.reconstruct.verdict.evidence import SEEN_AT

Floats = NDArray[np.float64]
Indices = NDArray[np.int64]

_GATE_STDS = 4.0
"""A pulse this near to the place of a pixel's light is the path's, in its standard deviations; of
3 or 6 the spots are the same."""
_CELL_STDS = 5.2
"""What one of some 50,000 cells must be off by to be seen once in a hundred recordings."""
_OF_FIT = (FindingName.HAZE, FindingName.HALO, FindingName.GLARE)


@dataclass(frozen=True, eq=False)
class Held:
    """One group of pixels as it was held against the path.

    Attributes
    ----------
    group : Group
    columns : Columns
        What causes add to it.
    numbers : tuple of int
        Of the recordings whose counts these are.
    beam : Beam
        The light that halo and glare spread.
    shape : (int, int)
        Of the picture.
    """

    group: Group
    columns: Columns
    numbers: tuple[int, ...]
    beam: Beam
    shape: tuple[int, int]


def blind_to_light(
    held: Sequence[Held], sums: Sums, causes: Sequence[Cause], fit: JointFit, *, least_size: float
) -> dict[FindingName, BlindSpot]:
    """Of each cause the unseen light that moves the path most, where by more than is stated.

    Parameters
    ----------
    held : sequence of Held
        All groups of pixels.
    sums : Sums
        What they say of the columns.
    causes : sequence of Cause
        What is asked for.
    fit : JointFit
        The path.
    least_size : float
        Of the clearest column of a cause; its test is silent below.

    Returns
    -------
    dict
        By the cause's name.
    """
    late_ps = shift_of_pulses(held, sums, causes, fit)
    vertices = Vertices.of(fit, fit.solution, fit.solution.medium)
    n_free = vertices.by_free.shape[1]
    moved_mm = vertices.moved_mm(fit.solution.photon_gain[:n_free] @ late_ps)
    asked = [one for one in causes if one.name in PLAUSIBLE and not one.symptom]
    if fit.strengths:
        asked = [one for one in asked if one.name not in _OF_FIT]
    found: dict[FindingName, BlindSpot] = {}
    by_cell = _seen_in_one_cell(sums)
    for cause in asked:
        for spot in _spots(cause, sums, by_cell, vertices, moved_mm, least_size):
            if cause.name not in found or spot.moves_mm > found[cause.name].moves_mm:
                found[cause.name] = spot
    return found


def _seen_in_one_cell(sums: Sums) -> Floats:
    """(K,), size of each column from which its light is seen in some single cell of lit pixels."""
    size = np.full(len(sums.score), np.inf)
    for left in sums.groups:
        pixels = left.pixels
        if not pixels.photons.shape[1]:
            continue
        told = pixels.weight > 0.0
        variance = np.divide(1.0, pixels.weight, where=told, out=np.zeros_like(pixels.mean))
        # Poisson's skewness takes the last term (Cornish and Fisher).
        needed = _CELL_STDS * np.sqrt(variance) + _CELL_STDS**2 / 6.0
        clear = clear_of_pulses(pixels)[:, :, np.newaxis]
        most = np.max(np.where(clear, left.added.values / needed[:, :, np.newaxis], 0.0), (0, 1))
        size[left.used] = np.minimum(size[left.used], 1.0 / np.maximum(most, 1e-12))
    return size


def _spots(
    cause: Cause,
    sums: Sums,
    by_cell: Floats,
    vertices: Vertices,
    moved_mm: Floats,
    least_size: float,
) -> Iterator[BlindSpot]:
    """Each column's largest unseen size, where it moves a vertex by more than is stated.

    `by_cell` (K,) is seen in single cells, `moved_mm` (m, K) what a size of one does to `vertices`.
    """
    known = np.diag(sums.information)
    seen_at = max(SEEN_AT, least_size * float(np.sqrt(known[list(cause.columns)].max())))
    for j, column in enumerate(cause.columns):
        size = min(cause.plausible, float(by_cell[column]))
        if known[column] > 0.0:
            size = min(size, seen_at / float(np.sqrt(known[column])))
        where = f" {cause.labels[j]}".rstrip() if cause.labels else ""
        unit = f"{PLAUSIBLE[cause.name].unit}{where}"
        spot = vertices.spot(cause.name, size, unit, size * moved_mm[:, column])
        if spot is not None:
            yield spot


def shift_of_pulses(
    held: Sequence[Held], sums: Sums, causes: Sequence[Cause], fit: JointFit
) -> Floats:
    """(n, K), ps: how much later each pulse of the fit comes per unit of each column."""
    spread = [
        # Of a halo nearer than that the fit knows nothing, nor do times.
        column
        for cause in causes
        if cause.name in (FindingName.HALO, FindingName.GLARE)
        for column in cause.columns[cause.name is FindingName.HALO :]
    ]
    late = np.zeros((len(fit.times.leg), len(sums.score)))
    for one, left in zip(held, sums.groups, strict=True):
        s = left.pixels.photons.shape[1]
        if not s:
            continue
        used, taken = left.used, left.taken
        if not fit.strengths:
            wide = wide_light(
                left.pixels.cells,
                one.group.points_px,
                one.group.reference_ps,
                one.beam,
                one.shape,
                HALO_PX[1:],
                HALO_LATE,
            )
            used = np.append(used, spread)
            taken = np.concatenate((taken, left.pixels.taken_of(wide)), axis=2)
        pulse, pixel, slot = _pulses_at(one, fit)
        late[pulse[:, np.newaxis], used] = taken[pixel, s + slot]
    if fit.strengths:
        waits = np.arange(light.N_LATE)
        known = sums.information[np.ix_(waits, waits)]
        known = known + np.eye(light.N_LATE) * PLAUSIBLE[FindingName.HAZE].size ** -2.0
        late = late - late[:, waits] @ np.linalg.solve(known, sums.information[waits])
    return late


def _pulses_at(one: Held, fit: JointFit) -> tuple[Indices, Indices, Indices]:
    """Pulses of the fit in the pixels of a group, those pixels, and which of their legs', (j,)."""
    group, pixels = one.group, one.group.pixels
    place = np.full(one.shape, -1)
    place[tuple(group.points_px.T)] = np.arange(len(group.points_px))
    own = np.flatnonzero(np.isin(fit.sighting_of, one.numbers))
    pixel = place[fit.times.row[own].astype(int), fit.times.col[own].astype(int)]
    own, pixel = own[pixel >= 0], pixel[pixel >= 0]
    expected = group.reference_ps[pixel, np.newaxis] + pixels.late_ps[pixel]
    gap = np.abs(fit.times.arrival_ps[own, np.newaxis] - expected)
    gap = np.where(pixels.photons[pixel] > 0.0, gap, np.inf)
    slot = np.argmin(gap, axis=1)
    near = gap.min(axis=1) < _GATE_STDS * pixels.drawn_out_ps[pixel, 0]
    return own[near], pixel[near], slot[near]
