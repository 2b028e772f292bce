"""Fisher information of a world: what a recording can tell, and which causes look alike.

Expected counts are differentiated numerically, weighed by their Poisson errors, and summed; what is
told with an error enters as a prior, what is told as exact is not free. To first order this says
how many sigma of a recording a defect makes, where it moves the path if nobody frees it, and how
much of it each named cause would take up.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.linalg import block_diag, cho_factor, cho_solve
from scipy.sparse import csr_array, hstack

from tests.oracles.worlds.counts import expected_counts
from tests.oracles.worlds.light import stations
from tests.oracles.worlds.parameters import POSE, SHAPES, causes, nudged, plausible, step_of
from tests.oracles.worlds.random_worlds import brightness_precision
from tests.oracles.worlds.world import NODE_MM, World

_WEAK = 1e-6
"""Precision of what nothing else holds (mm⁻²: 1 m), so that gauges do no harm."""


@dataclass(frozen=True)
class Window:
    """Codes that are looked at one by one; all others of a pixel are one bin."""

    first: int
    stop: int

    def vector(self, world: World) -> np.ndarray:
        """(bins,) expected counts of all repeats."""
        parts = []
        for repeat in range(world.repeats):
            cube = expected_counts(world, repeat).reshape(world.n_pixels, -1)
            parts.append(self.folded(cube).ravel())
        return np.concatenate(parts)

    def folded(self, cube: np.ndarray) -> np.ndarray:
        """(pixels, bins)."""
        kept = cube[:, self.first : self.stop]
        rest = cube.sum(axis=1) - kept.sum(axis=1)
        return np.column_stack([kept, rest])


def window_of(world: World, before_ps: float = 2500.0, after_ps: float = 4500.0) -> Window:
    """Around all light of the beam that the picture sees."""
    beam = stations(world, stride=5.0)
    times = beam.arrival_ps[world.view.inside(beam.place)]
    near, far = world.clock.intervals()
    early, late = times.min() - before_ps, times.max() + after_ps
    codes = np.flatnonzero((far.max(axis=0) > early) & (near.min(axis=0) < late))
    return Window(int(codes[0]), int(codes[-1]) + 1)


def slope(world: World, name: str, window: Window) -> np.ndarray:
    """(bins,) derivative of the expected counts by a parameter."""
    step, both_ways = step_of(name)
    ahead = window.vector(nudged(world, name, step))
    if not both_ways:
        return np.asarray((ahead - window.vector(world)) / step)
    return np.asarray((ahead - window.vector(nudged(world, name, -step))) / (2.0 * step))


def light_slope(world: World, window: Window, low: float, high: float, peak: float) -> np.ndarray:
    """(bins,) derivative by the log of the light along the path, in a triangle of lengths from
    `low` over `peak` to `high` (a box where the peak is not between them), in mm."""

    def share(length: np.ndarray) -> np.ndarray:
        if not low < peak < high:
            return ((length >= low) & (length < high)).astype(float)
        return np.clip(
            np.minimum((length - low) / (peak - low), (high - length) / (high - peak)), 0, None
        )

    parts = []
    for repeat in range(world.repeats):
        cube = expected_counts(world, repeat, weights=share, background=False)
        parts.append(window.folded(cube.reshape(world.n_pixels, -1)).ravel())
    return np.concatenate(parts)


def nuisances(world: World) -> dict[str, float]:
    """Name and precision of all that is free beside the light: the path, what the recording shows
    of itself, and what is told with an error."""
    prior = world.told.prior
    free = dict.fromkeys(("background", "std_ps", "spot_std_px"), _WEAK)
    for vertex in range(len(world.vertices)):
        free |= {f"{axis}{vertex}": _WEAK for axis in "xyz"}
    told = {
        "emission": prior.emission_ps,
        **dict.fromkeys(("x0", "y0", "z0"), prior.source_mm),
        **dict.fromkeys(POSE[:3], prior.position_mm),
        **dict.fromkeys(POSE[3:], math.radians(prior.rotation_deg)),
        "focal_length": prior.focal_share,
        "k1": prior.lens,
        "index": prior.index,
        "offset_ps": prior.offset_ps,
        "scale": prior.scale,
    }
    for name, std in told.items():
        free.pop(name, None)
        if std > 0.0:
            free[name] = max(std**-2, 1e-12)
    return free


def _whitened(slopes: Sequence[np.ndarray], root: np.ndarray) -> csr_array:
    """Columns over the root of the mean, kept where they are not nothing."""
    columns = []
    for values in slopes:
        values = values / root
        values[np.abs(values) < 1e-8 * np.abs(values).max(initial=1e-300)] = 0.0
        columns.append(csr_array(values[:, None]))
    return csr_array(hstack(columns)) if columns else csr_array((root.size, 0))


@dataclass(frozen=True, eq=False)
class Explanation:
    """How much of a misfit one cause takes up when it is freed alone."""

    cause: str
    gain: float
    """Chi square that goes away, less one for each parameter freed."""
    sizes: dict[str, float]
    """What its parameters then are."""


@dataclass(frozen=True, eq=False)
class Fisher:
    """Information on named parameters, and the slopes it is made of."""

    world: World
    window: Window
    names: tuple[str, ...]
    slopes: csr_array
    """(bins, parameters), over the root of the expected counts."""
    precision: np.ndarray
    """(parameters, parameters), of the prior."""
    mean: np.ndarray
    """(bins,), expected counts."""

    @cached_property
    def root(self) -> np.ndarray:
        return np.sqrt(np.maximum(self.mean, 1e-9))

    @cached_property
    def information(self) -> np.ndarray:
        """(parameters, parameters), with the prior."""
        return np.asarray((self.slopes.T @ self.slopes).toarray() + self.precision)

    @cached_property
    def covariance(self) -> np.ndarray:
        """(parameters, parameters)."""
        return self._solved(np.eye(len(self.names)))

    def std(self, name: str) -> float:
        """One-sigma error of a parameter, all others free."""
        at = self.names.index(name)
        return float(np.sqrt(self.covariance[at, at]))

    def std_along(self, weights: dict[str, float]) -> float:
        """One-sigma error of a weighted sum of parameters (a vertex off its leg's line, say)."""
        vector = np.array([weights.get(name, 0.0) for name in self.names])
        return float(np.sqrt(vector @ self.covariance @ vector))

    def _solved(self, right: np.ndarray) -> np.ndarray:
        scale = 1.0 / np.sqrt(np.diag(self.information))
        factor = cho_factor(self.information * np.outer(scale, scale))
        return np.asarray(scale[:, None] * cho_solve(factor, (right.T * scale).T))

    def misfit(self, other: World) -> np.ndarray:
        """(bins,) what another world's expected counts are off by, in standard errors."""
        if other.repeats != self.world.repeats:
            raise ValueError("both worlds must have the same repeats")
        return np.asarray((self.window.vector(other) - self.mean) / self.root)

    def left_by(self, columns: np.ndarray) -> np.ndarray:
        """(n, n) products of what the free parameters cannot take up of whitened columns."""
        pull = self.slopes.T @ columns
        return np.asarray(columns.T @ columns - pull.T @ self._solved(pull))

    def seen_at(self, other: World) -> float:
        """Sigma at which one recording of `other` contradicts this world, all that is free
        fitted."""
        return math.sqrt(max(float(self.left_by(self.misfit(other)[:, None])[0, 0]), 0.0))

    def moved_by(self, other: World) -> dict[str, float]:
        """What a fit of this world to recordings of `other` finds, less the truth here."""
        shift = self._solved(self.slopes.T @ self.misfit(other)[:, None])[:, 0]
        return dict(zip(self.names, shift.tolist(), strict=True))

    def explanations(
        self, other: World, *, times: float = 1.0, asked: dict[str, tuple[str, ...]] | None = None
    ) -> list[Explanation]:
        """Causes by how much of the misfit they take up when freed alone, the best first.

        Counts are taken as straight in every parameter. Large defects are not: give `other` with
        a small one, and how many `times` larger the one is that is meant.
        """
        base = self.world.but(**{name: getattr(other, name) for name in SHAPES})
        asked = causes(base.n_legs) if asked is None else asked
        misfit, found = times * self.misfit(other), []
        alone, _ = self._fitted(base, [], misfit)
        for cause, names in asked.items():
            fixed = [n for n in names if n not in self.names and (n != "glint" or other.glint)]
            if fixed:
                left, sizes = self._fitted(base, fixed, misfit)
                own = dict(zip(fixed, sizes[len(self.names) :].tolist(), strict=True))
                found.append(Explanation(cause, alone - left - len(fixed), own))
        return sorted(found, key=lambda explanation: -explanation.gain)

    def _fitted(
        self, base: World, freed: list[str], misfit: np.ndarray
    ) -> tuple[float, np.ndarray]:
        """Chi square that is left, and all parameters, with some more of them freed (each with
        its plausible size as its prior)."""
        slopes = csr_array(hstack([self.slopes, *(self._slope(base, name) for name in freed)]))
        own = np.diag([plausible(name) ** -2 for name in freed])
        information = (slopes.T @ slopes).toarray() + block_diag(self.precision, own)
        scale = 1.0 / np.sqrt(np.diag(information))
        # Twins (a later clock, a later emission) share what is theirs instead of running away.
        factor = cho_factor(information * np.outer(scale, scale) + 1e-10 * np.eye(scale.size))
        pull = slopes.T @ misfit
        sizes = scale * cho_solve(factor, scale * pull)
        return float(misfit @ misfit - pull @ sizes), sizes

    def _slope(self, base: World, name: str) -> csr_array:
        """(bins, 1), whitened slope of a candidate, kept for the next defect."""
        key = (name, *(str(getattr(base, shape)) for shape in SHAPES if shape.startswith(name)))
        if key not in self._kept:
            self._kept[key] = _whitened([slope(base, name, self.window)], self.root)
        return self._kept[key]

    @cached_property
    def _kept(self) -> dict[tuple[str, ...], csr_array]:
        """Slopes of candidates, by name and shape."""
        return {}


def fisher(
    world: World,
    *,
    also: dict[str, float] | None = None,
    brightness_std: float | None = None,
    window: Window | None = None,
) -> Fisher:
    """Information of one recording (of all repeats) on the path and all that is free with it.

    Parameters
    ----------
    world : at which the counts are differentiated.
    also : names (`parameters.py`) that are free too, each with the standard deviation of its
        prior (inf: none).
    brightness_std : of the log of the light at nodes every 5 mm, alike over 10 mm; None: the
        world's own, 0: no nodes. The strength of each leg is free in any case.
    window : codes looked at one by one; None: around the beam's light.
    """
    window = window_of(world) if window is None else window
    free = nuisances(world) | {name: max(s**-2, 1e-12) for name, s in (also or {}).items()}
    mean = window.vector(world)
    root = np.sqrt(np.maximum(mean, 1e-9))
    slopes = [slope(world, name, window) for name in free]
    names, precision = list(free), list(free.values())
    steps = np.linalg.norm(np.diff(world.vertices, axis=0), axis=1)
    ends = np.append(0.0, np.cumsum(steps))
    ends[-1] += 1.0
    for leg in range(world.n_legs):
        slopes.append(light_slope(world, window, ends[leg], ends[leg + 1], -1.0))
        names.append(f"log_flux_{leg}")
        precision.append(0.1)
    std = world.brightness_std if brightness_std is None else brightness_std
    nodes = _nodes_in_view(world) if std else np.zeros(0, dtype=int)
    for node in nodes:
        peak = NODE_MM * node
        slopes.append(light_slope(world, window, peak - NODE_MM, peak + NODE_MM, peak))
        names.append(f"light_{node}")
    prior = np.zeros((len(names), len(names)))
    prior[: len(precision), : len(precision)] = np.diag(precision)
    if nodes.size:
        prior[len(precision) :, len(precision) :] = _node_precision(nodes, std)
    return Fisher(world, window, tuple(names), _whitened(slopes, root), prior, mean)


def _nodes_in_view(world: World) -> np.ndarray:
    beam = stations(world)
    row, col = world.view.image(beam.place)
    near = (np.abs(row - world.view.axis()[0]) < world.view.shape[0] / 2 + 2.5) & (
        np.abs(col - world.view.axis()[1]) < world.view.shape[1] / 2 + 2.5
    )
    lengths = beam.walked_mm[near] / NODE_MM
    return np.unique(np.concatenate([np.floor(lengths), np.ceil(lengths)]).astype(int))


def _node_precision(nodes: np.ndarray, std: float) -> np.ndarray:
    """Of the nodes in view, those out of it averaged over."""
    every = brightness_precision(int(nodes.max()) + 1, std)
    covariance = np.linalg.inv(every)[np.ix_(nodes, nodes)]
    return np.asarray(np.linalg.inv(covariance))


def inseparable(found: list[Explanation], within: float = 9.0) -> tuple[str, ...]:
    """Causes whose gain is within 9 of the best."""
    return tuple(e.cause for e in found if e.gain > found[0].gain - within)


def as_told(world: World, undisturbed: World | None = None) -> World:
    """The world that the user describes: the path of the undisturbed one from the told source,
    seen by the told camera, nothing wrong."""
    told = world.told
    base = world if undisturbed is None else undisturbed
    vertices = np.array(base.vertices, dtype=float)
    vertices[0] = told.source_mm
    return replace(
        base, vertices=vertices, told=told, view=told.view, emission_ps=told.emission_ps,
        path_index=told.path_index, return_index=told.return_index, clock=told.clock,
        offset_ps=0.0, scale=0.0, repeats=world.repeats,
    )  # fmt: skip
