"""Beams that are thick, photon by photon: mirrors cut them along their own planes.

Shares no line with the package. Every photon starts at a place of the beam, flies with a flat
front, is turned by plane mirrors, and is seen by a pinhole camera whose lens is a little soft. What
the package takes for the spot of a lens is then the beam itself.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

SPEED, INDEX = 0.299792458, 1.00027
CODES, CODE_PS, PULSE_PS, EMISSION_PS = 909, 55.0, 64.0, 1000.0
EYE = np.array([187.5, 37.5, 535.0])
HALF_FIELD = 122.5 / 535.0
NEAREST_MM = 430.0

SHARP = np.array([[10, -180, -30], [190, 40, 30], [300, -120, 40]], dtype=float)
"""A mirror in the middle of the picture that turns light by 106 degrees."""
GRAZING = np.array([[10, -180, -30], [190, 40, 30], [390, 220, -60]], dtype=float)
"""One that turns it by 32 degrees, by 9 of these in the picture."""
ENDING = np.array([[100, -70, 0], [190, 40, 30], [290, 130, -20]], dtype=float)
"""One of 33 degrees; light begins and stops in the picture, cut square to its flight."""
PATHS = {"sharp": SHARP, "grazing": GRAZING, "ending": ENDING}


@dataclass(frozen=True)
class ThickBeam:
    """A beam and the camera that sees it.

    Attributes
    ----------
    beam_mm : float
        Standard deviation of the beam across its flight, on each axis, mm.
    pixels : int
        Rows and columns of the picture, 245 mm wide at 535 mm.
    photons : float
        In the brightest pixels.
    shape : str
        "gauss"; "disc", evenly bright; "ring", dark in its middle.
    lens_px : float
        Standard deviation of the lens' own spot, px.
    active : float
        Side of the pixels' active areas, pitches.
    glint : float
        Light that the mirrors scatter themselves where the beam meets them, over what a pixel's
        breadth of the beam scatters.
    hidden_mm : float
        Light this near to a corner is hidden, mm: by the mirror's mount.
    """

    beam_mm: float
    pixels: int = 32
    photons: float = 40_000.0
    shape: str = "gauss"
    lens_px: float = 0.3
    active: float = 0.5
    glint: float = 0.0
    hidden_mm: float = 0.0


_AT_ONCE = 1_000_000
_LOOKED_AT = 400_000


def counts_of(vertices: Floats, beam: ThickBeam, seed: int) -> NDArray[np.uint32]:
    """(rows, cols, codes), counts of one recording."""
    rng = np.random.default_rng([1888, seed])
    counts = np.zeros((beam.pixels, beam.pixels, CODES), dtype=np.int64)
    _add_photons(counts, vertices, beam, rng, _LOOKED_AT)
    bright = max(float(np.quantile(counts.sum(axis=2), 1.0 - 8.0 / beam.pixels**2)), 1.0)
    left = int(_LOOKED_AT * (beam.photons / bright - 1.0))
    while left > 0:
        _add_photons(counts, vertices, beam, rng, min(left, _AT_ONCE))
        left -= _AT_ONCE
    counts += rng.poisson(0.2, counts.shape)
    return counts.astype(np.uint32)


def _add_photons(
    counts: NDArray[np.int64], vertices: Floats, beam: ThickBeam, rng: np.random.Generator, n: int
) -> None:
    places, times = _scattered(vertices, beam, rng, n)
    depth = EYE[2] - places[:, 2]
    away = np.linalg.norm(EYE - places, axis=1)
    focal_px = beam.pixels / (2.0 * HALF_FIELD)
    middle = 0.5 * (beam.pixels - 1)
    col = middle + focal_px * (places[:, 0] - EYE[0]) / depth
    row = middle - focal_px * (places[:, 1] - EYE[1]) / depth
    col, row = (each + beam.lens_px * rng.normal(size=len(each)) for each in (col, row))
    at_row, at_col = np.rint(row).astype(int), np.rint(col).astype(int)
    # The lens takes in less of light that is far away; none is nearer than this.
    seen = rng.uniform(size=len(places)) < (NEAREST_MM / away) ** 2
    seen &= np.maximum(np.abs(row - at_row), np.abs(col - at_col)) < 0.5 * beam.active
    for each in (at_row, at_col):
        seen &= (each >= 0) & (each < beam.pixels)
    times = times + INDEX * away / SPEED + PULSE_PS * rng.normal(size=len(times))
    code = (times // CODE_PS).astype(int) % CODES
    np.add.at(counts, (at_row[seen], at_col[seen], code[seen]), 1)


def _scattered(
    vertices: Floats, beam: ThickBeam, rng: np.random.Generator, n: int
) -> tuple[Floats, Floats]:
    """Places (m, 3) where light is scattered, and when."""
    steps = np.diff(vertices, axis=0)
    lengths = np.linalg.norm(steps, axis=1)
    flights = steps / lengths[:, np.newaxis]
    begun = EMISSION_PS + INDEX * np.concatenate(([0.0], np.cumsum(lengths))) / SPEED
    # Enough before and behind each corner for what a mirror leaves of the thick beam there, and
    # no light where nobody looks.
    spare = 8.0 * beam.beam_mm * np.ones(len(flights) + 1)
    spare[[0, -1]] = 0.0
    first, last = _in_view(vertices, beam, spare)
    leg = rng.choice(len(flights), n, p=(last - first) / (last - first).sum())
    across = _across(beam, rng, n)
    parts = []
    for k, flight in enumerate(flights):
        own = leg == k
        along = rng.uniform(first[k], last[k], int(own.sum()))
        aside = np.cross(flight, [0.3, 0.2, 0.9])
        aside /= np.linalg.norm(aside)
        places = vertices[k] + along[:, np.newaxis] * flight
        places += across[own, :1] * aside + across[own, 1:] * np.cross(flight, aside)
        there = np.ones(len(places), dtype=bool)
        # Before and behind a mirror light is on the same side of it.
        if k > 0:
            there &= (places - vertices[k]) @ (flight - flights[k - 1]) > 0.0
        if k + 1 < len(flights):
            there &= (places - vertices[k + 1]) @ (flights[k + 1] - flight) > 0.0
        parts.append((places[there], begun[k] + INDEX * along[there] / SPEED))
    per_mm = n / float((last - first).sum())
    lit = int(beam.glint * per_mm * 2.0 * HALF_FIELD * EYE[2] / beam.pixels)
    for k in range(1, len(flights)):
        parts = [_not_hidden(vertices[k], beam, *part) for part in parts]
    for k in range(1, len(flights)):
        normal = flights[k] - flights[k - 1]
        beside = beam.beam_mm * rng.normal(size=(lit, 3))
        # On the mirror, where the flat front meets it.
        beside -= np.outer(beside @ normal / (normal @ normal), normal)
        parts.append((vertices[k] + beside, begun[k] + INDEX * (beside @ flights[k]) / SPEED))
    return np.concatenate([p for p, _ in parts]), np.concatenate([t for _, t in parts])


def _not_hidden(
    corner: Floats, beam: ThickBeam, places: Floats, times: Floats
) -> tuple[Floats, Floats]:
    """Of the light about a corner what its mount leaves."""
    seen = np.linalg.norm(places - corner, axis=1) >= beam.hidden_mm
    return places[seen], times[seen]


def _in_view(vertices: Floats, beam: ThickBeam, spare: Floats) -> tuple[Floats, Floats]:
    """Where along each leg light is scattered that the picture may show, mm from its start."""
    firsts, lasts = [], []
    for k, (start, end) in enumerate(pairwise(vertices)):
        length = float(np.linalg.norm(end - start))
        along = np.arange(-spare[k], length + spare[k + 1] + 1.0, 1.0)
        places = start + np.outer(along / length, end - start)
        aside = np.abs(places[:, :2] - EYE[:2]).max(axis=1) / (EYE[2] - places[:, 2])
        seen = along[aside < HALF_FIELD + (6.0 * beam.beam_mm + 10.0) / NEAREST_MM]
        firsts.append(max(seen[0], -spare[k]))
        lasts.append(min(seen[-1], length + spare[k + 1]))
    return np.array(firsts), np.array(lasts)


def _across(beam: ThickBeam, rng: np.random.Generator, n: int) -> Floats:
    """(n, 2), places across the beam, mm."""
    if beam.shape == "gauss":
        return beam.beam_mm * rng.normal(size=(n, 2))
    radius = {
        "disc": 2.0 * np.sqrt(rng.uniform(size=n)),
        "ring": np.sqrt(rng.gamma(2.0, 1.0, size=n)),
    }[beam.shape]
    turn = rng.uniform(0.0, 2.0 * np.pi, size=n)
    return beam.beam_mm * radius[:, np.newaxis] * np.column_stack((np.cos(turn), np.sin(turn)))
