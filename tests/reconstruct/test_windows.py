"""Paths seen through windows and into tanks, against an oracle that shoots its rays itself.

Full tables are `benchmarks/refraction.py`; here a sample of each, at seeds fixed before looking.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.stats import chi2

import lightflight as lf
from lightflight.camera.refraction import interface_moved
from tests.oracles.miss import error_and_covariance
from tests.oracles.refracted import (
    RefractedScene,
    in_picture,
    positions_at,
    tank_world,
    window_world,
)
from tests.oracles.refracted_border import histograms, what_the_user_tells
from tests.oracles.refracted_bound import (
    Freedom,
    bound,
    distance_freedom,
    emission_freedom,
    medium_freedom,
)

FALSE_ALARM = 1e-5
"""Chance that a right estimator fails one of the six cells of the first test: 1e-4 over all."""


def off_and_freedom(path: lf.LightPath, scene: RefractedScene) -> tuple[float, int]:
    """Squared distance from the truth by the stated covariance, and its degrees of freedom."""
    off, stated = error_and_covariance(path, np.asarray(scene.vertices_mm, dtype=float))
    return float(off @ np.linalg.solve(stated, off)), len(off)


def stated_rms_mm(path: lf.LightPath, scene: RefractedScene) -> float:
    """Rms of the stated error of the position in view."""
    ends = np.asarray(scene.vertex_times_ps)
    times = np.linspace(ends[0], ends[-1], 1000)
    seen = in_picture(scene, positions_at(scene, times))
    stated = np.trace(path.position_covariance_at(times[seen]), axis1=1, axis2=2)
    return float(np.sqrt(np.nanmean(stated)))


CELLS: dict[str, tuple[RefractedScene, dict[str, Any], Freedom | None]] = {
    "window": (window_world(5.0), {}, None),
    "tank, one leg": (tank_world(1), {"emission_known": False}, emission_freedom()),
    "tank, tilted": (tank_world(3, 5.0), {}, None),
    "index": (tank_world(3), {"index_share": 0.005}, medium_freedom([1], 0.005)),
    "distance": (tank_world(3), {"distance_std_mm": 1.0}, distance_freedom([0, 1], 1.0)),
}


@pytest.mark.parametrize(
    ("method", "cell"),
    [
        *(("joint", cell) for cell in ("tank, one leg", "tank, tilted")),
        *(
            pytest.param("joint", cell, marks=pytest.mark.long)
            for cell in ("window", "index", "distance")
        ),
        ("photon", "tank, one leg"),
    ],
)
def test_paths_are_at_the_bound_and_their_errors_true(method: str, cell: str) -> None:
    """One recording a cell, off by a draw from what is told as uncertain; legs not told."""
    scene, stated, free = CELLS[cell]
    true, seed = scene, 170
    if free is not None and np.isfinite(free.std):
        true = free.changed(scene, np.random.default_rng([seed, 3]).normal(0.0, free.std))
    hist = histograms(true, seed)
    told = what_the_user_tells(scene, hist, **stated)
    path = lf.reconstruct(hist, method=method, **told)
    assert path.n_legs == scene.n_legs
    assert path.verdict.level != "contradicted", path.verdict
    off, freedom = off_and_freedom(path, true)
    low, high = (float(chi2.ppf(p, freedom)) for p in (FALSE_ALARM / 2, 1 - FALSE_ALARM / 2))
    assert low < off < high
    least = bound(scene, also=() if free is None else (free,)).position_rms_mm
    assert stated_rms_mm(path, scene) == pytest.approx(least, rel=0.1)


@pytest.mark.filterwarnings("ignore::lightflight.errors.SuspectDataWarning")
def test_a_window_that_stands_elsewhere_is_named_and_can_be_fitted() -> None:
    scene = replace(tank_world(3), photons=4_000.0)
    hist = histograms(scene, 170)
    told = what_the_user_tells(scene, hist)
    told["camera"] = interface_moved(told["camera"], 0, 3.0)
    path = lf.reconstruct(hist, **told)
    assert path.verdict.level == "contradicted"
    assert "window" in [finding.name for finding in path.verdict.findings]
    assert any(price.startswith("window exact: 1 mm moves") for price in path.prices)
    cured = lf.reconstruct(hist, free=("window",), **told)
    assert cured.verdict.level == "trust"
    off, k = off_and_freedom(cured, scene)
    assert off < chi2.ppf(1 - 1e-4, k)


def told_dry(told: dict[str, Any]) -> dict[str, Any]:
    """The same with air told behind the window, for pulses and for rays."""
    near, far = told["camera"].interfaces
    dry = replace(far, beyond=lf.Material(1.00027, 1.00027))
    camera = replace(told["camera"], interfaces=(near, dry))
    return told | {"camera": camera, "medium": lf.Medium()}


@pytest.mark.usefixtures("as_found")
@pytest.mark.filterwarnings("ignore::lightflight.errors.SuspectDataWarning")
def test_water_told_as_air_is_contradicted() -> None:
    """An index of 1.334 (1.3606 for pulses) behind the window, told as 1.00027."""
    scene = replace(tank_world(1), photons=4_000.0)
    hist = histograms(scene, 171)
    path = lf.reconstruct(hist, **told_dry(what_the_user_tells(scene, hist)))
    assert path.verdict.level == "contradicted"


@pytest.mark.parametrize(("n_legs", "photons"), [(1, 40_000.0), (3, 4_000.0)])
@pytest.mark.long
def test_water_told_as_air_can_be_fitted(n_legs: int, photons: float) -> None:
    scene = replace(tank_world(n_legs), photons=photons)
    hist = histograms(scene, 171)
    told = told_dry(what_the_user_tells(scene, hist))
    cured = lf.reconstruct(hist, free=("index",), **told)
    assert cured.n_legs == n_legs
    assert cured.verdict.level != "contradicted"
    off, k = off_and_freedom(cured, scene)
    assert off < chi2.ppf(1 - 1e-4, k)
