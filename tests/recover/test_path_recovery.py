"""Simulate, reconstruct, compare: errors as small as promised, and stated errors that are true.

Recordings come from the twin (photon by photon) where its clock matters and where many are not
needed; pulls over hundreds of recordings use the brute-force oracle's expected counts.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache

import numpy as np
import pytest

import lightflight as lf
from lightflight.demo import EVENT_TIME_RMS_PS, POSITION_RMS_MM
from lightflight.reconstruct.limits.bounds import bounds
from lightflight.simulate.presets import angle_scene, ideal, paper_scene, pf32
from studies.zheng2020.reported import MEAN_ANGLE_ERROR_DEG
from tests.labs import START_PS, Lab, one_leg, three_legs

# Of hundreds of undisturbed recordings one in 100 is to be checked, one in 10,000 contradicted.
pytestmark = [
    pytest.mark.filterwarnings("ignore:check this path before you rely on it"),
    pytest.mark.filterwarnings("ignore:the recording contradicts"),
]

RUNS = 20
"""Recordings per pull; full tables: benchmarks/accuracy_path.py. The spread of a pull is known to
1 / sqrt(2 x 20) = 15.8 %, its mean to 22.4 %. Seeds are fixed, so chance has been at play once,
when they were chosen: bounds are three such errors, which one in ten draws of the some 40 numbers
here would break. Errors that are stated 30 % too small break them at these seeds, too:
`Pulls.check` asks for it each time."""


@dataclass(frozen=True)
class Pulls:
    """(found - true) / stated error, one row per recording."""

    angles: np.ndarray
    vertices: np.ndarray
    times: np.ndarray

    def check(self):
        n, worst = len(self.angles), 0.0
        of_width, of_mean = 3.0 / np.sqrt(2 * n), 3.0 / np.sqrt(n)
        for name in ("angles", "vertices", "times"):
            values = getattr(self, name)
            if not values.size:
                continue
            width = np.sqrt(np.mean(values**2, axis=0))
            assert np.abs(width - 1.0).max() < of_width, (name, width)
            assert np.abs(values.mean(axis=0)).max() < of_mean, (name, values.mean(axis=0))
            worst = max(worst, width.max())
        assert worst / 0.7 > 1.0 + of_width, "errors stated 30 % too small would pass"


def whitened(offset: np.ndarray, covariance: np.ndarray) -> np.ndarray:
    """Offsets along the covariance's own directions, in its errors; directions without error
    (a source that is known, an end that keeps to its plane) are left out."""
    values, vectors = np.linalg.eigh(covariance)
    firm = values > 1e-6 * values.max()
    return (offset @ vectors[:, firm]) / np.sqrt(values[firm])


def elevations(vertices: np.ndarray) -> np.ndarray:
    step = np.diff(vertices, axis=0)
    return np.rad2deg(np.arcsin(step[:, 2] / np.linalg.norm(step, axis=1)))


def pulls_of(paths: list[lf.LightPath], vertices: np.ndarray, times: np.ndarray) -> Pulls:
    angles = [
        [(leg.angle_deg - true) / leg.angle_std_deg
         for leg, true in zip(path.legs, elevations(vertices), strict=True)]
        for path in paths
    ]  # fmt: skip
    corners, moments = [], []
    for path in paths:
        row: list[float] = []
        for k in range(1, len(vertices) - 1):
            block = slice(4 * k, 4 * k + 3)
            row.extend(whitened(path.vertices_mm[k] - vertices[k], path.covariance[block, block]))
        # The end slides along its leg by definition of the view: what is compared is the leg's
        # distance from the true line there, in the two directions across it.
        row.extend(end_pulls(path, vertices))
        corners.append(row)
        std = path.vertex_std[:-1, 3]
        known = std > 1e-9
        moments.append(((path.vertex_times_ps - times)[:-1][known]) / std[known])
    return Pulls(np.array(angles), np.array(corners), np.array(moments))


def end_pulls(path: lf.LightPath, vertices: np.ndarray) -> np.ndarray:
    direction = vertices[-1] - vertices[-2]
    direction = direction / np.linalg.norm(direction)
    across = np.linalg.svd(direction[np.newaxis])[2][1:]
    offset = across @ (path.vertices_mm[-1] - vertices[-2])
    covariance = across @ path.covariance[-4:-1, -4:-1] @ across.T
    return whitened(offset, covariance)


@pytest.fixture(scope="module")
def recordings():
    return [
        lf.simulate(TestPullsOnTheTwin.scene, photons_per_pixel=4000.0, seed=seed, threads=1)
        for seed in range(RUNS)
    ]


def path_of_three_legs(seed):
    lab = three_legs()
    return lf.reconstruct(
        lab.recording(seed, 4000.0), camera=lab.camera, source=lab.timed, timing=lab.timing
    )


def test_a_verdict_changes_neither_path_nor_errors(request, nothing_twice):
    examined = path_of_three_legs(0)
    request.getfixturevalue("unexamined")
    path = path_of_three_legs(0)
    assert path.verdict.level != examined.verdict.level
    np.testing.assert_array_equal(path.vertices_mm, examined.vertices_mm)
    np.testing.assert_array_equal(path.vertex_times_ps, examined.vertex_times_ps)
    np.testing.assert_array_equal(path.covariance, examined.covariance)


@pytest.mark.usefixtures("unexamined", "nothing_twice")
class TestPullsOnTheTwin:
    """One leg, 4,000 photons in the brightest pixel, drawn photon by photon."""

    scene = angle_scene(5.0, ideal(n_codes=128), height_mm=3.0, background=20.0)

    def reconstructed(self, recordings, timing_of, emission_time_ps):
        source = lf.Source(self.scene.vertices_mm[0], emission_time_ps=emission_time_ps)
        return [
            lf.reconstruct(hist, camera=self.scene.camera, source=source, timing=timing_of(hist))
            for hist in recordings
        ]

    def test_perfect_clock(self, recordings):
        """The emission time is fitted; the next test knows it, as one of the oracle's does."""
        paths = self.reconstructed(recordings, lf.TimingCalibration.nominal, None)
        assert all(path.n_legs == 1 for path in paths)
        pulls_of(paths, np.array(self.scene.vertices_mm), self.scene.vertex_times_ps).check()
        chi2 = np.mean([path.goodness.reduced_chi2 for path in paths])
        dof = paths[0].goodness.dof
        assert chi2 == pytest.approx(1.0, abs=5.6 * np.sqrt(2 / dof / RUNS) + 0.03)

    @pytest.mark.long
    def test_clock_that_is_wrong_by_as_much_as_it_says(self, recordings):
        """Every pixel's delay off by 2 ps rms, anew for every recording."""
        rng = np.random.default_rng(11)

        def timing_of(hist):
            true = lf.TimingCalibration.nominal(hist)
            return replace(
                true,
                skew_ps=2.0 * rng.normal(size=hist.shape),
                skew_std_ps=np.full(hist.shape, 2.0),
            )

        paths = self.reconstructed(recordings, timing_of, self.scene.emission_time_ps)
        pulls_of(paths, np.array(self.scene.vertices_mm), self.scene.vertex_times_ps).check()
        pixel = np.mean([p.covariance_parts["pixel"].trace() for p in paths])
        assert pixel > 0.3 * np.mean([p.covariance.trace() for p in paths])


@pytest.mark.usefixtures("unexamined", "nothing_twice")
class TestPullsOnTheOracle:
    """The same lab drawn by another hand: a shared sign or factor cannot cancel."""

    def paths(self, lab: Lab, photons: float, source: lf.Source, timing_of=None, seeds=range(RUNS)):
        rng = np.random.default_rng(5)
        return [
            lf.reconstruct(
                lab.recording(seed, photons),
                camera=lab.camera,
                source=source,
                timing=lab.timing if timing_of is None else timing_of(rng),
            )
            for seed in seeds
        ]

    def test_bright_leg_reaches_the_bound(self):
        """28 recordings: errors are stated as large as the bound, which leaves nothing to chance,
        and the error itself is as large, to 13.4 % of chance."""
        lab = one_leg()
        paths = self.paths(lab, 40_000.0, lab.known, seeds=range(100, 128))
        pulls_of(paths, lab.vertices_mm, lab.truth.vertex_times_ps).check()
        error = np.sqrt(np.mean([(p.legs[0].angle_deg - 5.0) ** 2 for p in paths]))
        bound = bounds(
            paths[0],
            source=lab.known,
            photons_per_pixel=40_000.0,
            pulse_std_ps=70.0,
            background_per_code=lab.background_per_code,
        )
        stated = np.mean([p.legs[0].angle_std_deg for p in paths])
        assert stated == pytest.approx(bound.angle_std_deg[0], rel=0.05)
        # 13.4 % of chance, twice, about 1; the seeds are fixed.
        assert 0.73 < error / bound.angle_std_deg[0] < 1.27

    @pytest.mark.long
    def test_shared_scale_error(self):
        """0.5 % of the clock's scale per sigma, drawn anew for every recording."""
        lab = one_leg()
        paths = self.paths(
            lab, 4000.0, lab.known, lambda rng: lab.doubtful_timing(rng, scale_std=0.005)
        )
        pulls_of(paths, lab.vertices_mm, lab.truth.vertex_times_ps).check()

    @pytest.mark.long
    def test_three_legs_emission_time_fitted(self):
        lab = three_legs()
        paths = self.paths(lab, 4000.0, lab.timed)
        assert sum(path.n_legs == 3 for path in paths) == RUNS
        pulls = pulls_of(paths, lab.vertices_mm, lab.truth.vertex_times_ps)
        assert pulls.vertices.shape[1] >= 6
        pulls.check()


@pytest.mark.usefixtures("unexamined", "nothing_twice")
class TestAccuracyOfTheFirstIssue:
    """Clock defects on and calibrated; the camera of the demo. Asserted at fixed seeds."""

    @pytest.mark.parametrize("timed", [True, False])
    def test_three_legs(self, timed):
        """joint, source known: 0.4 mm and 1.2 ps rms in view (the paper: 1.75 mm, 3.84 ps)."""
        scene = paper_scene(pf32(seed=0))
        source = lf.Source(
            scene.vertices_mm[0], emission_time_ps=scene.emission_time_ps if timed else None
        )
        timing = _timing_of_the_demo()
        hist = lf.simulate(scene, photons_per_pixel=40_000.0, seed=1)
        path = lf.reconstruct(hist, camera=scene.camera, source=source, timing=timing)
        error = lf.path_error(path, hist.truth, scene.camera)
        assert path.n_legs == 3
        assert error.position_rms_mm <= 0.4
        assert error.event_time_rms_ps <= 1.2
        assert error.position_rms_mm < POSITION_RMS_MM
        assert error.event_time_rms_ps < EVENT_TIME_RMS_PS

    def test_one_leg(self):
        """Mean |d alpha| <= 0.03 deg from -10 to 10 deg (the paper: 0.15); the paper's own
        estimator beside it."""
        timing = _timing_of_the_demo()
        ours: list[float] = []
        papers: list[float] = []
        for k, angle in enumerate(np.linspace(-10, 10, 3)):
            scene = angle_scene(float(angle), pf32(seed=0))
            source = lf.Source(scene.vertices_mm[0], emission_time_ps=scene.emission_time_ps)
            hist = lf.simulate(scene, photons_per_pixel=40_000.0, seed=200 + k)
            for method, errors in (("joint", ours), ("paper", papers)):
                path = lf.reconstruct(
                    hist, camera=scene.camera, source=source, timing=timing, method=method
                )
                errors.append(abs(path.legs[0].angle_deg - angle))
        assert np.mean(ours) <= 0.03
        assert np.max(ours) <= 0.05
        assert np.mean(ours) < np.mean(papers)
        assert np.mean(ours) < MEAN_ANGLE_ERROR_DEG / 5


@cache
def _timing_of_the_demo() -> lf.TimingCalibration:
    """The clock of pf32(seed=0), from its code density and a flat; once for all tests."""
    scene = paper_scene(pf32(seed=0))
    density = lf.simulate(scene, photons_per_pixel=4e6, seed=100, kind="code_density")
    flat = lf.simulate(scene, photons_per_pixel=4e5, seed=101, kind="flat")
    return lf.calibrate_timing(
        density, flat=flat, flat_arrival_ps=flat.truth.flat_arrival_ps, dead_codes="absorbed"
    )


def test_emission_time_of_the_labs_is_the_truths():
    assert one_leg().truth.vertex_times_ps[0] == START_PS
