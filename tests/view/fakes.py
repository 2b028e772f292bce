"""Small records with known numbers, for tests of pictures (no fit, no simulation)."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np

from lightflight.camera.model import Camera
from lightflight.flight import Medium, Source, event_times_from_vertices
from lightflight.path.light_path import LightPath
from lightflight.path.tables import RESIDUAL_DTYPE, Goodness

VERTICES_MM = np.array([(0, 0, 0), (375, 25, 50), (0, 50, 10), (375, 75, 50)], dtype=float)
EMISSION_PS = 2000.0


def paper_camera() -> Camera:
    """The paper's camera: 32 x 32, 535 mm away, 245 mm field."""
    return Camera.facing_plane(center_mm=(187.5, 37.5))


def truth_record() -> Any:
    """The paper's three legs, exactly."""
    times = event_times_from_vertices(VERTICES_MM, emission_time_ps=EMISSION_PS)
    return SimpleNamespace(vertices_mm=VERTICES_MM, vertex_times_ps=times)


def residual_table(path_like: Any, camera: Camera, *, seed: int, std_ps: float = 0.6) -> Any:
    """One pulse per pixel and leg that the camera sees, with noise of the stated size."""
    rng = np.random.default_rng(seed)
    vertices, times = path_like.vertices_mm, path_like.vertex_times_ps
    rows = []
    for leg in range(len(times) - 1):
        f = np.linspace(0, 1, 4001)
        points = vertices[leg] + f[:, None] * (vertices[leg + 1] - vertices[leg])
        event = times[leg] + f * (times[leg + 1] - times[leg])
        seen = camera.sees(points)
        pixels = np.rint(np.stack(camera.pixels_from_points(points[seen]), axis=1)).astype(int)
        n = Medium().return_group_index
        back = np.linalg.norm(points[seen] - camera.center_mm, axis=1) * n / 0.299792458
        for row, col in np.unique(pixels, axis=0):
            inside = (pixels == (row, col)).all(axis=1)
            if inside.sum() < 20:
                continue
            model = float(np.mean((event[seen] + back)[inside]))
            when = float(np.mean(event[seen][inside]))
            std = std_ps * rng.uniform(0.7, 1.6)
            noise = rng.normal() * std
            rows.append((row, col, leg, model + noise, model, noise, std, when, 4e4, True, 0))
    table = np.array(rows, dtype=RESIDUAL_DTYPE)
    table["used"][5] = False
    table["residual_ps"][5] += 9.0
    table["arrival_ps"][5] += 9.0
    return table


def fake_path(*, seed: int = 1, error_mm: float = 0.08, residuals: bool = True) -> LightPath:
    """A path a little off the truth, with a covariance of that size."""
    rng = np.random.default_rng(seed)
    camera, truth = paper_camera(), truth_record()
    m = len(truth.vertex_times_ps)
    mixing = rng.normal(size=(4 * m, 4 * m)) * 0.15 + np.eye(4 * m)
    size = np.tile([0.3, 0.3, 1.0, 3.0], m) * error_mm
    covariance = (mixing * size) @ (mixing * size).T
    covariance = size[:, None] * (mixing @ mixing.T) * size
    offset = rng.multivariate_normal(np.zeros(4 * m), covariance).reshape(m, 4)
    table = residual_table(truth, camera, seed=seed) if residuals else np.empty(0, RESIDUAL_DTYPE)
    return LightPath(
        VERTICES_MM + offset[:, :3],
        truth.vertex_times_ps + offset[:, 3],
        covariance,
        camera=camera,
        source=Source((0.0, 0.0, 0.0), pulse_fwhm_ps=68.0),
        goodness=Goodness(101.3, 96, int(table["used"].sum()), 1, 0.7, 0.0, True),
        residuals=table,
        prior="source known, emission time fitted",
        statements=("The emission time was fitted.",),
        truth=truth,
        provenance={"version": "0.0", "seed": seed},
    )


def fake_arrivals(path: LightPath) -> Any:
    """The arrivals a path's residuals came from, with silent pixels and two left out."""
    from lightflight import flags as fl

    table, shape = path.residuals, path.camera.shape
    taken = {(int(r), int(c)) for r, c in zip(table["row"], table["col"], strict=True)}
    rest = [(r, c) for r in range(shape[0]) for c in range(shape[1]) if (r, c) not in taken]
    words = np.full(len(rest), fl.NO_PULSE, dtype=np.uint32)
    words[40], words[300] = fl.SCREAMING, fl.TOO_WIDE
    extra = np.array(rest)
    nan = np.full(len(rest), np.nan)
    return SimpleNamespace(
        row=np.concatenate((table["row"], extra[:, 0])),
        col=np.concatenate((table["col"], extra[:, 1])),
        arrival_ps=np.concatenate((table["arrival_ps"], nan)),
        std_ps=np.concatenate((np.full(len(table), 72.0), nan)),
        photons=np.concatenate((table["photons"], nan)),
        flags=np.concatenate((table["flags"], words)),
        shape=shape,
        laser_period_ps=50_000.0,
    )


def fake_pulses(row: Any, col: Any, delay_ps: Any, *, std_ps: float, photons: float) -> Any:
    """Fitted pulses as `fit_pulses` tables them, with the given truth as their values."""
    n = len(delay_ps)
    covariance = np.zeros((n, 4, 4))
    covariance[:, 0, 0] = std_ps**2 / photons
    return SimpleNamespace(
        row=np.asarray(row),
        col=np.asarray(col),
        delay_ps=np.asarray(delay_ps, dtype=float),
        std_ps=np.full(n, std_ps),
        photons=np.full(n, photons),
        shape=(32, 32),
        background_per_ps=np.full(n, 0.004),
        covariance=covariance,
        flags=np.zeros(n, dtype=np.uint32),
        method="likelihood",
    )
