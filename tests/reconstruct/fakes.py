"""Small scenes, and arrival tables made from them by hand, for the tests of the reconstruction.

`arrivals_of` walks along each leg in fine steps and gives every pixel the time and the light of
the step it sees best: no footprints, no fits, no line of the reconstruction is used.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from lightflight.camera.model import Camera
from lightflight.camera.rigid import rotation_from_vector
from lightflight.flight import Medium
from lightflight.reconstruct.model.geometry import PathState
from lightflight.timing.pulses.arrivals import Arrivals
from tests.path_fakes import vertex_times

C = 0.299792458
PAPER = Camera.facing_plane((32, 32), center_mm=(187.5, 37.5))
PULSE_STD_PS = 70.0
LENS = (-0.21, 0.06, 0.002, -0.003, 0.01)


def camera_like(
    seed: int, *, lens: Sequence[float] = LENS, rows: int = 32, cols: int = 32
) -> Camera:
    """A camera somewhere, turned somehow, that looks at the neighbourhood of the origin."""
    rng = np.random.default_rng(seed)
    turn = rng.normal(0.0, 1.0, 3)
    pose = np.eye(4)
    pose[:3, :3] = rotation_from_vector(turn)
    # The optical axis is the camera's +z: stand back along it, and aim a little off.
    pose[:3, 3] = -pose[:3, 2] * rng.uniform(400.0, 800.0) + rng.normal(0.0, 15.0, 3)
    focal = rng.uniform(1.8, 2.4, 2) * (rows, cols)
    matrix = np.array([[focal[1], 0, cols / 2 - 0.7], [0, focal[0], rows / 2 - 0.2], [0, 0, 1]])
    return Camera(matrix, np.array(lens), pose, (rows, cols))


def path_in_view(camera: Camera, n_legs: int, seed: int, *, size: float = 0.8) -> PathState:
    """Vertices drawn over the picture and over depths of some 100 mm about the middle distance."""
    rng = np.random.default_rng(seed)
    rows, cols = camera.shape
    row = (rng.uniform(-0.5, 0.5, n_legs + 1) * size + 0.5) * (rows - 1)
    col = (rng.uniform(-0.5, 0.5, n_legs + 1) * size + 0.5) * (cols - 1)
    distance = np.linalg.norm(camera.center_mm) + rng.uniform(-100.0, 100.0, n_legs + 1)
    rays = camera.rays_from_pixels(row, col)
    return PathState(camera.center_mm + distance[:, np.newaxis] * rays, rng.uniform(-500, 4000))


def arrivals_of(
    vertices: Any,
    camera: Camera,
    *,
    start: float = 2000.0,
    medium: Medium | None = None,
    photons: float = 2000.0,
    spot_px: float = 0.35,
    fewest: float = 15.0,
    rng: np.random.Generator | None = None,
    period_ps: float | None = None,
) -> Arrivals:
    """One row per pixel and leg with more than `fewest` photons; Gaussian noise where `rng`."""
    medium = Medium() if medium is None else medium
    vertices = np.asarray(vertices, dtype=float)
    times = vertex_times(vertices, start=start, index=medium.path_group_index)
    columns: list[tuple[int, int, float, float]] = []
    for leg in range(len(vertices) - 1):
        fraction = np.linspace(0.0, 1.0, 6001)
        point = vertices[leg] + fraction[:, np.newaxis] * (vertices[leg + 1] - vertices[leg])
        row, col = camera.pixels_from_points(point)
        arrival = times[leg] + fraction * (times[leg + 1] - times[leg])
        arrival = arrival + medium.return_group_index / C * np.linalg.norm(
            point - camera.center_mm, axis=1
        )
        reach = int(np.ceil(spot_px * np.sqrt(2.0 * max(np.log(photons / fewest), 0.0)))) + 1
        for r, c in _near_places(row, col, reach, camera.shape):
            away = np.hypot(row - r, col - c)
            nearest = int(np.argmin(away))
            light = photons * np.exp(-0.5 * (away[nearest] / spot_px) ** 2)
            if light > fewest:
                columns.append((r, c, float(arrival[nearest]), float(light)))
    table = np.array(columns).reshape(-1, 4)
    error = PULSE_STD_PS / np.sqrt(table[:, 3])
    noise = 0.0 if rng is None else error * rng.normal(size=len(error))
    return arrivals_from_columns(
        table[:, 0], table[:, 1], table[:, 2] + noise, error, table[:, 3], camera.shape, period_ps
    )


def _near_places(
    row: np.ndarray, col: np.ndarray, reach: int, shape: tuple[int, int]
) -> list[tuple[int, int]]:
    """Pixels that places of the picture come nearer than so many pixels, in order."""
    aside = np.arange(-reach, reach + 1)
    places = np.unique(np.rint(np.stack((row, col), axis=1)).astype(int), axis=0)
    down, across = (places[:, k, None, None] + aside for k in (0, 1))
    near = np.stack(np.broadcast_arrays(down.swapaxes(1, 2), across), axis=-1).reshape(-1, 2)
    inside = np.all((near >= 0) & (near < shape), axis=1)
    return [(int(r), int(c)) for r, c in np.unique(near[inside], axis=0)]


def arrivals_from_columns(
    row: Any,
    col: Any,
    arrival: Any,
    error: Any,
    photons: Any,
    shape: tuple[int, int],
    period_ps: float | None = None,
) -> Arrivals:
    n = len(np.asarray(row))
    zero = np.zeros(n)
    folded = np.asarray(arrival, dtype=float)
    return Arrivals(
        row=np.asarray(row, dtype=np.int32),
        col=np.asarray(col, dtype=np.int32),
        arrival_ps=folded if period_ps is None else np.mod(folded, period_ps),
        photon_std_ps=np.asarray(error, dtype=float),
        pixel_std_ps=zero,
        shared_modes_ps=np.zeros((n, 0)),
        shared_names=(),
        std_ps=np.full(n, PULSE_STD_PS),
        std_error_ps=zero + 1.0,
        photons=np.asarray(photons, dtype=float),
        photons_std=np.sqrt(np.asarray(photons, dtype=float)),
        background_per_ps=zero,
        chi2=zero + 10.0,
        dof=np.full(n, 10),
        flags=np.zeros(n, dtype=np.uint32),
        pulse_index=np.zeros(n, dtype=np.int32),
        shape=shape,
        laser_period_ps=period_ps,
        method="likelihood",
    )


def joined(*parts: Arrivals) -> Arrivals:
    """Rows of several tables in one."""
    first = parts[0]
    names = [n for n, v in vars(first).items() if isinstance(v, np.ndarray)]
    return replace(first, **{n: np.concatenate([getattr(p, n) for p in parts]) for n in names})
