"""Random laboratories in which one thing is wrong that nobody tells.

    python benchmarks/misfit_labs.py                        # all, three laboratories for each
    python benchmarks/misfit_labs.py --only haze walk --labs 20 --first 900

Laboratories are those of `random_labs.py` (2 to 60 mm a pixel, a forward model of its own). Wrong
are, one at a time and in two strengths: haze (a share of the light 300 ps late and 5 px wide), a
halo of 6 px (that of light outside of the picture does not reach it: a stop stands before the
sensor), a wall that mirrors the flight, a mirror silvered behind its glass, a second pulse, a
trigger that drifts, times that walk with brightness, a shadow of 4 px, hot pixels, pile-up of first
photons only. Light of forms that
no model here has: wings of a lens that fall as a power (of 3 px), light that wanders (the later
the wider), a screen that glows on for 1.5 ns, an image in a curved mirror, neighbours that count
along a code later, background that grows across the picture, a flash where the light ends that
lights the room, a spot with a comet's tail, a beam of two lobes, a last leg that fans out (behind
a mirror that shakes, about two axes or one) or leaves the focus, a flat beam, a laser whose pulses
are wider or narrower than those of the flat; a leak of the laser's light that reaches all pixels at
one moment, a signal at one code of all pixels, counts that stop at a share of the highest, columns
that lost theirs, a laser that sets out at either of two times. A clock that is another one since it
was calibrated: half of the array late, columns late by chance, rows late in turn, a bowl. And what
is told: the source's place (a share of its distance), its emission time, the clock's codes, focal
length, pose, a distortion that is not there (radial, or of a lens that stands askew), pixels that
are not square, a picture off its centre, the index, and a mirrored picture.

Printed: every laboratory with its verdict; at the end for each defect and strength how many were
trusted, checked, contradicted and refused, how many are wrong (number of legs, or a point within a
leg more than four stated errors off) and how many of these were trusted, with how many of them
count the defect among what they are blind to (`path.verdict.blind_to`); and the rms, in stated
errors, of the farthest of four to six points of a path with the right number of legs (where nothing
is wrong: 1.3).
"""

from __future__ import annotations

import argparse
import sys
import time
import warnings
from collections import Counter
from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from scipy.ndimage import gaussian_filter, shift
from scipy.signal import fftconvolve, lfilter
from scipy.spatial.transform import Rotation
from scipy.special import ndtri

import lightflight as lf
from lightflight.errors import CalibrationError, GeometryError, NothingFoundError

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
from benchmarks.random_labs import (
    INDEX,
    SPEED,
    Floats,
    Lab,
    calibration,
    camera_of,
    counts_of,
    drawn_lab,
    histograms,
    light_of,
    pulls_of,
    told_of,
)

FAR_STDS = 4.0
BLIND_TO = {
    "scale": "clock_scale", "focal": "focal_length", "emission": "clock_offset",
    "half": "calibration", "columns": "calibration", "rolling": "calibration",
    "bowl": "calibration", "askew": "distortion", "aspect": "focal_length", "off_centre": "pose",
}  # fmt: skip
"""What the verdict calls a defect, where the names differ."""
_N_SHAKEN = 8
"""Directions of a beam that shakes."""
_STEPS_ASIDE = ndtri((np.arange(_N_SHAKEN) + 0.5) / _N_SHAKEN)
_STEPS_ASIDE /= np.std(_STEPS_ASIDE)
"""A Gaussian in so many parts, in standard deviations."""

Told = dict[str, Any]
Defect = Callable[[Lab, float, np.random.Generator], tuple[Floats, Told]]
"""Expected counts of a laboratory, and what is told otherwise than it is."""


# ---- light -----------------------------------------------------------------------------------


def _even(lab: Lab) -> Floats:
    """The light before pixels and their delays take it."""
    return light_of(replace(lab, delays_ps=np.zeros(lab.optics.shape), unequal=0.0))


def _taken(lab: Lab, light: Floats) -> Floats:
    """As pixels take it, each with its delay."""
    come = np.concatenate((np.zeros((*lab.optics.shape, 1)), np.cumsum(light, axis=2)), axis=2)
    for pixel in np.ndindex(*lab.optics.shape):
        at = lab.edges_ps - lab.delays_ps[pixel]
        come[pixel] = np.interp(at, lab.edges_ps, come[pixel])
    return np.diff(come, axis=2)


def _spread(lab: Lab, reach_px: float, late_ps: float) -> Floats:
    """All light of the picture, as lens or room throw it about."""
    wide = gaussian_filter(_even(lab), (reach_px, reach_px, 0.0), mode="constant")
    return _taken(lab, _late(lab, wide, late_ps) if late_ps else wide)


def _late(lab: Lab, light: Floats, wait_ps: float) -> Floats:
    """Light after an exponential wait of this mean."""
    kept = np.exp(-lab.code_ps / wait_ps)
    late: Floats = lfilter([1.0 - kept], [1.0, -kept], light, axis=2)
    return late


def haze(lab: Lab, share: float, rng: np.random.Generator) -> tuple[Floats, Told]:
    late = _spread(lab, 5.0, 300.0)
    return counts_of(lab, (1.0 - share) * light_of(lab) + share * late), {}


def halo(lab: Lab, share: float, rng: np.random.Generator) -> tuple[Floats, Told]:
    wide = _spread(lab, 6.0, 0.0)
    return counts_of(lab, (1.0 - share) * light_of(lab) + share * wide), {}


def wall(lab: Lab, share: float, rng: np.random.Generator) -> tuple[Floats, Told]:
    optics = lab.optics
    normal = optics.axes @ np.append(0.15 * rng.normal(size=2), 1.0)
    normal /= np.linalg.norm(normal)
    depths = (lab.vertices - optics.eye) @ normal
    distance = np.linalg.norm(lab.vertices - optics.eye, axis=1).mean()
    behind = depths.max() + 0.06 * distance - depths
    image = replace(lab, vertices=lab.vertices + 2.0 * behind[:, np.newaxis] * normal)
    return counts_of(lab, light_of(lab) + share * light_of(image)), {}


def ghost(lab: Lab, share: float, rng: np.random.Generator) -> tuple[Floats, Told]:
    """The front of a mirror silvered behind 3 to 6 mm of glass: a leg beside that behind it.

    Where one leg is seen, a plate it came through before: the same leg, late and aside.
    """
    glass_mm = rng.uniform(3.0, 6.0) / 1.5
    flights = np.diff(lab.vertices, axis=0)
    out = flights / np.linalg.norm(flights, axis=1, keepdims=True)
    if len(out) == 1:
        aside = np.cross(out[0], rng.normal(size=3))
        aside *= glass_mm / np.linalg.norm(aside)
        late = 2.0 * glass_mm * 2.25 / SPEED
        beside = replace(lab, vertices=lab.vertices + aside, emission_ps=lab.emission_ps + late)
        return counts_of(lab, light_of(lab) + share * light_of(beside)), {}
    normal = out[0] - out[1]
    normal /= np.linalg.norm(normal)
    # The incoming leg meets a plane this much nearer, or farther, and all behind it is shifted.
    corner = lab.vertices[1] + out[0] * glass_mm / (out[0] @ normal)
    vertices = np.array([lab.vertices[0], corner, corner + flights[1]])

    def behind(leg: int, along_mm: Floats) -> Floats:
        return lab.brightness(leg, along_mm) * (leg > 0)

    beside = replace(lab, vertices=vertices, brightness=behind)
    return counts_of(lab, light_of(lab) + share * light_of(beside)), {}


def second(lab: Lab, share: float, rng: np.random.Generator) -> tuple[Floats, Told]:
    later = replace(lab, emission_ps=lab.emission_ps + rng.uniform(400.0, 1500.0))
    return counts_of(lab, light_of(lab) + share * light_of(later)), {}


def drift(lab: Lab, by_ps: float, rng: np.random.Generator) -> tuple[Floats, Told]:
    emissions = lab.emission_ps + np.linspace(-0.5, 0.5, 5) * by_ps
    parts = [light_of(replace(lab, emission_ps=one)) for one in emissions.tolist()]
    return counts_of(lab, np.mean(parts, axis=0)), {}


def walk(lab: Lab, ps_per_decade: float, rng: np.random.Generator) -> tuple[Floats, Told]:
    bright = light_of(lab).sum(axis=2)
    decades = np.log10(bright.max() / np.maximum(bright, 1e-3 * bright.max()))
    delays = lab.delays_ps + ps_per_decade * decades
    return counts_of(lab, light_of(replace(lab, delays_ps=delays))), {}


def shadow(lab: Lab, share: float, rng: np.random.Generator) -> tuple[Floats, Told]:
    rows, cols = np.indices(lab.optics.shape)
    angle = rng.uniform(0.0, 2.0 * np.pi)
    across = (rows - rows.mean()) * np.sin(angle) + (cols - cols.mean()) * np.cos(angle)
    dark = np.abs(across - rng.uniform(-5.0, 5.0)) < 2.0
    return counts_of(lab, light_of(lab) * (1.0 - share * dark)[..., np.newaxis]), {}


def hot(lab: Lab, number: float, rng: np.random.Generator) -> tuple[Floats, Told]:
    counts = counts_of(lab, light_of(lab))
    for row, col in rng.integers(lab.optics.shape, size=(int(number), 2)):
        counts[row, col] += rng.uniform(1.0, 30.0)
    return counts, {}


def pile_up(lab: Lab, most: float, rng: np.random.Generator) -> tuple[Floats, Told]:
    counts = counts_of(lab, light_of(lab))
    hits = most * counts / counts.sum(axis=2).max()
    return counts * np.exp(hits - np.cumsum(hits, axis=2)), {}


def wings(lab: Lab, share: float, rng: np.random.Generator) -> tuple[Floats, Told]:
    rows, cols = lab.optics.shape
    down, right = np.mgrid[1 - rows : rows, 1 - cols : cols]
    kernel = (1.0 + (down**2 + right**2) / 9.0) ** -1.5
    kernel /= kernel.sum()
    even = np.pad(_even(lab), ((rows // 2,) * 2, (cols // 2,) * 2, (0, 0)))
    wide = fftconvolve(even, kernel[..., np.newaxis], mode="same", axes=(0, 1))
    wide = wide[rows // 2 :, cols // 2 :][:rows, :cols]
    late = _taken(lab, np.maximum(wide, 0.0))
    return counts_of(lab, (1.0 - share) * light_of(lab) + share * late), {}


def wandering(lab: Lab, share: float, rng: np.random.Generator) -> tuple[Floats, Told]:
    light = _even(lab)
    late = np.zeros_like(light)
    delays = np.arange(1, 25) * 100.0
    weights = delays * np.exp(-delays / 250.0)
    for delay, weight in zip(delays, weights / weights.sum(), strict=True):
        reach = 6.0 * np.sqrt(delay / 500.0)
        moved = np.roll(light, round(delay / lab.code_ps), axis=2)
        late += weight * gaussian_filter(moved, (reach, reach, 0.0), mode="constant")
    return counts_of(lab, (1.0 - share) * light_of(lab) + share * _taken(lab, late)), {}


def glow(lab: Lab, share: float, rng: np.random.Generator) -> tuple[Floats, Told]:
    light = light_of(lab)
    return counts_of(lab, (1.0 - share) * light + share * _late(lab, light, 1500.0)), {}


def curved_mirror(lab: Lab, share: float, rng: np.random.Generator) -> tuple[Floats, Told]:
    """A sphere behind the flight: its image is a curve, nearer and smaller."""
    optics, pieces = lab.optics, 8
    away = np.linalg.norm(lab.vertices - optics.eye, axis=1).mean()
    centre = optics.eye + 1.9 * away * optics.axes[:, 2] + 0.1 * away * rng.normal(size=3)
    parts = np.concatenate(
        [a + (b - a) * np.arange(pieces)[:, np.newaxis] / pieces for a, b in pairwise(lab.vertices)]
        + [lab.vertices[-1:]]
    )
    out = parts - centre
    radius, far = 0.5 * away, np.linalg.norm(out, axis=1, keepdims=True)
    image = centre + out / far * (radius**2 / far)
    lengths = np.linalg.norm(np.diff(lab.vertices, axis=0), axis=1)
    starts = np.concatenate(([0.0], np.cumsum(np.repeat(lengths, pieces) / pieces)))
    emission = lab.emission_ps
    counts = np.zeros((*optics.shape, lab.n_codes))
    for k, ends in enumerate(pairwise(image)):
        # The way from flight to mirror and on to the camera, as long as that to the image of a
        # plane mirror at the sphere's surface.
        surface = centre + out[k] / far[k] * radius
        way = np.linalg.norm(parts[k] - surface) + np.linalg.norm(surface - optics.eye)
        late = (starts[k] + way - np.linalg.norm(image[k] - optics.eye)) * INDEX / SPEED
        counts += light_of(replace(lab, vertices=np.array(ends), emission_ps=emission + late))
    light = light_of(lab)
    return counts_of(lab, light + share * light.sum() / max(counts.sum(), 1e-30) * counts), {}


def crosstalk(lab: Lab, share: float, rng: np.random.Generator) -> tuple[Floats, Told]:
    light = light_of(lab)
    beside = np.zeros_like(light)
    for axis, by in ((0, 1), (0, -1), (1, 1), (1, -1)):
        beside += np.roll(light, (by, 1), axis=(axis, 2))
    return counts_of(lab, light + share / 4.0 * beside), {}


def lamp(lab: Lab, most: float, rng: np.random.Generator) -> tuple[Floats, Told]:
    """Background per code, in shares of the brightest pixel's light, from one side to the other."""
    across = np.linspace(0.0, most * lab.photons / lab.n_codes, lab.optics.shape[1])
    return counts_of(lab, light_of(lab)) + across[:, np.newaxis] * lab.widths, {}


def flash(lab: Lab, share: float, rng: np.random.Generator) -> tuple[Floats, Told]:
    """Where the light ends it lights all that lies around: the later, the farther."""
    optics, end = lab.optics, lab.vertices[-1]
    light = light_of(lab)
    flight = np.linalg.norm(np.diff(lab.vertices, axis=0), axis=1).sum()
    at = lab.emission_ps + INDEX * flight / SPEED
    depth = optics.image(end[np.newaxis])[1][0]
    extra = np.zeros_like(light)
    for pixel in np.ndindex(*optics.shape):
        point = optics.point(pixel[0], pixel[1], depth * 1.15)
        far = np.linalg.norm(point - end)
        when = at + INDEX * (far + np.linalg.norm(point - optics.eye)) / SPEED
        delay = lab.edges_ps - when - lab.delays_ps[pixel]
        extra[pixel] = np.diff(lab.come(delay)) / far**2
    return counts_of(lab, light + share * light.sum() / extra.sum() * extra), {}


def comet(lab: Lab, share: float, rng: np.random.Generator) -> tuple[Floats, Told]:
    light = _even(lab)
    tail = np.zeros_like(light)
    for by in (1, 2, 3):
        tail[by:, by:] += light[:-by, :-by] * 0.57 * 0.5 ** (by - 1)
    return counts_of(lab, _taken(lab, (1.0 - share) * light + share * tail)), {}


def two_lobes(lab: Lab, apart_px: float, rng: np.random.Generator) -> tuple[Floats, Told]:
    light = _even(lab)
    ends = lab.optics.image(lab.vertices[:2])[0]
    along = (ends[1] - ends[0]) / np.linalg.norm(ends[1] - ends[0])
    by = 0.5 * apart_px * np.array([-along[1], along[0], 0.0])
    both = shift(light, by, order=1) + shift(light, -by, order=1)
    return counts_of(lab, _taken(lab, both)), {}


def fan(lab: Lab, px: float, rng: np.random.Generator) -> tuple[Floats, Told]:
    """The last mirror, or the source, shakes: the last leg fans out to so many px rms."""
    way, end = lab.vertices[-1] - lab.vertices[-2], lab.vertices[-1]
    depth = float(((end - lab.optics.eye) @ lab.optics.axes)[2])
    # On a circle of sqrt(2) times the rms of each of the two directions across the flight.
    far = np.sqrt(2.0) * px * depth / lab.optics.focal_px
    across = far * np.linalg.svd(way[np.newaxis])[2][1:]
    light = np.zeros((*lab.optics.shape, lab.n_codes))
    for turn in (np.arange(_N_SHAKEN) + 0.5) * 2.0 * np.pi / _N_SHAKEN:
        vertices = lab.vertices.copy()
        vertices[-1] = end + np.cos(turn) * across[0] + np.sin(turn) * across[1]
        light += light_of(replace(lab, vertices=vertices)) / _N_SHAKEN
    return counts_of(lab, light), {}


def sheet(lab: Lab, px: float, rng: np.random.Generator) -> tuple[Floats, Told]:
    """The last mirror, or the source, shakes about one axis: the leg fans out across its image."""
    way, end = lab.vertices[-1] - lab.vertices[-2], lab.vertices[-1]
    sight = end - lab.optics.eye
    right = np.cross(way, sight)
    far = px * float((sight @ lab.optics.axes)[2]) / lab.optics.focal_px
    across = far * right / np.linalg.norm(right)
    light = np.zeros((*lab.optics.shape, lab.n_codes))
    for step in _STEPS_ASIDE:
        vertices = lab.vertices.copy()
        vertices[-1] = end + step * across
        light += light_of(replace(lab, vertices=vertices)) / _N_SHAKEN
    return counts_of(lab, light), {}


def ribbon(lab: Lab, px: float, rng: np.random.Generator) -> tuple[Floats, Told]:
    """A flat beam, on edge to the camera: each leg is wider across its image, and nowhere else."""
    each = [light_of(lab, aside_px=px * step) for step in _STEPS_ASIDE]
    return counts_of(lab, np.mean(each, axis=0)), {}


def soft(lab: Lab, by: float, rng: np.random.Generator) -> tuple[Floats, Told]:
    """The last leg leaves the depth that is in focus: its spot grows by a factor of exp(`by`)."""
    return counts_of(lab, light_of(lab, softer=by)), {}


def wider(lab: Lab, by: float, rng: np.random.Generator) -> tuple[Floats, Told]:
    return counts_of(lab, light_of(replace(lab, pulse_ps=lab.pulse_ps * (1.0 + by)))), {}


def narrower(lab: Lab, by: float, rng: np.random.Generator) -> tuple[Floats, Told]:
    return wider(lab, -by, rng)


def leak(lab: Lab, share: float, rng: np.random.Generator) -> tuple[Floats, Told]:
    """Light of the laser that comes to all pixels at once: a share of the brightest pixel's."""
    light, edges = light_of(lab), lab.edges_ps
    at = edges[0] + rng.uniform(0.2, 0.8) * (edges[-1] - edges[0])
    each = np.diff(lab.come(edges - at - lab.delays_ps[..., np.newaxis]), axis=2)
    return counts_of(lab, light + share * light.sum(axis=2).max() * each), {}


def signal(lab: Lab, share: float, rng: np.random.Generator) -> tuple[Floats, Told]:
    """Crosstalk of a trigger: as long as a pulse, at one code whatever a pixel's delay."""
    counts = counts_of(lab, light_of(lab))
    at = rng.uniform(lab.edges_ps[lab.n_codes // 5], lab.edges_ps[4 * lab.n_codes // 5])
    return counts + share * counts.sum(axis=2).max() * np.diff(lab.come(lab.edges_ps - at)), {}


def clipped(lab: Lab, share: float, rng: np.random.Generator) -> tuple[Floats, Told]:
    counts = counts_of(lab, light_of(lab))
    return np.minimum(counts, share * counts.max()), {}


def lost_columns(lab: Lab, number: float, rng: np.random.Generator) -> tuple[Floats, Told]:
    counts = counts_of(lab, light_of(lab))
    first = rng.integers(4, lab.optics.shape[1] - 4)
    counts[:, first : first + int(number)] = 0.0
    return counts, {}


def two_times(lab: Lab, apart_ps: float, rng: np.random.Generator) -> tuple[Floats, Told]:
    each = [
        light_of(replace(lab, emission_ps=lab.emission_ps + by))
        for by in (-0.5 * apart_ps, 0.5 * apart_ps)
    ]
    return counts_of(lab, np.mean(each, axis=0)), {}


# ---- a clock of another day ------------------------------------------------------------------


def _late_by(lab: Lab, more_ps: Floats) -> tuple[Floats, Told]:
    return counts_of(lab, light_of(replace(lab, delays_ps=lab.delays_ps + more_ps))), {}


def half(lab: Lab, by_ps: float, rng: np.random.Generator) -> tuple[Floats, Told]:
    right = np.arange(lab.optics.shape[1]) >= lab.optics.shape[1] // 2
    return _late_by(lab, by_ps * right.astype(np.float64))


def columns(lab: Lab, by_ps: float, rng: np.random.Generator) -> tuple[Floats, Told]:
    return _late_by(lab, by_ps * rng.normal(size=lab.optics.shape[1]))


def rolling(lab: Lab, by_ps: float, rng: np.random.Generator) -> tuple[Floats, Told]:
    return _late_by(lab, by_ps * np.linspace(-0.5, 0.5, lab.optics.shape[0])[:, np.newaxis])


def bowl(lab: Lab, by_ps: float, rng: np.random.Generator) -> tuple[Floats, Told]:
    down, right = (np.linspace(-1.0, 1.0, size) for size in lab.optics.shape)
    return _late_by(lab, by_ps * (down[:, np.newaxis] ** 2 + right**2))


# ---- what is told ----------------------------------------------------------------------------


def source(lab: Lab, share: float, rng: np.random.Generator) -> tuple[Floats, Told]:
    off = rng.normal(size=3)
    off *= share * np.linalg.norm(lab.vertices[0] - lab.optics.eye) / np.linalg.norm(off)
    told = told_of(lab)["source"]
    place = tuple(np.asarray(told.position_mm) + off)
    return counts_of(lab, light_of(lab)), {"source": replace(told, position_mm=place)}


def emission(lab: Lab, by_ps: float, rng: np.random.Generator) -> tuple[Floats, Told]:
    told = lf.Source(tuple(lab.vertices[0]), emission_time_ps=lab.emission_ps + by_ps)
    return counts_of(lab, light_of(lab)), {"source": told}


def scale(lab: Lab, longer: float, rng: np.random.Generator) -> tuple[Floats, Told]:
    counts = counts_of(lab, light_of(lab))
    told = replace(lab, code_ps=lab.code_ps * (1.0 + longer))
    drawn = histograms(told, rng.poisson(counts))
    return counts, {"timing": calibration(told), "hist": drawn}


def focal(lab: Lab, longer: float, rng: np.random.Generator) -> tuple[Floats, Told]:
    told = replace(lab.optics, focal_px=lab.optics.focal_px * (1.0 + longer))
    return counts_of(lab, light_of(lab)), {"camera": camera_of(replace(lab, optics=told))}


def pose(lab: Lab, turn_deg: float, rng: np.random.Generator) -> tuple[Floats, Told]:
    turn = Rotation.from_rotvec(np.radians(turn_deg) * rng.normal(size=3)).as_matrix()
    told = replace(lab.optics, axes=turn @ lab.optics.axes)
    return counts_of(lab, light_of(lab)), {"camera": camera_of(replace(lab, optics=told))}


def distortion(lab: Lab, at_corner_px: float, rng: np.random.Generator) -> tuple[Floats, Told]:
    half = np.hypot(*lab.optics.shape) / 2.0
    radial = at_corner_px / half / (half / lab.optics.focal_px) ** 2
    told = replace(camera_of(lab), distortion=np.array([radial, 0.0, 0.0, 0.0]))
    return counts_of(lab, light_of(lab)), {"camera": told}


def askew(lab: Lab, at_corner_px: float, rng: np.random.Generator) -> tuple[Floats, Told]:
    half = np.hypot(*lab.optics.shape) / 2.0
    tangential = at_corner_px / half / (half / lab.optics.focal_px) / 3.0
    lens = np.array([0.0, 0.0, tangential, 0.0])
    return counts_of(lab, light_of(lab)), {"camera": replace(camera_of(lab), distortion=lens)}


def aspect(lab: Lab, wider: float, rng: np.random.Generator) -> tuple[Floats, Told]:
    return _with_matrix(lab, np.diag([1.0 + wider, 1.0, 1.0]))


def off_centre(lab: Lab, px: float, rng: np.random.Generator) -> tuple[Floats, Told]:
    return _with_matrix(lab, np.array([[1.0, 0.0, px], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]))


def _with_matrix(lab: Lab, change: Floats) -> tuple[Floats, Told]:
    camera = camera_of(lab)
    matrix = camera.matrix.copy()
    # The place of the centre stays where pixels are said to be wider.
    matrix[:2] = change[:2, :2] @ camera.matrix[:2]
    matrix[:2, 2] = camera.matrix[:2, 2] + change[:2, 2]
    return counts_of(lab, light_of(lab)), {"camera": replace(camera, matrix=matrix)}


def index(lab: Lab, less: float, rng: np.random.Generator) -> tuple[Floats, Told]:
    told = lf.Medium(1.00027 + less, 1.00027 + less)
    return counts_of(lab, light_of(lab)), {"medium": told}


def mirrored(lab: Lab, _: float, rng: np.random.Generator) -> tuple[Floats, Told]:
    return counts_of(lab, light_of(lab))[:, ::-1], {}


DEFECTS: dict[str, tuple[Defect, tuple[float, ...]]] = {
    "haze": (haze, (0.1, 0.3)),
    "halo": (halo, (0.05, 0.2)),
    "wall": (wall, (0.03, 0.1)),
    "ghost": (ghost, (0.04, 0.1)),
    "second": (second, (0.03, 0.1)),
    "drift": (drift, (20.0, 60.0)),
    "walk": (walk, (5.0, 20.0)),
    "shadow": (shadow, (0.5, 0.9)),
    "hot": (hot, (3.0, 10.0)),
    "pile_up": (pile_up, (0.05, 0.3)),
    "wings": (wings, (0.1, 0.3)),
    "wandering": (wandering, (0.1, 0.3)),
    "glow": (glow, (0.1, 0.3)),
    "curved_mirror": (curved_mirror, (0.03, 0.1)),
    "crosstalk": (crosstalk, (0.02, 0.08)),
    "lamp": (lamp, (0.1, 1.0)),
    "flash": (flash, (0.1, 1.0)),
    "comet": (comet, (0.1, 0.3)),
    "two_lobes": (two_lobes, (0.7, 1.5)),
    "fan": (fan, (0.5, 1.0)),
    "sheet": (sheet, (0.7,)),
    "ribbon": (ribbon, (0.6,)),
    "soft": (soft, (0.7,)),
    "wider": (wider, (0.1, 0.3)),
    "narrower": (narrower, (0.15,)),
    "leak": (leak, (0.03, 0.3)),
    "signal": (signal, (0.03, 0.3)),
    "clipped": (clipped, (0.7, 0.3)),
    "lost_columns": (lost_columns, (2.0, 6.0)),
    "two_times": (two_times, (60.0, 150.0)),
    "half": (half, (15.0, 60.0)),
    "columns": (columns, (8.0, 30.0)),
    "rolling": (rolling, (30.0, 100.0)),
    "bowl": (bowl, (10.0, 40.0)),
    "source": (source, (0.002, 0.01)),
    "emission": (emission, (10.0, 50.0)),
    "scale": (scale, (5e-4, 3e-3)),
    "focal": (focal, (0.005, 0.02)),
    "pose": (pose, (0.1, 0.5)),
    "distortion": (distortion, (0.3, 1.0)),
    "askew": (askew, (0.3, 1.0)),
    "aspect": (aspect, (0.003, 0.02)),
    "off_centre": (off_centre, (0.3, 2.0)),
    "index": (index, (0.002, 0.01)),
    "mirrored": (mirrored, (1.0,)),
}


def recording_of(name: str, strength: float, seed: int) -> tuple[Lab, lf.Histograms, Told]:
    """A laboratory, its recording with the defect, and all that is told."""
    lab = drawn_lab(seed)
    counts, told = DEFECTS[name][0](lab, strength, np.random.default_rng([14, seed]))
    hist = told.pop("hist", None)
    if hist is None:
        hist = histograms(lab, np.random.default_rng([15, seed]).poisson(counts))
    return lab, hist, told_of(lab) | told


def outcome(name: str, strength: float, seed: int, method: str) -> tuple[str, Counter[str], float]:
    """A line, what it counts as, and how far the farthest point is off."""
    began = time.process_time()
    lab, hist, told = recording_of(name, strength, seed)
    words = f"{name} {strength:g}: {lab.words()}"
    try:
        path = lf.reconstruct(hist, method=method, **told)
    except (CalibrationError, GeometryError, NothingFoundError) as problem:
        return f"{words}: {problem}", Counter(["refused"]), np.nan
    right, level = path.n_legs == len(lab.vertices) - 1, str(path.verdict.level)
    pulls = pulls_of(lab, path)[:, 1] if right else np.zeros(0)
    wrong = not right or bool((pulls > FAR_STDS).any())
    blind = BLIND_TO.get(name, name) in {str(one.name) for one in path.verdict.blind_to}
    counted = Counter([level, *(["wrong"] if wrong else [])])
    if wrong and level == "trust":
        counted += Counter(["wrong and trusted", *(["blind to it"] if blind else [])])
    named = " ".join(f"{one.name}:{one.sigma:.1f}" for one in path.verdict.findings[:3])
    farthest = float(pulls.max()) if len(pulls) else np.nan
    most = f"{farthest:.1f}" if len(pulls) else "-"
    line = (
        f"{words}: {path.n_legs} legs, {level} {named}; farthest {most} stated errors; "
        f"{time.process_time() - began:.0f} s"
    )
    return line, counted, farthest


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--only", nargs="+", default=list(DEFECTS), choices=list(DEFECTS))
    parser.add_argument("--labs", type=int, default=3, help="for each defect and strength")
    parser.add_argument("--first", type=int, default=900, help="first seed")
    parser.add_argument("--method", default="joint")
    args = parser.parse_args()
    warnings.simplefilter("ignore")
    table: dict[tuple[str, float], tuple[Counter[str], list[float]]] = {}
    for name in args.only:
        for number, strength in enumerate(DEFECTS[name][1]):
            counted, off = table.setdefault((name, strength), (Counter(), []))
            for seed in range(args.first, args.first + args.labs):
                line, more, farthest = outcome(name, strength, seed + 100 * number, args.method)
                print(line, flush=True)
                counted.update(more)
                off.append(farthest)
    columns = (
        "trust",
        "check",
        "contradicted",
        "refused",
        "wrong",
        "wrong and trusted",
        "blind to it",
    )
    print(f"\n| defect | strength | {' | '.join(columns)} | rms |")
    print(f"|---|---:|{'---:|' * len(columns)}---:|")
    for (name, strength), (counted, off) in table.items():
        told, known = " | ".join(str(counted[one]) for one in columns), np.array(off)
        rms = np.sqrt(np.mean(known[np.isfinite(known)] ** 2)) if np.isfinite(known).any() else 0.0
        print(f"| {name} | {strength:g} | {told} | {rms:.2f} |")


if __name__ == "__main__":
    main()
