"""What a recording through plane interfaces can tell at best: a bound by numerical differentiation.

Noise-free expected counts are differentiated by central differences, weighed by their Poisson
errors and summed. Free beside the path: the log of the light along each leg (straight lines
between knots), the spot's and the pulse's width, and each pixel's background.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import cho_factor, cho_solve

from tests.oracles.refracted import (
    Caught,
    Plane,
    RefractedScene,
    Stations,
    block_vertices_mm,
    caught,
    code_edges_ps,
    in_picture,
    light_scale,
    positions_at,
    signal_counts,
    stations,
)

_WEAK = 1e-6
"""Precision of what nothing else holds (mm⁻²: 1 m), so that gauges do no harm."""


@dataclass(frozen=True, eq=False)
class Freedom:
    """A number of the scene that is not known exactly."""

    name: str
    changed: Callable[[RefractedScene, float], RefractedScene]
    """The scene with that number larger by an amount."""
    step: float
    """Of the central difference."""
    std: float = math.inf
    """Of what is known of it beforehand; inf: nothing."""


def vertex_freedom(vertex: int, axis: int, step_mm: float = 0.002) -> Freedom:
    """A coordinate of a vertex, mm: `x1` is the first after the source's."""

    def moved(scene: RefractedScene, amount: float) -> RefractedScene:
        vertices = np.array(scene.vertices_mm, dtype=float)
        vertices[vertex, axis] += amount
        return replace(scene, vertices_mm=vertices)

    return Freedom(f"{'xyz'[axis]}{vertex}", moved, step_mm)


def emission_freedom(std_ps: float = math.inf, step_ps: float = 0.02) -> Freedom:
    """The emission time, ps."""

    def later(scene: RefractedScene, amount: float) -> RefractedScene:
        return replace(scene, emission_time_ps=scene.emission_time_ps + amount)

    return Freedom("emission", later, step_ps, std_ps)


def medium_freedom(planes: Sequence[int], std_share: float, *, path: bool = True) -> Freedom:
    """The index beyond the planes of these numbers, as a share of itself: phase and group alike,
    and that of the beam where the beam is in it (`path`)."""

    def denser(scene: RefractedScene, amount: float) -> RefractedScene:
        stack = [
            replace(
                plane,
                phase_beyond=plane.phase_beyond * (1.0 + amount),
                group_beyond=plane.group_beyond * (1.0 + amount),
            )
            if number in planes
            else plane
            for number, plane in enumerate(scene.planes)
        ]
        index = np.broadcast_to(scene.path_group_index, scene.n_legs) * (1.0 + path * amount)
        return replace(scene, planes=tuple(stack), path_group_index=tuple(index.tolist()))

    return Freedom(f"index_{'_'.join(map(str, planes))}", denser, 2e-6, std_share)


def distance_freedom(planes: Sequence[int], std_mm: float) -> Freedom:
    """How far the planes of these numbers stand from the camera, mm: all moved together."""

    def away(scene: RefractedScene, amount: float) -> RefractedScene:
        def moved(plane: Plane) -> Plane:
            shift = amount * plane.away_from(scene.camera.center)
            return replace(plane, point_mm=np.asarray(plane.point_mm) + shift)

        stack = [moved(p) if n in planes else p for n, p in enumerate(scene.planes)]
        return replace(scene, planes=tuple(stack))

    return Freedom(f"distance_{'_'.join(map(str, planes))}", away, 0.002, std_mm)


def block_freedoms(tilt_deg: float) -> list[Freedom]:
    """Both slopes of the beam of a `block_world` at its source: all that is free of its path."""

    def turned(axis: int) -> Callable[[RefractedScene, float], RefractedScene]:
        def changed(scene: RefractedScene, amount: float) -> RefractedScene:
            slopes = (amount, 0.0) if axis == 0 else (0.0, amount)
            return replace(scene, vertices_mm=block_vertices_mm(tilt_deg, slopes))

        return changed

    return [Freedom(f"slope_{name}", turned(axis), 5e-6) for axis, name in enumerate("yz")]


def _spot(scene: RefractedScene, amount: float) -> RefractedScene:
    return replace(scene, spot_std_px=scene.spot_std_px + amount)


def _pulse(scene: RefractedScene, amount: float) -> RefractedScene:
    return replace(scene, pulse_std_ps=scene.pulse_std_ps + amount)


SPOT = Freedom("spot_std_px", _spot, 2e-4)
PULSE = Freedom("pulse_std_ps", _pulse, 0.03)


@dataclass(frozen=True, eq=False)
class RefractedBound:
    """The least errors that an unbiased estimator can have."""

    position_rms_mm: float
    """rms error of the position in view at 1,000 equal event times from source to exit."""
    names: tuple[str, ...]
    covariance: np.ndarray
    """(parameters, parameters) in the order of the names; pixels' backgrounds are eliminated."""

    def std(self, name: str) -> float:
        """One-sigma error of a parameter, all others free."""
        at = self.names.index(name)
        return float(np.sqrt(self.covariance[at, at]))

    def block(self, names: Sequence[str]) -> np.ndarray:
        """(n, n) covariance of the parameters named."""
        at = [self.names.index(name) for name in names]
        return np.asarray(self.covariance[np.ix_(at, at)])


def bound(
    scene: RefractedScene,
    *,
    fit_emission: bool = False,
    fit_pulse: bool = True,
    vertices: Sequence[int] | None = None,
    also: Sequence[Freedom] = (),
    others: Sequence[RefractedScene] = (),
    knot_px: float = 3.0,
    step_share: float = 1.0,
) -> RefractedBound:
    """Cramér-Rao bound of the path.

    Parameters
    ----------
    scene : at which the counts are differentiated; its background must not be zero.
    others : the same flight before further cameras, each with a light, a spot and a pulse of its
        own; what `scene` has in view is still what the error of the position is taken over.
    fit_emission : whether the emission time is unknown.
    fit_pulse : whether the pulse's width is.
    vertices : numbers of the vertices that are unknown; None: all but the source.
    also : what else is unknown, each with its prior (`medium_freedom`, `distance_freedom`).
    knot_px : distance of the knots of the log of the light along each leg, in the picture.
    step_share : of the usual steps, to see that they do not matter.
    """
    numbers = range(1, scene.n_legs + 1) if vertices is None else vertices
    free = [vertex_freedom(vertex, axis) for vertex in numbers for axis in range(3)]
    free += [emission_freedom()] * fit_emission + list(also)
    free = [replace(one, step=one.step * step_share) for one in free]
    own = [replace(one, step=one.step * step_share) for one in [SPOT] + [PULSE] * fit_pulse]
    names, information = [one.name for one in free], np.diag([max(f.std**-2, _WEAK) for f in free])
    k = len(free)
    for number, one in enumerate((scene, *others)):
        found, labels = _of_counts(one, free, own, knot_px)
        information = np.pad(information, (0, len(labels)))
        places = np.r_[0:k, len(names) : len(names) + len(labels)]
        information[np.ix_(places, places)] += found
        names += labels if number == 0 else [f"{label}_of_{number + 1}" for label in labels]
    unit = 1.0 / np.sqrt(np.diag(information))
    factor = cho_factor(information * np.outer(unit, unit))
    covariance = cho_solve(factor, np.eye(unit.size)) * np.outer(unit, unit)
    times = np.linspace(scene.vertex_times_ps[0], scene.vertex_times_ps[-1], 1000)
    times = times[in_picture(scene, positions_at(scene, times))]
    moves = np.array([_central(lambda s: positions_at(s, times), scene, one) for one in free])
    square = np.einsum("ink,ij,jnk->n", moves, covariance[:k, :k], moves)
    return RefractedBound(float(np.sqrt(square.mean())), tuple(names), covariance)


def _of_counts(
    scene: RefractedScene, free: Sequence[Freedom], own: Sequence[Freedom], knot_px: float
) -> tuple[np.ndarray, list[str]]:
    """Information of one camera's counts on what is free, then on its own; names of these."""
    # What the scale would take up is the light's own freedom: it stays as the truth has it.
    beam = stations(scene)
    pairs = caught(scene, beam)
    scale = light_scale(scene, pairs)
    signal = signal_counts(scene, pairs, scale)
    fold = _Fold.of(signal, code_edges_ps(scene.clock), scene.clock.no_photon_code)

    def seen(changed: RefractedScene) -> np.ndarray:
        return fold(signal_counts(changed, caught(changed, stations(changed)), scale))

    slopes = [_central(seen, scene, one) for one in (*free, *own)]
    hats = list(_hats(scene, beam, knot_px))
    slopes += [fold(signal_counts(scene, _weighed(pairs, hat), scale)) for hat in hats]
    mean = fold(signal) + scene.background_per_ps * fold.width_ps
    information = _information(np.array(slopes), mean, fold.width_ps)
    weak = np.arange(len(free), len(information))
    information[weak, weak] += _WEAK
    return information, [one.name for one in own] + [f"light_{n}" for n in range(len(hats))]


def _central(
    of: Callable[[RefractedScene], np.ndarray], scene: RefractedScene, one: Freedom
) -> np.ndarray:
    ahead, behind = of(one.changed(scene, one.step)), of(one.changed(scene, -one.step))
    return np.asarray((ahead - behind) / (2.0 * one.step))


@dataclass(frozen=True, eq=False)
class _Fold:
    """Lit pixels, and their codes where light is; all other codes of a pixel are one bin."""

    lit: np.ndarray
    """(lit,) numbers of pixels."""
    codes: np.ndarray
    """(codes,) numbers of codes that stay."""
    live: np.ndarray
    """(all codes,), 0 for the code that no photon gives."""
    width_ps: np.ndarray
    """(codes + 1,) time in each bin."""

    @classmethod
    def of(cls, signal: np.ndarray, edges_ps: np.ndarray, no_photon_code: int | None) -> _Fold:
        live = np.ones(signal.shape[1])
        if no_photon_code is not None:
            live[no_photon_code] = 0.0
        lit = np.flatnonzero(signal.sum(axis=1) > 1e-6)
        codes = np.flatnonzero(live * signal.max(axis=0) > 1e-9)
        width = live * np.diff(edges_ps)
        return cls(lit, codes, live, np.append(width[codes], width.sum() - width[codes].sum()))

    def __call__(self, counts: np.ndarray) -> np.ndarray:
        """(lit, codes + 1) of counts (pixels, codes)."""
        own = counts[self.lit] * self.live
        kept = own[:, self.codes]
        return np.column_stack([kept, own.sum(axis=1) - kept.sum(axis=1)])


def _hats(scene: RefractedScene, beam: Stations, knot_px: float) -> Iterator[np.ndarray]:
    """(stations,) shares of the light that each knot's log-strength multiplies."""
    half_rows, half_cols = scene.camera.rows / 2, scene.camera.cols / 2
    inside = (np.abs(beam.row - half_rows + 0.5) < half_rows) & (
        np.abs(beam.col - half_cols + 0.5) < half_cols
    )
    for leg in np.unique(beam.leg[inside]):
        own = beam.leg == leg
        steps = np.hypot(np.diff(beam.row[own]), np.diff(beam.col[own]))
        walked_px = np.append(0.0, np.cumsum(steps))
        entry, *_, leaving = walked_px[inside[own]]
        knots = np.linspace(entry, leaving, round((leaving - entry) / knot_px) + 1)
        for one in np.eye(knots.size):
            hat = np.zeros(beam.leg.size)
            hat[own] = np.interp(walked_px, knots, one)
            yield hat


def _weighed(pairs: Caught, weight: np.ndarray) -> Caught:
    """Pairs with their stations' light multiplied, those without any left out."""
    own = weight[pairs.station]
    kept = own > 0.0
    return Caught(
        pairs.pixel[kept], pairs.station[kept], pairs.arrival_ps[kept], (pairs.light * own)[kept]
    )


def _information(slopes: np.ndarray, mean: np.ndarray, width_ps: np.ndarray) -> np.ndarray:
    """(p, p) of slopes (p, pixels, bins), each pixel's background fitted and eliminated."""
    if not (mean > 0.0).all():
        raise ValueError("bins that expect nothing bound nothing: give the scene a background")
    root = np.sqrt(mean)
    white, dark = slopes / root, width_ps / root
    taken = (white * dark).sum(axis=2) / (dark**2).sum(axis=1)
    white = white - taken[:, :, None] * dark
    flat = white.reshape(len(slopes), -1)
    return np.asarray(flat @ flat.T)
