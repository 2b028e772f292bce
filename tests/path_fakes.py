"""A LightPath written down by hand, for tests of what is done with paths."""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from typing import Any

import numpy as np

from lightflight.camera.model import Camera
from lightflight.flight import Medium, Source
from lightflight.path.light_path import LightPath
from lightflight.path.tables import Goodness

PAPER_VERTICES = np.array([(0, 0, 0), (375, 25, 50), (0, 50, 10), (375, 75, 50)], dtype=float)
PAPER_CAMERA = Camera.facing_plane((32, 32), center_mm=(187.5, 37.5))
GOOD = Goodness(10.0, 9, 12, 0, 1.5, 0.0, True)


@dataclass(frozen=True)
class Truth:
    vertices_mm: np.ndarray
    vertex_times_ps: np.ndarray


def vertex_times(vertices: Any, *, start: float = 2000.0, index: float = 1.00027) -> np.ndarray:
    """Length over speed, leg by leg, written out."""
    times = [start]
    for a, b in itertools.pairwise(vertices):
        times.append(times[-1] + index * float(np.linalg.norm(np.subtract(b, a))) / 0.299792458)
    return np.array(times)


def truth_of(vertices: Any, **clock: float) -> Truth:
    return Truth(np.array(vertices, dtype=float), vertex_times(vertices, **clock))


def make_path(vertices: Any = PAPER_VERTICES, covariance: Any = None, **fields: Any) -> LightPath:
    vertices = np.array(vertices, dtype=float)
    times = fields.pop("vertex_times_ps", None)
    settings = {
        "camera": PAPER_CAMERA,
        "source": Source(vertices[0]) if vertices.shape[1:] == (3,) else Source(),
        "medium": Medium(),
        "goodness": GOOD,
    }
    return LightPath(
        vertices,
        vertex_times(vertices) if times is None else times,
        np.zeros((4 * len(vertices),) * 2) if covariance is None else covariance,
        **(settings | fields),
    )


def random_covariance(rng: np.random.Generator, n_vertices: int, *, scale: float) -> np.ndarray:
    """A full-rank covariance with correlations between vertices and between place and time."""
    size = 4 * n_vertices
    root = scale * rng.normal(size=(size, size)) / np.sqrt(size)
    return root @ root.T
