"""Random laboratories whose light does more than turn at mirrors in view.

    python benchmarks/piece_labs.py                                 # 12 laboratories of each
    python benchmarks/piece_labs.py --only splitter --labs 40 --first 2000 --all

Laboratories are those of `random_labs.py` (any camera, pose, pulse, clock, brightness, 2 to 60 mm a
pixel), nothing is wrong with them, and their light or their camera has one thing more, drawn anew
by each seed and told only where a user must tell it:

splitter  a fifth to half of the light turns off by 30 to 150 degrees where a leg is in view
unseen    light leaves the picture and comes back by one or two mirrors that nobody sees
bent      a leg is an arc, whose sagitta is 2 to 8 % of its length, in any direction
pane      the camera looks through 4 to 20 mm of glass, tilted by up to 20 degrees (told)
tank      the same, and water behind it (told)
cameras   a second camera, from 20 to 120 degrees aside, on a clock that is told
block     5 to 30 mm of glass in the beam, turned by up to 30 degrees (told)
cavity    4 to 16 passes between two plane mirrors beside the picture that are a little tilted

The forward model is that of `random_labs.py`: light in steps of an eighth of a pixel; behind glass
its ray is found by the one invariant of plane faces, the sine of its angle times the index.

Printed: laboratories that did not come out right and trusted (`--all`: every one); at the end, for
each kind, how many have the right legs (number, forks, which are unseen, which are bent), verdicts,
trusted and wrong (legs, or a point within a leg more than five stated errors off), and the rms pull
of points within legs with its 95 % interval (bootstrap). A path with a leg unseen, and one with a
bent leg that nobody told of, is "check" where all is well.
"""

from __future__ import annotations

import argparse
import sys
import time
import warnings
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

import lightflight as lf
from lightflight.errors import CalibrationError, GeometryError, NothingFoundError

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
from benchmarks.random_labs import (
    INDEX,
    SPEED,
    STEPS_PER_PX,
    Floats,
    Lab,
    Optics,
    calibration,
    camera_of,
    counts_of,
    drawn_lab,
    efficiency_of,
    histograms,
    pull_of,
    shed,
    source_of,
)
from benchmarks.refraction import interval

FAR_STDS = 5.0
GLASS, WATER = (1.5195, 1.5396), (1.334, 1.3606)
"""Phase and group index near 532 nm."""
N_FINE = 4000


@dataclass(frozen=True)
class Way:
    """One leg as light flies it."""

    points: Floats
    """(n, 3), close together."""
    parent: int | None
    share: float = 1.0
    """Of the light of the flight."""
    bent: bool = False
    index: float | None = None
    """That times its light, where it is not the scene's."""

    @property
    def lengths(self) -> Floats:
        """(n,), mm from its start."""
        steps = np.linalg.norm(np.diff(self.points, axis=0), axis=1)
        return np.append(0.0, np.cumsum(steps))

    def at(self, lengths: Floats) -> Floats:
        """(k, 3)."""
        return np.column_stack([np.interp(lengths, self.lengths, axis) for axis in self.points.T])


@dataclass(frozen=True)
class Pane:
    """Plane glass before the camera; `normal` leads from the camera to the scene."""

    distance: float
    normal: Floats
    thickness: float
    beyond: tuple[float, float]

    def sight(self, optics: Optics, points: Floats) -> tuple[Floats, Floats]:
        """(n, 2) pixels of points behind it, and (n,) group index times way of their light."""
        first = self.distance * float(optics.axes[:, 2] @ self.normal)
        off = points - optics.eye
        deep = off @ self.normal
        aside = off - deep[:, np.newaxis] * self.normal
        radius = np.linalg.norm(aside, axis=1)
        thick = np.full(len(points), self.thickness)
        ways = np.stack((np.full(len(points), first), thick, deep - first - self.thickness))
        phase, group = np.array([(INDEX, INDEX), GLASS, self.beyond]).T[..., np.newaxis]

        low, high = np.zeros(len(points)), np.full(len(points), INDEX * (1 - 1e-12))
        for _ in range(60):
            sine = (low + high) / 2
            short = (ways * sine / np.sqrt(phase**2 - sine**2)).sum(axis=0) < radius
            low, high = np.where(short, sine, low), np.where(short, high, sine)
        sine = (low + high) / 2
        length: Floats = (ways * group * phase / np.sqrt(phase**2 - sine**2)).sum(axis=0)
        unit = aside / np.maximum(radius, 1e-12)[:, np.newaxis]
        cosine = np.sqrt(INDEX**2 - sine**2)
        rays = sine[:, np.newaxis] * unit + cosine[:, np.newaxis] * self.normal
        return optics.image(optics.eye + rays)[0], length

    def told(self, optics: Optics) -> tuple[lf.Interface, lf.Interface]:
        """As a user measures it."""
        return lf.window(
            optics.eye + self.distance * optics.axes[:, 2],
            -self.normal,
            thickness_mm=self.thickness,
            glass=lf.Material(*GLASS),
            beyond=lf.Material(*self.beyond),
        )


@dataclass(frozen=True)
class Scene:
    """A laboratory and what its light does."""

    kind: str
    lab: Lab
    ways: tuple[Way, ...]
    unseen: tuple[int, ...] = ()
    pane: Pane | None = None
    block: lf.Block | None = None
    beside: tuple[Lab, ...] = field(default=())
    """As further cameras film it: their optics, clock and photons."""

    @property
    def index(self) -> float:
        """That times light in the scene."""
        return self.pane.beyond[1] if self.pane else INDEX

    def flown_ps(self, k: int, length: float | Floats) -> Any:
        """How long light needs for the first stretch of a leg."""
        return (self.ways[k].index or self.index) * length / SPEED

    @property
    def starts_ps(self) -> tuple[float, ...]:
        """Of each leg."""
        starts: list[float] = []
        for way in self.ways:
            start = self.lab.emission_ps
            if way.parent is not None:
                start = starts[way.parent] + self.flown_ps(
                    way.parent, self.ways[way.parent].lengths[-1]
                )
            starts.append(start)
        return tuple(starts)

    def sight(self, optics: Optics, points: Floats) -> tuple[Floats, Floats]:
        """(n, 2) pixels, (n,) index times way to the camera."""
        if self.pane:
            return self.pane.sight(optics, points)
        return optics.image(points)[0], INDEX * np.linalg.norm(optics.eye - points, axis=1)

    def shown(self, k: int) -> Floats:
        """Lengths along a leg that the first camera sees."""
        way = self.ways[k]
        lengths = np.linspace(0, way.lengths[-1], 400)
        shows = self.lab.optics.shows(self.sight(self.lab.optics, way.at(lengths))[0])
        seen: Floats = lengths[shows]
        return seen

    @property
    def forks(self) -> tuple[tuple[int, int], ...]:
        """As `path.forks` tells them."""
        return tuple(
            (k, way.parent + 1)
            for k, way in enumerate(self.ways)
            if way.parent is not None and way.parent != k - 1
        )


# ---- what is drawn ---------------------------------------------------------------------------


def _straight(start: Floats, end: Floats) -> Floats:
    points: Floats = start + np.linspace(0, 1, N_FINE)[:, np.newaxis] * (end - start)
    return points


def _chain(vertices: Floats) -> tuple[Way, ...]:
    return tuple(
        Way(_straight(*ends), k - 1 if k else None) for k, ends in enumerate(pairwise(vertices))
    )


def _long_px(scene: Scene, points: Floats) -> float:
    """How far a line of points runs in the picture; 0 where it is too steep to be told."""
    optics = scene.lab.optics
    pixels, _ = scene.sight(optics, points)
    inside = optics.shows(pixels)
    if inside.sum() < 5 or ((points - optics.eye) @ optics.axes[:, 2] < 50).any():
        return 0.0
    seen, sight = pixels[inside], points[inside].mean(axis=0) - optics.eye
    flight = points[-1] - points[0]
    cos = abs(sight @ flight) / np.linalg.norm(sight) / np.linalg.norm(flight)
    return float(np.hypot(*(seen[-1] - seen[0]))) if np.degrees(np.arccos(cos)) > 25 else 0.0


def _least_px(lab: Lab) -> float:
    return max(6.0, 0.2 * min(lab.optics.shape))


def _turn_deg(one: Floats, other: Floats) -> float:
    cos = one @ other / np.linalg.norm(one) / np.linalg.norm(other)
    return float(np.degrees(np.arccos(np.clip(cos, -1, 1))))


def _as_it_is(kind: str, lab: Lab) -> Scene:
    return Scene(kind, lab, _chain(lab.vertices))


def splitter(lab: Lab, rng: np.random.Generator) -> Scene | None:
    optics = lab.optics
    vertices = lab.vertices
    leg, part = int(rng.integers(len(vertices) - 1)), rng.uniform(0.2, 0.8)
    at = vertices[leg] + part * (vertices[leg + 1] - vertices[leg])
    if not optics.shows(optics.image(at[np.newaxis])[0], 4.0)[0]:
        return None
    depth = (at - optics.eye) @ optics.axes[:, 2]
    around, ring = rng.uniform(0, 2 * np.pi), rng.uniform(0.75, 1.3)
    rows, cols = optics.shape
    end = optics.point(
        (rows - 1) / 2 + ring * rows * np.sin(around) * 0.8,
        (cols - 1) / 2 + ring * cols * np.cos(around) * 0.8,
        depth * rng.uniform(0.7, 1.3),
    )
    share = float(rng.uniform(0.2, 0.5))
    chain = list(_chain(np.insert(vertices, leg + 1, at, axis=0)))
    for k in range(leg + 1, len(chain)):
        chain[k] = replace(chain[k], share=1 - share)
    arm = Way(_straight(at, end), leg, share)
    scene = Scene("splitter", lab, (*chain, arm))
    pixels = optics.image(np.array([at, chain[leg + 1].points[-1], end, chain[leg].points[0]]))[0]
    in_view = [_turn_deg(pixels[2] - pixels[0], pixels[k] - pixels[0]) for k in (1, 3)]
    apart = _turn_deg(end - at, chain[leg + 1].points[-1] - at)
    clear = all(_long_px(scene, way.points) >= _least_px(lab) for way in scene.ways)
    return scene if clear and min(in_view) > 25 and 30 < apart < 150 else None


def unseen(lab: Lab, rng: np.random.Generator) -> Scene | None:
    other = drawn_lab(int(rng.integers(1 << 30)))
    optics, n = lab.optics, len(lab.vertices) - 1
    # The flight of another laboratory, as if before this camera, is what comes after.
    local = (other.vertices - other.optics.eye) @ other.optics.axes
    far = np.linalg.norm(lab.vertices - optics.eye, axis=1).mean()
    local *= far / np.linalg.norm(local, axis=1).mean()
    after = optics.eye + local @ optics.axes.T
    more = [after[0]]
    if rng.random() < 0.5:
        aside = rng.normal(size=3)
        more.insert(0, (lab.vertices[-1] + after[0]) / 2 + 0.3 * far * aside)
    vertices = np.concatenate((lab.vertices, np.array(more), after[1:]))
    hidden = tuple(range(n, n + len(more)))
    scene = Scene("unseen", lab, _chain(vertices), hidden)
    ways = np.diff(vertices, axis=0)
    turns = [_turn_deg(*pair) for pair in pairwise(ways)]
    if min(turns) < 15 or max(turns) > 160 or len(vertices) > 7:
        return None
    pixels = [optics.image(way.points) for way in scene.ways]
    if any((depth < 50).any() for _, depth in pixels):
        return None
    if any(optics.shows(pixels[k][0], -2.0).any() for k in hidden):
        return None
    seen = [k for k in range(len(scene.ways)) if k not in hidden]
    clear = all(_long_px(scene, scene.ways[k].points) >= _least_px(lab) for k in seen)
    return scene if clear else None


def bent(lab: Lab, rng: np.random.Generator) -> Scene | None:
    leg = int(rng.integers(len(lab.vertices) - 1))
    start, end = lab.vertices[leg : leg + 2]
    chord = end - start
    across = np.cross(chord, rng.normal(size=3))
    across /= np.linalg.norm(across)
    sagitta = rng.uniform(0.02, 0.08)
    radius = (0.25 + sagitta**2) / (2 * sagitta)
    half = np.arcsin(0.5 / radius)
    angle = np.linspace(-half, half, N_FINE)[:, np.newaxis]
    size = np.linalg.norm(chord)
    along = radius * np.sin(angle) + 0.5
    away = radius * (np.cos(angle) - np.cos(half))
    ways = list(_chain(lab.vertices))
    ways[leg] = Way(
        start + along * chord + size * away * across, leg - 1 if leg else None, bent=True
    )
    scene = Scene("bent", lab, tuple(ways))
    clear = all(_long_px(scene, way.points) >= _least_px(lab) for way in ways)
    return scene if clear else None


def _behind(kind: str, beyond: tuple[float, float]) -> Callable[..., Scene | None]:
    def drawn(lab: Lab, rng: np.random.Generator) -> Scene | None:
        optics = lab.optics
        nearest = min(
            float(((points.points - optics.eye) @ optics.axes[:, 2]).min())
            for points in _chain(lab.vertices)
        )
        normal = optics.axes @ np.append(np.tan(np.deg2rad(rng.uniform(-14, 14, size=2))), 1.0)
        normal /= np.linalg.norm(normal)
        distance, thick = rng.uniform(0.2, 0.6) * nearest, rng.uniform(4, 20)
        pane = Pane(float(distance), normal, float(thick), beyond)
        scene = Scene(kind, lab, _chain(lab.vertices), (), pane)
        deep = (lab.vertices - optics.eye) @ normal
        edge = distance * float(optics.axes[:, 2] @ normal) + thick
        if deep.min() < edge + 20:
            return None
        clear = all(_long_px(scene, way.points) >= _least_px(lab) for way in scene.ways)
        corners = scene.sight(optics, lab.vertices)[0][1:-1]
        by_the_edge = optics.shows(corners, -2.0) & ~optics.shows(corners, 1.5)
        return scene if clear and not by_the_edge.any() else None

    return drawn


def cameras(lab: Lab, rng: np.random.Generator) -> Scene | None:
    other = drawn_lab(int(rng.integers(1 << 30)))
    middle = lab.vertices.mean(axis=0)
    sight = middle - lab.optics.eye
    for _ in range(200):
        forward = rng.normal(size=3)
        forward /= np.linalg.norm(forward)
        if 20 < _turn_deg(forward, sight) < 120:
            break
    right = np.cross(forward, rng.normal(size=3))
    right /= np.linalg.norm(right)
    eye = middle - np.linalg.norm(sight) * rng.uniform(0.7, 1.4) * forward
    axes = np.column_stack((right, np.cross(forward, right), forward))
    optics = replace(other.optics, axes=axes, eye=eye)
    second = replace(
        lab, seed=other.seed, optics=optics, delays_ps=other.delays_ps,
        photons=lab.photons * float(rng.uniform(0.5, 2.0)),
    )  # fmt: skip
    if ((lab.vertices - eye) @ forward < 100).any():
        return None
    scene = Scene("cameras", lab, _chain(lab.vertices), beside=(second,))
    seen = [_long_px(replace(scene, lab=second), way.points) for way in scene.ways]
    return scene if max(seen) >= _least_px(second) else None


def block(lab: Lab, rng: np.random.Generator) -> Scene | None:
    vertices = lab.vertices
    leg, part = int(rng.integers(len(vertices) - 1)), rng.uniform(0.15, 0.85)
    start, end = vertices[leg : leg + 2]
    ahead = (end - start) / np.linalg.norm(end - start)
    askew = np.cross(ahead, rng.normal(size=3))
    turn = np.deg2rad(rng.uniform(0, 30))
    normal = np.cos(turn) * ahead + np.sin(turn) * askew / np.linalg.norm(askew)
    thick, wide = float(rng.uniform(5, 30)), float(rng.uniform(20, 40))
    middle = start + part * (end - start)
    enters = middle - ahead * (thick / 2) / (ahead @ normal)
    # Snell: what lies along the faces shrinks by the ratio of the phase indices.
    along = (ahead - (ahead @ normal) * normal) * INDEX / GLASS[0]
    within = along + np.sqrt(1 - along @ along) * normal
    leaves = enters + within * thick / (within @ normal)
    after = leaves + ahead * np.linalg.norm(end - leaves)
    room = min(np.linalg.norm(enters - start), np.linalg.norm(after - leaves))
    if room < wide or (end - leaves) @ ahead < wide:
        return None
    glass = lf.Block(
        tuple(middle), tuple(normal), thickness_mm=thick, diameter_mm=wide,
        glass=lf.Material(*GLASS),
    )  # fmt: skip
    points = [*vertices[: leg + 1], enters, leaves, after, *vertices[leg + 2 :]]
    chain = list(_chain(np.array(points)))
    # What light does within the glass and on its way out of it is nobody's model.
    chain[leg + 1] = replace(chain[leg + 1], share=0.0, index=GLASS[1])
    scene = Scene("block", lab, tuple(chain), block=glass)
    lit = [way.points for way in chain if way.share]
    pixels_of = [lab.optics.image(points)[0] for points in lit]
    if any(((points - lab.optics.eye) @ lab.optics.axes[:, 2] < 50).any() for points in lit):
        return None
    clear = [_long_px(scene, points) >= _least_px(lab) for points in lit]
    shown = [bool(lab.optics.shows(pixels, 1.0).any()) for pixels in pixels_of]
    # Beside the picture, between the source and a first leg, there may be glass, too.
    wanted = [k for k in range(len(lit)) if not (k == 0 and leg == 0 and not shown[0])]
    return scene if all(clear[k] for k in wanted) else None


def _as_the_first(brightness: Callable[[int, Floats], Floats], leg: int, length: Floats) -> Floats:
    return brightness(0, length)


def cavity(lab: Lab, rng: np.random.Generator) -> Scene | None:
    optics = lab.optics
    rows, cols = optics.shape
    away = float(np.linalg.norm(lab.vertices.mean(axis=0) - optics.eye))
    middle = optics.point(
        (rows - 1) / 2 + rng.uniform(-0.3, 0.3) * rows,
        (cols - 1) / 2 + rng.uniform(-0.3, 0.3) * cols,
        away,
    )
    axis = rng.normal(size=3)
    axis /= np.linalg.norm(axis)
    line = middle + np.linspace(-3 * away, 3 * away, 6001)[:, np.newaxis] * axis
    deep = (line - optics.eye) @ optics.axes[:, 2] > 50
    shown = np.flatnonzero(optics.shows(optics.image(line[deep])[0]))
    if len(shown) < 5:
        return None
    apart_mm = max(450, 6 * lab.pulse_ps + 4 * lab.tail_ps) * SPEED / 2
    ends = line[deep][shown[[0, -1]]] + np.outer([-1, 1], axis) * apart_mm * rng.uniform(1.1, 1.5)
    normals = np.outer([1, -1], axis) + np.deg2rad(0.4) * rng.normal(size=(2, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    mm_per_px = away / optics.focal_px
    walk = np.cross(axis, rng.normal(size=3)) * mm_per_px * rng.uniform(0, 3)
    place, ahead = ends[0], ends[1] + walk - ends[0]
    ahead /= np.linalg.norm(ahead)
    vertices = [place]
    for k in range(int(rng.integers(4, 17))):
        there, normal = ends[(k + 1) % 2], normals[(k + 1) % 2]
        place = place + ahead * ((there - place) @ normal / (ahead @ normal))
        ahead = ahead - 2 * (ahead @ normal) * normal
        vertices.append(place)
    corners = np.array(vertices)
    # Every pass is as bright as the first, but for what the mirrors take.
    lab = replace(lab, vertices=corners, brightness=partial(_as_the_first, lab.brightness))
    scene = Scene("cavity", lab, _chain(corners))
    kept = 0.97 ** np.arange(len(scene.ways))
    ways = [replace(way, share=share) for way, share in zip(scene.ways, kept, strict=True)]
    scene = replace(scene, ways=tuple(ways))
    if ((corners - optics.eye) @ optics.axes[:, 2] < 50).any():
        return None
    if optics.shows(optics.image(corners)[0], -2.0).any():
        return None
    clear = all(_long_px(scene, way.points) >= _least_px(lab) for way in ways)
    return scene if clear else None


KINDS: dict[str, Callable[[Lab, np.random.Generator], Scene | None]] = {
    "splitter": splitter,
    "unseen": unseen,
    "bent": bent,
    "pane": _behind("pane", (INDEX, INDEX)),
    "tank": _behind("tank", WATER),
    "cameras": cameras,
    "block": block,
    "cavity": cavity,
}


def drawn_scene(kind: str, seed: int) -> Scene:
    """The scene of a kind and a seed: the first that can be seen."""
    for k in range(2000):
        rng = np.random.default_rng([78, seed, k])
        scene = KINDS[kind](drawn_lab(int(rng.integers(1 << 30))), rng)
        if scene is not None:
            return _with_codes(replace(scene, lab=replace(scene.lab, seed=seed)))
    raise RuntimeError(f"no scene of {kind} in 2000: the generator's wishes exclude each other")


def _with_codes(scene: Scene) -> Scene:
    """As many codes as the light needs."""
    lab, last = scene.lab, 0.0
    for k, (way, start) in enumerate(zip(scene.ways, scene.starts_ps, strict=True)):
        for optics in (lab.optics, *(one.optics for one in scene.beside)):
            pixels, length = scene.sight(optics, way.points)
            shown = optics.shows(pixels, -3.0)
            arrival = start + scene.flown_ps(k, way.lengths) + length / SPEED
            last = max(last, float(arrival[shown].max(initial=0.0)))
    last += 6 * lab.pulse_ps + 12 * lab.tail_ps + 1000
    n_codes = int(last / lab.code_ps) + 40
    widths = 1 + 0.04 * np.random.default_rng([79, lab.seed]).normal(size=n_codes)
    widths /= widths.mean()
    beside = tuple(replace(one, n_codes=n_codes, widths=widths) for one in scene.beside)
    return replace(scene, lab=replace(lab, n_codes=n_codes, widths=widths), beside=beside)


# ---- recordings ------------------------------------------------------------------------------


def expected(scene: Scene, lab: Lab) -> Floats:
    """(rows, cols, codes) that a camera expects of the scene."""
    optics = lab.optics
    counts = np.zeros((*optics.shape, lab.n_codes))
    for k, (way, start) in enumerate(zip(scene.ways, scene.starts_ps, strict=True)):
        total = way.lengths[-1]
        pixels = scene.sight(optics, way.points)[0]
        shown = optics.shows(pixels, -8.0)
        if not (way.share and shown.any()):
            continue
        spans = np.abs(np.diff(pixels[shown], axis=0)).max(axis=1).sum()
        n = int(np.clip(spans * STEPS_PER_PX * len(shown) / shown.sum(), 40, 6000))
        lengths = (np.arange(n) + 0.5) / n * total
        points = way.at(lengths)
        places, sight = scene.sight(optics, points)
        away = np.linalg.norm(optics.eye - points, axis=1)
        leg = min(k, len(scene.lab.vertices) - 2)
        light = way.share * scene.lab.brightness(leg, lengths) / away**2 * total / n
        arrival = start + scene.flown_ps(k, lengths) + sight / SPEED
        shed(lab, counts, places, light, arrival)
    return counts_of(lab, counts * efficiency_of(lab))


def path_of(scene: Scene, method: str = "joint", noise: int = 0) -> lf.LightPath:
    labs = (scene.lab, *scene.beside)
    recordings, told_cameras = [], []
    for k, lab in enumerate(labs):
        rng = np.random.default_rng([80, scene.lab.seed, noise, k])
        recordings.append(histograms(lab, rng.poisson(expected(scene, lab))))
        camera = camera_of(lab)
        if scene.pane:
            camera = replace(camera, interfaces=scene.pane.told(lab.optics))
        told_cameras.append(camera)
    told: dict[str, Any] = {"source": source_of(scene.lab, noise)}
    if scene.pane is None:
        told["medium"] = lf.Medium(blocks=(scene.block,) if scene.block else ())
    if len(labs) == 1:
        return lf.reconstruct(
            recordings[0],
            camera=told_cameras[0],
            timing=calibration(labs[0]),
            method=method,
            **told,
        )
    clocks = [clock for lab in labs if (clock := calibration(lab)) is not None]
    return lf.reconstruct(recordings, camera=told_cameras, timing=clocks, method=method, **told)


# ---- outcome ---------------------------------------------------------------------------------


def right_legs(scene: Scene, path: lf.LightPath) -> bool:
    """Whether the legs are those of the scene; of unseen ones in a row one is as good."""
    if scene.kind == "splitter":
        return path.n_legs == len(scene.ways) and len(path.forks) == 1 and not path.unseen_legs
    if path.forks or (scene.block is not None) != bool(path.legs_in_glass):
        return False
    curved = tuple(k for k, way in enumerate(scene.ways) if way.bent)
    if tuple(sorted(bend.leg for bend in path.bends)) != curved:
        return False
    if scene.unseen:
        first, n = scene.unseen[0], len(scene.ways) - len(scene.unseen) + 1
        return path.n_legs == n and tuple(path.unseen_legs) == (first,)
    return path.n_legs == len(scene.ways) and not path.unseen_legs


def pulls_of(scene: Scene, path: lf.LightPath) -> Floats:
    """(k, 2), mean square and largest of what a place errs by in its stated errors.

    Places a quarter and three quarters along each leg's stretch in view, on the nearest branch.
    """
    pulls = []
    for k, (way, start) in enumerate(zip(scene.ways, scene.starts_ps, strict=True)):
        shown = scene.shown(k)
        if k in scene.unseen or not (way.share and len(shown)):
            continue
        for length in shown[[len(shown) // 4, 3 * len(shown) // 4]]:
            event = np.array([start + scene.flown_ps(k, length)])
            point = way.at(np.array([length]))[0]
            of_branches = [_pull(branch, event, point) for branch in path.branches]
            told = [pull for pull in of_branches if pull is not None]
            if told:
                pulls.append(min(told, key=lambda pull: pull[1]))
    return np.array(pulls).reshape(-1, 2)


def _pull(path: lf.LightPath, event: Floats, point: Floats) -> tuple[float, float] | None:
    place = path.position_at(event)[0]
    covariance = np.asarray(path.position_covariance_at(event))[0]
    if not (np.isfinite(place).all() and np.isfinite(covariance).all()):
        return None
    return pull_of(place - point, covariance)


def _told_of(path: lf.LightPath) -> str:
    named = " ".join(f"{one.name}:{one.sigma:.1f}" for one in path.verdict.findings[:3])
    bends = [bend.leg for bend in path.bends]
    return (
        f"{path.n_legs} legs, forks {path.forks}, unseen {path.unseen_legs}, bent {bends}, "
        f"{path.verdict.level} {named}"
    )


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--only", nargs="+", choices=KINDS, default=list(KINDS))
    parser.add_argument("--labs", type=int, default=12, help="of each kind")
    parser.add_argument("--first", type=int, default=0, help="first seed")
    parser.add_argument("--method", default="joint")
    parser.add_argument("--all", action="store_true", help="print every laboratory")
    args = parser.parse_args()
    warnings.simplefilter("ignore")
    for kind in args.only:
        levels, right, wrong, squares = Counter[str](), 0, 0, []
        for seed in range(args.first, args.first + args.labs):
            scene, began = drawn_scene(kind, seed), time.process_time()
            said = f"{kind} {scene.lab.words()}"
            try:
                path = path_of(scene, args.method)
            except (CalibrationError, GeometryError, NothingFoundError) as problem:
                levels["none"] += 1
                print(f"{said}: {problem}", flush=True)
                continue
            level, good = str(path.verdict.level), right_legs(scene, path)
            pulls = pulls_of(scene, path)
            far = bool((pulls[:, 1] > FAR_STDS).any())
            levels[level] += 1
            right += good
            # An arc that a recording does not show is none, as long as points are where they are.
            wrong += level == "trust" and (far or not (good or kind == "bent"))
            if good and len(pulls):
                squares.append(pulls[:, 0].mean())
            if args.all or far or not good or level != "trust":
                most = f"{pulls[:, 1].max():.1f}" if len(pulls) else "-"
                print(
                    f"{said}; {len(scene.ways)} legs {scene.forks} unseen {scene.unseen}: "
                    f"{'right' if good else 'WRONG'}, {_told_of(path)}; farthest {most} stated "
                    f"errors; {time.process_time() - began:.0f} s",
                    flush=True,
                )
        found = "/".join(str(levels[one]) for one in ("trust", "check", "contradicted", "none"))
        print(
            f"{kind}, {args.method}: {right} of {args.labs} right, t/c/c/none {found}, trusted and "
            f"wrong {wrong}, pull {interval(np.array(squares), 1.0)}",
            flush=True,
        )


if __name__ == "__main__":
    main()
