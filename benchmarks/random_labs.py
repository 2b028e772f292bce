"""Clean recordings of laboratories drawn at random, from a table top to a room.

    python benchmarks/random_labs.py                       # 60 laboratories
    python benchmarks/random_labs.py --first 500 --methods joint photon --all
    python benchmarks/random_labs.py --spot-ratio 0.8      # spots narrower along the columns
    python benchmarks/random_labs.py --pixel-ratio 1.35    # pixels that are not square
    python benchmarks/random_labs.py --calibration none    # or flat; no period of the laser told
    python benchmarks/random_labs.py --crossing            # the last code falls amid the light
    python benchmarks/random_labs.py --dim                 # hardly any light

Nothing is wrong with these recordings, but for what an option says. Camera (32 x 32 to 64 x 64
pixels, 16 to 50 degrees, 0.3 to 2 m away, turned and rolled at will), spot, active area, pulse
(half of them with a tail), clock and its calibration, brightness (even, or uneven by up to a factor
of three within a few pixels), photons (200 to 100,000 in the brightest pixel), background, and one
to three legs that begin, turn and end in the picture or outside. The forward model is one of its
own: light in steps of an eighth of a pixel, each spread over pixels by its spot and over codes by
its pulse. Source and emission time are told exactly, or the source alone, or the source to 1 mm;
the number of legs is not told.

Printed: laboratories that did not come out right and trusted (`--all`: every one); at the end how
many have the right number of legs, how many are trusted, trusted and wrong (in number, or a point
within a leg more than five stated errors off), and the rms pull of points within legs with its 95 %
interval (bootstrap). Along a leg points err by nothing but the clock: no part of the pull. Where
spots are no circles, the same of how far times lean to the sides of legs.
"""

from __future__ import annotations

import argparse
import re
import sys
import time
import warnings
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr

import lightflight as lf
from lightflight.errors import (
    CalibrationError,
    GeometryError,
    NothingFoundError,
    UncalibratedWarning,
)

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
from benchmarks.refraction import interval
from tests.oracles.brute_force import gaussian_share, tailed_share

Floats = NDArray[np.float64]

SPEED, INDEX = 0.299792458, 1.00027
SHAPES = [(32, 32), (32, 32), (32, 32), (64, 64), (24, 48), (48, 32)]
PRIORS = ("exact", "emission", "ruler")
STEPS_PER_PX, MOST_CODES = 8, 2000
FAR_STDS = 5.0
LEAST_SHARE = 1e-4
"""Of the largest variance of a place: less is that along a leg, which the clock alone makes."""


@dataclass(frozen=True)
class Optics:
    """Where the camera stands (columns: right, down, forward), and what a pixel sees."""

    shape: tuple[int, int]
    focal_px: float
    axes: Floats
    eye: Floats
    half_active_px: float
    spot_px: float
    spot_ratio: float = 1.0
    """Of the spot across the columns to that across the rows."""
    pixel_ratio: float = 1.0
    """Of the focal length in columns to that in rows."""

    @property
    def focals_px(self) -> Floats:
        """Of rows and columns."""
        return self.focal_px * np.array([1.0, self.pixel_ratio])

    @property
    def spots_px(self) -> Floats:
        """Across rows and columns."""
        return self.spot_px * np.array([1.0, self.spot_ratio])

    def image(self, points: Floats) -> tuple[Floats, Floats]:
        """(n, 2), (row, col) of points in mm, and their depth."""
        seen = (points - self.eye) @ self.axes
        middle = (np.array(self.shape) - 1) / 2
        pixels: Floats = middle + self.focals_px * seen[:, 1::-1] / seen[:, 2:]
        return pixels, seen[:, 2]

    def point(self, row: float, col: float, depth: float) -> Floats:
        """Mm, what a pixel sees at a depth."""
        middle = (np.array(self.shape) - 1) / 2
        down, right = (np.array([row, col]) - middle) / self.focals_px
        point: Floats = self.eye + depth * (self.axes @ np.array([right, down, 1.0]))
        return point

    def shows(self, pixels: Floats, margin_px: float = 0.0) -> NDArray[np.bool_]:
        """(n,), whether places lie in the picture, so far from its edge."""
        low, high = margin_px - 0.5, np.array(self.shape) - 0.5 - margin_px
        inside: NDArray[np.bool_] = np.all((pixels > low) & (pixels < high), axis=1)
        return inside


@dataclass(frozen=True)
class Lab:
    """All that was drawn for one seed."""

    seed: int
    optics: Optics
    code_ps: float
    n_codes: int
    pulse_ps: float
    tail_ps: float
    late_share: float
    photons: float
    background: float
    unequal: float
    vertices: Floats
    emission_ps: float
    brightness: Callable[[int, Floats], Floats]
    uneven: float
    prior: str
    delays_ps: Floats
    widths: Floats
    """Of codes, of their mean."""
    calibrated: str = "all"
    """Or flat, without even light, or none."""
    n_rolled: int = 0
    """Codes that the recording begins later than the laser."""

    @property
    def edges_ps(self) -> Floats:
        """Of the codes."""
        return np.append(0.0, np.cumsum(self.widths * self.code_ps))

    def come(self, delay_ps: Floats) -> Floats:
        """Share of a pulse that has come."""
        prompt = gaussian_share(delay_ps, self.pulse_ps)
        if not self.tail_ps:
            return prompt
        late = tailed_share(delay_ps, self.pulse_ps, self.tail_ps)
        share: Floats = (1.0 - self.late_share) * prompt + self.late_share * late
        return share

    def words(self) -> str:
        """What kind of laboratory this is."""
        optics, n = self.optics, len(self.vertices) - 1
        seen = optics.shows(optics.image(self.vertices)[0])
        rows, cols = optics.shape
        return (
            f"{self.seed:5d} {rows} x {cols}, spot {optics.spot_px:.2f}, active "
            f"{2 * optics.half_active_px:.2f} px, pulse {self.pulse_ps:.0f} + {self.tail_ps:.0f} "
            f"ps, {self.photons:.0f} photons, uneven {self.uneven}, {self.prior}, {n} legs, "
            f"{'source, ' if seen[0] else ''}{seen[1:-1].sum()} corners"
            f"{', end' if seen[-1] else ''} in view"
        )


# ---- the generator ---------------------------------------------------------------------------


def drawn_lab(seed: int, *, spot_ratio: float = 1.0, pixel_ratio: float = 1.0) -> Lab:
    """The laboratory of a seed."""
    rng = np.random.default_rng([77, seed])
    shape = SHAPES[rng.integers(6)]
    field = np.deg2rad(rng.uniform(16, 50))
    away = float(10 ** rng.uniform(np.log10(300), np.log10(2000)))
    forward = rng.normal(size=3)
    forward /= np.linalg.norm(forward)
    right = np.cross(forward, rng.normal(size=3))
    right /= np.linalg.norm(right)
    axes = np.column_stack((right, np.cross(forward, right), forward))
    eye = rng.normal(size=3) * 100 - away * forward
    focal = max(shape) / 2 / np.tan(field / 2)
    half, spot = float(rng.choice([0.06, 0.25, 0.5])), float(rng.uniform(0.3, 0.75))
    optics = Optics(shape, focal, axes, eye, half, spot, spot_ratio, pixel_ratio)
    code, pulse = float(rng.uniform(35, 80)), float(rng.uniform(40, 110))
    tail = share = 0.0
    if rng.random() < 0.5:
        tail, share = float(rng.uniform(60, 220)), float(rng.uniform(0.2, 0.6))
    photons = float(10 ** rng.uniform(2.3, 5))
    background = float(10 ** rng.uniform(-2, 0.3)) * min(1, photons / 2000)
    unequal = float(rng.choice([0, 0.02, 0.05]))
    wide = 2 * np.tan(field / 2) * away
    vertices = _drawn_vertices(rng, optics, int(rng.integers(1, 4)), away, wide)
    emission = float(rng.uniform(500, 3000))
    flight = np.linalg.norm(np.diff(vertices, axis=0), axis=1).sum() + 2 * away
    last = emission + flight * INDEX / SPEED + wide / SPEED + 6 * pulse + 12 * tail + 2000
    n_codes = min(int(last / code) + 40, MOST_CODES)
    brightness, uneven = _drawn_brightness(rng, len(vertices) - 1, away)
    prior, delays = PRIORS[rng.integers(3)], rng.normal(0, 60, size=shape)
    widths = 1 + 0.04 * rng.normal(size=n_codes)
    # The laser's period, which is told, is that of all codes: the clock has no other scale.
    widths /= widths.mean()
    return Lab(
        seed, optics, code, n_codes, pulse, tail, share, photons, background, unequal, vertices,
        emission, brightness, uneven, prior, delays, widths,
    )  # fmt: skip


def _drawn_vertices(
    rng: np.random.Generator, optics: Optics, n_legs: int, away: float, wide: float
) -> Floats:
    rows, cols = optics.shape
    for _ in range(20_000):
        begins, ends = rng.random() < 0.4, rng.random() < 0.2
        places = []
        for k in range(n_legs + 1):
            inside = begins if k == 0 else ends if k == n_legs else rng.random() < 0.5
            if inside:
                row, col = rng.uniform(2, rows - 3), rng.uniform(2, cols - 3)
            else:
                around, ring = rng.uniform(0, 2 * np.pi), rng.uniform(0.75, 1.3)
                row = (rows - 1) / 2 + ring * rows * np.sin(around) * 0.8
                col = (cols - 1) / 2 + ring * cols * np.cos(around) * 0.8
            places.append(optics.point(row, col, away + wide * rng.uniform(-0.4, 0.4)))
        vertices = np.array(places)
        if _can_be_seen(optics, vertices):
            return vertices
    raise RuntimeError("no scene found: the generator's wishes exclude each other")


def _can_be_seen(optics: Optics, vertices: Floats) -> bool:
    """Legs of 6 px or more, 25 degrees off the line of sight, that turn by 15 to 160 degrees."""
    flights = np.diff(vertices, axis=0)
    units = flights / np.linalg.norm(flights, axis=1, keepdims=True)
    turns = np.degrees(np.arccos(np.clip((units[1:] * units[:-1]).sum(axis=1), -1, 1)))
    corners = optics.image(vertices)[0][1:-1]
    by_the_edge = optics.shows(corners, -2.0) & ~optics.shows(corners, 1.5)
    if ((turns < 15) | (turns > 160)).any() or by_the_edge.any():
        return False
    return all(_is_clear(optics, *ends) for ends in pairwise(vertices))


def _is_clear(optics: Optics, start: Floats, end: Floats) -> bool:
    points = start + np.linspace(0, 1, 400)[:, np.newaxis] * (end - start)
    pixels, depth = optics.image(points)
    shown = optics.shows(pixels)
    if (depth < 50).any() or shown.sum() < 5:
        return False
    seen, sight = pixels[shown], points[shown].mean(axis=0) - optics.eye
    long = np.hypot(*(seen[-1] - seen[0])) >= max(6, 0.2 * min(optics.shape))
    flight = end - start
    cos = abs(sight @ flight) / np.linalg.norm(sight) / np.linalg.norm(flight)
    return bool(long and np.degrees(np.arccos(cos)) >= 25)


def _drawn_brightness(
    rng: np.random.Generator, n_legs: int, away: float
) -> tuple[Callable[[int, Floats], Floats], float]:
    """Light per mm of a leg at lengths in mm, and how uneven it is."""
    of_legs = np.exp(rng.normal(0, 0.35, size=n_legs))
    uneven = float(rng.choice([0, 0.1, 0.3]))
    half_wave = rng.uniform(10, 50) * away / 535
    phases = rng.uniform(0, 6.28, size=6)
    waves = np.pi / (half_wave * np.exp(rng.normal(0, 0.3, size=6)))

    def brightness(leg: int, length: Floats) -> Floats:
        ripples = np.sin(waves[:, np.newaxis] * length + phases[:, np.newaxis]).sum(axis=0)
        lit: Floats = of_legs[leg] * np.exp(uneven * ripples / np.sqrt(3))
        return lit

    return brightness, uneven


# ---- recordings ------------------------------------------------------------------------------


def expected_counts(lab: Lab) -> Floats:
    """(rows, cols, codes)."""
    return counts_of(lab, light_of(lab))


def counts_of(lab: Lab, light: Floats) -> Floats:
    """Light scaled to the photons of the laboratory, with its background."""
    brightest = float(light.sum(axis=2).max())
    counts: Floats = light * (lab.photons / brightest) + lab.background * lab.widths
    return counts


def light_of(lab: Lab, *, aside_px: float = 0.0, softer: float = 0.0) -> Floats:
    """(rows, cols, codes), in units of its own.

    Each leg lies so far to the right of its image; to the end of the last one the lens' spot grows
    by a factor of exp(`softer`).
    """
    optics = lab.optics
    counts = np.zeros((*optics.shape, lab.n_codes))
    start = lab.emission_ps
    for leg, (first, last) in enumerate(pairwise(lab.vertices)):
        length = float(np.linalg.norm(last - first))
        ends = optics.image(np.array([first, last]))[0]
        n = int(np.clip(np.abs(np.diff(ends, axis=0)).max() * STEPS_PER_PX, 40, 4000))
        share = (np.arange(n) + 0.5) / n
        points = first + share[:, np.newaxis] * (last - first)
        away = np.linalg.norm(optics.eye - points, axis=1)
        arrival = start + INDEX * (share * length + away) / SPEED
        start += INDEX * length / SPEED
        light = lab.brightness(leg, share * length) / away**2 * length / n
        places = optics.image(points)[0]
        if aside_px:
            down, right = (ends[1] - ends[0]) / np.linalg.norm(ends[1] - ends[0])
            places = places + aside_px * np.array([-right, down])
        if softer and leg == len(lab.vertices) - 2:
            for k in range(n):
                soft = replace(optics, spot_px=optics.spot_px * np.exp(softer * share[k]))
                one = slice(k, k + 1)
                shed(replace(lab, optics=soft), counts, places[one], light[one], arrival[one])
        else:
            shed(lab, counts, places, light, arrival)
    return counts * efficiency_of(lab)


def efficiency_of(lab: Lab) -> Floats:
    """(rows, cols, 1), of each pixel."""
    spread = np.random.default_rng([5, lab.seed]).normal(size=(*lab.optics.shape, 1))
    efficiency: Floats = np.exp(lab.unequal * spread)
    return efficiency


def shed(lab: Lab, counts: Floats, places: Floats, light: Floats, arrival_ps: Floats) -> None:
    """Add light that falls at places (row, col) at instants, as spot and pulse spread it."""
    optics, edges = lab.optics, lab.edges_ps
    reach = int(np.ceil(4.5 * optics.spots_px.max() + optics.half_active_px + 1))
    for place, bright, when in zip(places, light, arrival_ps, strict=True):
        near = [
            np.arange(max(0, round(at) - reach), min(most, round(at) + reach + 1))
            for at, most in zip(place, optics.shape, strict=True)
        ]
        if not all(map(len, near)):
            continue
        axes = zip(near, place, optics.spots_px, strict=True)
        seen = bright * np.outer(*(_caught(optics.half_active_px, *axis) for axis in axes))
        early = when - 400 - 5 * lab.pulse_ps
        late = when + 410 + 5 * lab.pulse_ps + 10 * lab.tail_ps
        low = max(int(np.searchsorted(edges, early)) - 1, 0)
        high = min(int(np.searchsorted(edges, late)) + 1, lab.n_codes)
        delay = edges[low : high + 1] - when - lab.delays_ps[np.ix_(*near)][..., np.newaxis]
        of_codes = np.diff(lab.come(delay), axis=2)
        counts[np.ix_(*near, np.arange(low, high))] += seen[..., np.newaxis] * of_codes


def _caught(half: float, pixels: NDArray[np.int64], place: float, spot_px: float) -> Floats:
    """Share of a spot along one axis that each active area sees, of its side."""
    up, low = (ndtr((pixels + side * half - place) / spot_px) for side in (1, -1))
    share: Floats = (up - low) / (2 * half)
    return share


def histograms(lab: Lab, counts: NDArray[np.integer]) -> lf.Histograms:
    """As the user describes them."""
    period = lab.code_ps * lab.n_codes if lab.calibrated != "none" else None
    rolled = np.roll(counts, -lab.n_rolled, axis=2).astype(np.uint32)
    return lf.Histograms(rolled, bin_width_ps=lab.code_ps, laser_period_ps=period)


def calibration(lab: Lab) -> lf.TimingCalibration | None:
    """Clock from even light (300,000 counts a pixel) and a flat of 200,000, as far as there are."""
    if lab.calibrated == "none":
        return None
    rng, edges = np.random.default_rng([6, lab.seed]), lab.edges_ps
    even = 3e5 * lab.widths / lab.widths.sum()
    density = rng.poisson(even, (*lab.optics.shape, lab.n_codes))
    at = 0.4 * edges[-1]
    low, high = (
        int(np.clip(np.searchsorted(edges, at + late), 0, lab.n_codes)) for late in (-1200, 4500)
    )
    flat = np.zeros(density.shape)
    delay = edges[low : high + 1] - at - lab.delays_ps[..., np.newaxis]
    flat[:, :, low:high] = np.diff(lab.come(delay), axis=2)
    in_flat = histograms(lab, rng.poisson(2e5 * flat + 0.01))
    with warnings.catch_warnings():
        # No code ends with the period: gains are nominal, as they are here.
        warnings.simplefilter("ignore", UncalibratedWarning)
        if lab.calibrated == "flat":
            return lf.calibrate_timing(flat=in_flat, flat_arrival_ps=at)
        return lf.calibrate_timing(
            histograms(lab, density), flat=in_flat, flat_arrival_ps=at, dead_codes="absorbed"
        )


def camera_of(lab: Lab) -> lf.Camera:
    optics = lab.optics
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = optics.axes, optics.eye
    matrix = np.diag([*optics.focals_px[::-1], 1.0])
    matrix[:2, 2] = (np.array(optics.shape)[::-1] - 1) / 2
    return lf.Camera(matrix, np.empty(0), pose, optics.shape)


def source_of(lab: Lab, noise: int) -> lf.Source:
    place = lab.vertices[0]
    if lab.prior == "ruler":
        off = np.random.default_rng([9, lab.seed, noise]).normal(size=3)
        return lf.Source(tuple(place + off), position_std_mm=1.0)
    exact = lab.prior == "exact"
    return lf.Source(tuple(place), emission_time_ps=lab.emission_ps if exact else None)


def path_of(lab: Lab, method: str = "joint", noise: int = 0) -> lf.LightPath:
    """The path of a recording of the laboratory."""
    drawn = np.random.default_rng([8, lab.seed, noise]).poisson(expected_counts(lab))
    return lf.reconstruct(histograms(lab, drawn), method=method, **told_of(lab, noise))


def told_of(lab: Lab, noise: int = 0) -> dict[str, Any]:
    """What the user tells."""
    return {
        "camera": camera_of(lab),
        "source": source_of(lab, noise),
        "medium": lf.Medium(),
        "timing": calibration(lab),
    }


# ---- outcome ---------------------------------------------------------------------------------


def pulls_of(lab: Lab, path: lf.LightPath) -> Floats:
    """(k, 2), mean square and largest of what a place errs by in its stated errors.

    Places a quarter and three quarters along each leg's stretch in the picture.
    """
    steps = np.linalg.norm(np.diff(lab.vertices, axis=0), axis=1)
    times = lab.emission_ps + INDEX * np.append(0, np.cumsum(steps)) / SPEED
    pulls = []
    for k, (first, last) in enumerate(pairwise(lab.vertices)):
        share = np.linspace(0, 1, 400)
        points = first + share[:, np.newaxis] * (last - first)
        shown = share[lab.optics.shows(lab.optics.image(points)[0])]
        for part in shown[[len(shown) // 4, 3 * len(shown) // 4]]:
            event = times[k] + part * (times[k + 1] - times[k])
            begins, ends = path.vertex_times_ps[k : k + 2]
            if not begins < event < ends:
                continue
            way = path.vertices_mm[k + 1] - path.vertices_mm[k]
            found = path.vertices_mm[k] + (event - begins) / (ends - begins) * way
            covariance = np.asarray(path.position_covariance_at(np.array([event])))[0]
            pulls.append(pull_of(found - first - part * (last - first), covariance))
    return np.array(pulls).reshape(-1, 2)


def slants_of(lab: Lab, path: lf.LightPath) -> Floats:
    """(k, 3), how far ahead of its foot a pixel to a leg's right sees: true, found, its std."""
    ends, found = lab.optics.image(lab.vertices)[0], []
    # What a square sees of a spot is wider by its own variance, the same in rows and columns.
    variance = lab.optics.spots_px**2 + lab.optics.half_active_px**2 / 3
    for sentence in path.statements:
        told = re.search(r"leg (\d+) pixels see light from (\S+) ± (\S+) px ahead", sentence)
        if told:
            leg, at, std = (float(word) for word in told.groups())
            down, right = np.diff(ends[int(leg) - 1 : int(leg) + 1], axis=0)[0]
            # - C_ac / C_cc: what falls to the right and ahead comes from behind.
            askew = down * right * (variance[1] - variance[0])
            true = askew / (variance[0] * right**2 + variance[1] * down**2)
            found.append((true, at, std))
    return np.array(found).reshape(-1, 3)


def pull_of(off_mm: Floats, covariance: Floats) -> tuple[float, float]:
    """Mean square and largest of what a place errs by in its stated errors, not along its leg."""
    values, vectors = np.linalg.eigh(covariance)
    told = values > LEAST_SHARE * values.max()
    z = (vectors.T @ off_mm)[told] / np.sqrt(values[told])
    return float(np.mean(z**2)), float(np.abs(z).max())


def _lab_of(seed: int, args: argparse.Namespace) -> Lab:
    lab = drawn_lab(seed, spot_ratio=args.spot_ratio, pixel_ratio=args.pixel_ratio)
    if args.calibration != "all":
        # What is not calibrated is as its maker says: no other clock could be told.
        own = np.zeros_like(lab.delays_ps) if args.calibration == "none" else lab.delays_ps
        lab = replace(
            lab, calibrated=args.calibration, widths=np.ones_like(lab.widths), delays_ps=own
        )
    lab = dimmed(lab) if args.dim else lab
    return replace(lab, n_rolled=2 * lab.n_codes // 5 if args.crossing else 0)


def dimmed(lab: Lab) -> Lab:
    """The same with 20 to 200 photons in the brightest pixel, and a tenth of the background."""
    photons = float(10 ** np.random.default_rng([31, lab.seed]).uniform(1.3, 2.3))
    return replace(lab, photons=photons, background=0.1 * lab.background)


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--scenes", type=int, default=60)
    parser.add_argument("--first", type=int, default=0, help="first seed")
    parser.add_argument("--methods", nargs="+", default=["joint"])
    parser.add_argument("--all", action="store_true", help="print every laboratory")
    parser.add_argument("--spot-ratio", type=float, default=1.0, help="columns' to rows'")
    parser.add_argument("--pixel-ratio", type=float, default=1.0, help="focal lengths, the same")
    parser.add_argument("--calibration", choices=("all", "flat", "none"), default="all")
    parser.add_argument("--crossing", action="store_true", help="the last code amid the light")
    parser.add_argument("--dim", action="store_true", help="20 to 200 photons at most in a pixel")
    args = parser.parse_args()
    warnings.simplefilter("ignore")
    for method in args.methods:
        levels, right, wrong, squares, slants = Counter[str](), 0, 0, [], []
        for seed in range(args.first, args.first + args.scenes):
            lab, began = _lab_of(seed, args), time.process_time()
            try:
                path = path_of(lab, method)
            except (CalibrationError, GeometryError, NothingFoundError) as problem:
                levels["none"] += 1
                print(f"{lab.words()}: {problem}", flush=True)
                continue
            level, as_many = str(path.verdict.level), path.n_legs == len(lab.vertices) - 1
            levels[level] += 1
            pulls = pulls_of(lab, path) if as_many else np.zeros((0, 2))
            far = bool((pulls[:, 1] > FAR_STDS).any())
            right += as_many
            wrong += level == "trust" and (far or not as_many)
            if as_many:
                slants.append(slants_of(lab, path))
            if len(pulls):
                squares.append(pulls[:, 0].mean())
            if args.all or far or not as_many or level != "trust":
                named = " ".join(f"{f.name}:{f.sigma:.1f}" for f in path.verdict.findings[:3])
                most = f"{pulls[:, 1].max():.1f}" if len(pulls) else "-"
                print(
                    f"{lab.words()}: {path.n_legs} legs, {level} {named}; farthest {most} stated "
                    f"errors; {time.process_time() - began:.0f} s",
                    flush=True,
                )
        found = "/".join(str(levels[one]) for one in ("trust", "check", "contradicted", "none"))
        print(
            f"{method}: {right} of {args.scenes} right, t/c/c/none {found}, trusted and wrong "
            f"{wrong}, pull {interval(np.array(squares), 1.0)}"
        )
        slant = np.vstack(slants or [np.zeros((0, 3))])
        if len(slant):
            pull = (slant[:, 1] - slant[:, 0]) / slant[:, 2]
            print(f"  slants of {len(slant)} legs: pull {interval(pull**2, 1.0)}")


if __name__ == "__main__":
    main()
