"""A second leg of six photons a pixel was no leg: one was found, its end in view, and trusted.

No pixel of it shows a pulse, and no class of pixels is much brighter than chance makes it; all its
pixels together hold 84 photons where 15 are expected. Laboratory 5027 of
`benchmarks/random_labs.py --dim`, at 25 photons in the brightest pixel.
"""

from __future__ import annotations

import importlib
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import lightflight as lf
from benchmarks.random_labs import Lab, drawn_lab, expected_counts, histograms, pulls_of, told_of
from lightflight.path.verdict import Finding, FindingName, Level, Severity, Verdict
from lightflight.reconstruct.verdict import going_on
from lightflight.reconstruct.verdict.judge import CONTRADICTED_AT
from lightflight.units import SPEED_OF_LIGHT_MM_PER_PS
from tests.path_fakes import make_path

pytestmark = pytest.mark.filterwarnings("ignore::lightflight.errors.LightflightWarning")


def dim_lab(second_leg: float) -> Lab:
    """Its second leg `second_leg` times as bright."""
    lab = drawn_lab(5027)
    light = lab.brightness
    return replace(
        lab,
        photons=25.0,
        background=0.1 * lab.background,
        brightness=lambda leg, x: light(leg, x) * (second_leg if leg else 1.0),
    )


def path_of(lab: Lab, **told: Any) -> lf.LightPath:
    counts = np.random.default_rng([8, 5027, 0]).poisson(expected_counts(lab))
    return lf.reconstruct(histograms(lab, counts), **told_of(lab), **told)


@pytest.mark.parametrize("method", ["joint", pytest.param("photon", marks=pytest.mark.long)])
def test_it_is_found_by_all_counts(method):
    """Farthest of four places below 4.5 stated errors (false alarm 1e-4)."""
    lab = dim_lab(1.0)
    path = path_of(lab, method=method)
    assert path.n_legs == 2
    assert path.method == method
    assert path.verdict.level == "trust"
    assert "too dim for pulses" in path.statements[0]
    assert pulls_of(lab, path)[:, 1].max() < 4.5


@pytest.mark.long
def test_told_that_there_is_one_leg_the_recording_says_no():
    path = path_of(dim_lab(1.0), n_legs=1)
    assert path.n_legs == 1
    assert path.verdict.level == "contradicted"
    assert path.verdict.findings[0].name is FindingName.LEG_COUNT
    assert "goes on from where the path ends" in path.verdict.findings[0].sentence


@pytest.mark.long
def test_light_that_ends_in_view_has_ended():
    path = path_of(dim_lab(0.0))
    assert path.n_legs == 1
    assert path.verdict.level == "trust"


@pytest.mark.parametrize("severity", list(Severity))
def test_only_light_that_contradicts_the_end_is_followed(severity, monkeypatch):
    """Legs in doubt have the same name, on paths that not all tests let stand."""
    answer = importlib.import_module("lightflight.reconstruct.answer")
    asked = []
    monkeypatch.setattr(answer, "path_going_on", lambda *told, **_: asked.append(told))
    finding = Finding(FindingName.LEG_COUNT, "", 4.0, "", severity)
    path = make_path(verdict=Verdict(Level.CHECK, (finding,)))
    request = SimpleNamespace(n_legs=None, start=None, setting=None, timing=None)
    assert answer._going_on(path, object(), request, SimpleNamespace(of_fit=True)) is None
    assert bool(asked) == (severity is Severity.CONTRADICTED)


def dark_picture(rng: np.random.Generator, heading: np.ndarray, photons: float) -> Any:
    """Poisson's counts of 32 x 32 pixels, 0.2 a cell, and a flight from the middle among them."""
    camera = lf.Camera.facing_plane((32, 32), distance_mm=500.0, field_of_view_mm=(300.0, 300.0))
    begins, step, lead, n_cells = np.zeros(3), 40.0, 6, 120
    medium = lf.Medium()

    def back_ps(point: np.ndarray) -> float:
        index = medium.return_group_index
        return float(camera.return_times_ps(point[np.newaxis], return_group_index=index)[0])

    arrival = 1000.0 + back_ps(begins)
    mean = np.full((1024, n_cells), 0.2)
    for way in np.linspace(0.0, 140.0, 141):
        at = begins + way * heading
        row, col = (int(np.rint(x[0])) for x in camera.pixels_from_points(at[np.newaxis]))
        come = 1000.0 + way * medium.path_group_index / SPEED_OF_LIGHT_MM_PER_PS
        cell = lead + (come + back_ps(at) - arrival) / step
        # A pulse of two cells' standard deviation.
        light = np.exp(-0.5 * ((np.arange(n_cells) + 0.5 - cell) / 2.0) ** 2)
        mean[32 * row + col] += photons / 141 * light / light.sum()
    expected = np.full_like(mean, 0.2)
    sums = np.zeros((3, 1024, n_cells + 1))
    sums[:, :, 1:] = np.cumsum([rng.poisson(mean), expected, expected], axis=2)
    clock: Any = SimpleNamespace(as_counted=lambda row, col, arrival: arrival)
    place = np.arange(1024).reshape(32, 32)
    return going_on._Dark(
        camera, clock, begins, 1000.0, medium, place, arrival, step, lead, sums
    )  # fmt: skip


def path_to(begins: np.ndarray) -> Any:
    """A leg that ends there, from the left."""
    return SimpleNamespace(vertices_mm=np.array([begins - [100.0, 0.0, 0.0], begins]))


def test_chance_is_no_light():
    """24 pictures: the least chance is below 4e-6, or half of them below 0.05, once in 10,000 times
    at most."""
    rng, chances = np.random.default_rng(61), []
    for _ in range(24):
        dark = dark_picture(rng, np.array([0.0, 1.0, 0.0]), 0.0)
        found = going_on._brightest_flight(dark, path_to(dark.begins_mm))
        assert found is not None
        chances.append(found.p_value)
    assert min(chances) > 4e-6
    assert np.count_nonzero(np.array(chances) < 0.05) < 12


@pytest.mark.parametrize("heading", [(0.3, 0.8, 0.2), (-0.5, -0.6, -0.4)])
def test_the_flight_is_found_as_well_as_a_window_of_time_tells_it(heading):
    """Half a window, 60 ps, is 8 degrees in depth on 140 mm: from there a climb goes on."""
    true = np.array(heading) / np.linalg.norm(heading)
    dark = dark_picture(np.random.default_rng(62), true, 90.0)
    found = going_on._brightest_flight(dark, path_to(dark.begins_mm))
    assert found is not None
    assert found.p_value < CONTRADICTED_AT
    way = found.end_mm - dark.begins_mm
    assert way @ true / np.linalg.norm(way) > np.cos(np.deg2rad(8.0))
