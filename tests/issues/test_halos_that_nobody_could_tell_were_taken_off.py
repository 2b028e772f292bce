"""A clean leg between two rows of pixels had a halo of 0.2 of its light, taken off as if known.

No other pixel counted anything, so nothing told halo from leg: 0.2 +- 0.5 by a weak prior. Lines,
brightness and all counts were measured without it: tips were half as far off again as without,
and a climb ended with a spot of 0.17 px (0.29). An active area of next to nothing, known to its
fourth power, made the error of that path 2,300 km (`benchmarks/steep_tips.py`).
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from lightflight.reconstruct.all_counts import photon
from lightflight.reconstruct.model import light
from lightflight.reconstruct.other_light.strengths import Known
from tests.path_fakes import make_path
from tests.reconstruct.test_tips import scene_of, steep_paths

pytestmark = pytest.mark.usefixtures("unexamined")
HALO = light.WIDE.start


def told(value: np.ndarray, std: np.ndarray) -> np.ndarray:
    """Strengths as they are taken off, of those found with uncorrelated errors."""
    strengths: Any = light.Strengths(value, np.diag(std**2))
    nothing: Any = None
    known = Known(
        strengths, None, nothing, None, nothing, True, 1.0, nothing, nothing
    )  # fmt: skip
    return known.told.value


def errors(halo: float) -> tuple[np.ndarray, np.ndarray]:
    """No strengths, and errors of all: halos to `halo`, all else well."""
    value, std = np.zeros(len(light.LABELS)), np.full(len(light.LABELS), 1e-3)
    std[light.WIDE] = halo
    return value, std


@pytest.mark.parametrize("size", [-0.2, 0.1])
def test_what_priors_alone_hold_is_not_taken_off(size):
    value, std = errors(0.28)
    value[HALO + 2] = size
    assert abs(told(value, std)[HALO + 2]) < 0.2 * abs(size)


@pytest.mark.parametrize(("size", "error"), [(0.05, 2e-3), (0.2, 0.01), (-0.03, 1e-3)])
def test_what_counts_tell_is_taken_off_within_its_error(size, error):
    """One of sixteen that have a prior in common: up to 1.3 of its errors, alone as it is."""
    value, std = errors(error)
    value[HALO + 1] = size
    assert told(value, std)[HALO + 1] == pytest.approx(size, abs=1.5 * error)


def test_of_light_that_is_not_there_less_is_taken_off():
    """200 draws of nothing, each strength known to 0.01: by half of the squares at most."""
    rng = np.random.default_rng(1)
    value, std = errors(0.01)
    squared, whole = [], []
    for _ in range(200):
        value[light.WIDE] = rng.normal(0.0, 0.01, light.WIDE.stop - light.WIDE.start)
        squared.append(np.mean(told(value, std)[light.WIDE] ** 2))
        whole.append(np.mean(value[light.WIDE] ** 2))
    assert np.mean(squared) < 0.5 * np.mean(whole)


@pytest.mark.parametrize("seed", [49, 52])
def test_a_tip_between_two_rows_is_where_it_is(seed):
    """Within three of its stated errors, which are millimetres."""
    (path,) = steep_paths(60.0, "photon", [seed])
    off = path.vertices_mm[-1] - scene_of(60.0).vertices_mm[-1]
    assert path.vertex_std[-1, :3].max() < 3.0
    assert (np.abs(off) < 3.0 * path.vertex_std[-1, :3] + 1e-3).all()


@pytest.mark.parametrize("side", [1e-3, 0.8])
def test_an_area_moves_a_path_by_what_is_known_of_its_fourth_power(side, monkeypatch):
    """Climbs that end 1e-4 mm apart, and 3 mm for an area of one: 0.03 mm for one known to 0.01."""
    path = make_path()
    path = replace(path, covariance_parts={"shared": path.covariance})

    def climbed(*given):
        px = given[-1][0]
        moved = 3.0 * px**4 + 1e-4 * (px > 0.0)
        return replace(path, vertices_mm=path.vertices_mm + moved)

    monkeypatch.setattr(photon, "_climbed", climbed)
    nothing: Any = None
    found = photon.photon_path([], nothing, nothing, std_ps=50.0, areas={0: (side, 0.01)})
    added = np.sqrt(np.diag(found.covariance - path.covariance).reshape(-1, 4)[:, :3])
    assert added == pytest.approx(np.full_like(added, 0.03), rel=0.01)
