"""Errors that all pixels share: stated alike by every estimator, and by the truth's own scatter."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest
from scipy.stats import chi2

import lightflight as lf
from lightflight.files.store import load_record
from lightflight.reconstruct import FREE_NAMES
from lightflight.reconstruct.model.geometry import PathState
from lightflight.reconstruct.model.setting import Setting
from lightflight.reconstruct.model.shared import moved, shared_errors, vertex_time_columns
from lightflight.reconstruct.model.sizes import PLAUSIBLE
from lightflight.timing.clock.calibration import TimingCalibration
from lightflight.timing.clock.shared_modes import with_shared_errors
from tests.oracles.worlds.border import histograms, record, what_the_user_tells
from tests.oracles.worlds.clock import BACKWARDS, PERFECT
from tests.oracles.worlds.random_worlds import random_world
from tests.oracles.worlds.world import HONEST, KNOWN, World

CAMERA = lf.Camera.facing_plane(
    position_std_mm=0.5, rotation_std_deg=0.1, field_of_view_std_mm=0.5, distortion_std=5e-3
)
SOURCE = lf.Source((0.0, 0.0, 0.0), emission_time_ps=0.0)
FALSE_ALARM = 1e-4


def setting(camera: lf.Camera = CAMERA, **indices: float) -> Setting:
    return Setting(camera, SOURCE, lf.Medium(**indices))


# --- the records ---------------------------------------------------------------------------------


def test_what_is_exact_has_no_error_and_stays_as_told():
    told = setting(lf.Camera.facing_plane())
    errors = shared_errors(told)
    assert len(errors) == 0
    assert moved(told, errors, np.zeros(0)) is told


def test_each_record_states_its_own():
    errors = shared_errors(setting(path_group_index_std=1e-4, return_group_index_std=1e-4))
    assert errors.names == ("pose",) * 6 + ("focal_length", "distortion", "index")
    sizes = np.sort(np.linalg.norm(errors.sigma[:6, :6], axis=1))
    np.testing.assert_allclose(sizes, [np.radians(0.1)] * 3 + [0.5] * 3)  # told in deg and mm
    wide = moved(setting(), errors, np.eye(9)[6] * 2.0)
    assert wide.camera.matrix[0, 0] == pytest.approx(CAMERA.matrix[0, 0] * (1 + 2 * 0.5 / 245.0))
    bent = moved(setting(), errors, np.eye(9)[7])
    assert bent.camera.distortion[0] == pytest.approx(5e-3)
    slower = moved(setting(), errors, -np.eye(9)[8]).medium
    assert slower.path_group_index == slower.return_group_index == pytest.approx(1.00017)
    np.testing.assert_allclose(
        errors.sigma[:6, :6].T @ errors.sigma[:6, :6], CAMERA.pose_covariance, atol=1e-15
    )


def test_a_slower_medium_makes_later_corners():
    errors = shared_errors(setting(path_group_index_std=1e-4, return_group_index_std=1e-4))
    state = PathState(np.array([[0.0, 0, 0], [300.0, 40, 0], [20.0, 80, 30]]), 100.0)
    before, after = (
        state.vertex_times_ps(moved(setting(), errors, delta).medium)
        for delta in (np.zeros(9), np.eye(9)[8])
    )
    columns = vertex_time_columns(errors, state).reshape(3, 4, 9)
    np.testing.assert_allclose(columns[:, 3, 8], after - before, atol=1e-9)
    assert columns[2, 3, 8] > 0.1
    assert np.count_nonzero(columns) == 2


@pytest.mark.parametrize("out", [2e-4, 0.0])
@pytest.mark.parametrize("along", [1.0, 0.0, 0.3])
def test_indices_go_along_as_stated(out, along):
    back = 1e-4
    exact = lf.Camera.facing_plane()
    told = setting(
        exact, path_group_index_std=out, return_group_index_std=back, index_correlation=along
    )
    pairs = shared_errors(told).sigma[:, :2]
    crossed = along * out * back
    np.testing.assert_allclose(pairs.T @ pairs, [[out**2, crossed], [crossed, back**2]], atol=1e-20)


@pytest.mark.parametrize("name", ["path_group_index_std", "return_group_index_std"])
def test_errors_below_zero_are_refused(name):
    with pytest.raises(ValueError, match=name):
        lf.Medium(**{name: -1e-4})
    with pytest.raises(ValueError, match="focal_std_fraction"):
        replace(CAMERA, focal_std_fraction=-1.0)
    with pytest.raises(ValueError, match="not negative"):
        lf.Camera.facing_plane(position_std_mm=-1.0)


@pytest.mark.parametrize("clock", [PERFECT, BACKWARDS], ids=["forwards", "backwards"])
def test_a_warm_clock_is_off_by_what_it_counted(clock):
    """The oracle's codes, longer by a share, against the column of that share."""
    empty = histograms(np.zeros((1, 1, clock.n_codes), dtype=np.uint32), clock)
    plain = TimingCalibration.nominal(empty)
    warm = with_shared_errors(plain, offset_std_ps=5.0, scale_std=1e-4, drift_std_ps=2.0)
    code = 500
    middle, longer = (
        float(np.mean([edges[0, code] for edges in clock.intervals(scale)])) for scale in (0, 1e-4)
    )
    _, modes, names = warm.arrival_errors_ps([0], [0], [middle])
    assert names == ("clock offset", "clock drift", "code length")
    np.testing.assert_allclose(modes[0], [5.0, 2.0, abs(longer - middle)], rtol=1e-3)


def test_a_path_file_keeps_them_and_older_versions_read_the_rest(tmp_path):
    path = freed_path()
    path.save(tmp_path / "path.h5")
    same = lf.LightPath.load(tmp_path / "path.h5")
    assert same.medium == path.medium
    assert same.medium.path_group_index_std > 0
    assert same.camera.focal_std_fraction == path.camera.focal_std_fraction > 0
    assert same.prices == path.prices != ()
    attributes = load_record(tmp_path / "path.h5", kind="path")[1]
    assert set(attributes["medium"]) == {"path_group_index", "return_group_index"}


# --- closed form ---------------------------------------------------------------------------------


def test_a_camera_a_little_off_turns_the_leg_by_the_half_angle_law():
    """At fixed rays a camera nearer by dp and a leg turned by da shift arrival times by
    (tan psi + sec psi) dp and -L (tan psi + sec psi) da: 0.28 degrees per mm."""
    vertices = np.array([[-150.0, 3.828125, 0.0], [150.0, 3.828125, 0.0]])
    leg = _Subject(vertices, lf.Camera.facing_plane(), lf.Source(vertices[0], emission_time_ps=0.0))
    tan = (np.arange(32) - 15.5) * 245.0 / 32 / 535.0
    column = tan + np.sqrt(1 + tan**2)
    by_angle, by_distance = (150.0 + 535.0 * tan) * column, column
    price = (by_angle @ by_distance) / (by_angle @ by_angle)
    assert np.degrees(price) == pytest.approx(0.28, abs=0.015)

    light: dict[str, Any] = {"photons_per_pixel": 4000.0, "background_per_code": 1e-6}
    exact = lf.bounds(leg, **light).angle_std_deg[0]
    std_mm = 0.3
    unsure = lf.Camera.facing_plane(position_std_mm=(0.0, 0.0, std_mm))
    found = lf.bounds(leg, camera=unsure, **light).angle_std_deg[0]
    # Two unknowns, one of them with a prior: what the times say of both.
    noise = np.radians(exact) ** 2 * (by_angle @ by_angle)
    both = np.column_stack((by_angle, by_distance))
    information = both.T @ both / noise + np.diag([0.0, std_mm**-2])
    expected = np.degrees(np.sqrt(np.linalg.inv(information)[0, 0]))
    assert found == pytest.approx(expected, rel=0.03)
    assert found > 2 * exact


class _Subject:
    """What `bounds` asks of a scene."""

    def __init__(self, vertices_mm: np.ndarray, camera: lf.Camera, source: lf.Source) -> None:
        self.vertices_mm, self.camera, self.source = vertices_mm, camera, source


# --- the oracle's recordings ---------------------------------------------------------------------


@cache
def reconstructed(seed: int, method: str, n_legs: int = 3) -> tuple[World, lf.LightPath]:
    world = random_world(seed, n_legs, prior=HONEST, uneven=0.0)
    told = what_the_user_tells(world) | {"n_legs": n_legs}
    return world, lf.reconstruct(record(world, seed), method=method, **told)


def corners(values: np.ndarray) -> np.ndarray:
    """x, y, z of the corners, of (4m,) or (4m, 4m)."""
    m = len(values) // 4
    own = np.flatnonzero((np.arange(4 * m) % 4 < 3) & (np.arange(4 * m) // 4 % (m - 1) > 0))
    return values[own] if values.ndim == 1 else values[np.ix_(own, own)]


def squared_pull(world: World, path: lf.LightPath) -> tuple[float, int]:
    """Of all corners together, and its degrees of freedom."""
    gap = np.column_stack((path.vertices_mm - world.vertices, np.zeros(len(world.vertices))))
    off, covariance = corners(gap.ravel()), corners(path.covariance)
    return float(off @ np.linalg.solve(covariance, off)), len(off)


@pytest.mark.parametrize(
    ("method", "seeds"),
    [("joint", 1), pytest.param("joint", 2, marks=pytest.mark.long), ("photon", 1)],
)
def test_errors_drawn_from_what_is_told_are_the_errors_stated(method, seeds):
    """Pose, focal length, distortion, index, offset and code length of the oracle; 1,000 of them:
    benchmarks/shared_errors.py. Right code fails once in ten thousand draws of these seeds."""
    found = np.array([squared_pull(*reconstructed(seed, method)) for seed in range(seeds)])
    total, dof = found[:, 0].sum(), found[:, 1].sum()
    assert FALSE_ALARM / 2 < chi2.cdf(total, dof) < 1 - FALSE_ALARM / 2


def test_joint_photon_and_the_bound_state_the_same():
    world, joint = reconstructed(0, "joint")
    _, photon = reconstructed(0, "photon")
    told = what_the_user_tells(world)
    subject = _Subject(world.vertices, told["camera"], told["source"])
    bound = lf.bounds(
        subject, medium=told["medium"], timing=told["timing"], pulse_std_ps=world.std_ps,
        spot_std_px=float(np.hypot(world.spot_std_px, world.active_side_px / np.sqrt(12))),
    )  # fmt: skip
    stds = [np.sqrt(np.diag(corners(p.covariance))) for p in (joint, photon, bound.path)]
    np.testing.assert_allclose(stds[0], stds[1], rtol=0.1)
    np.testing.assert_allclose(stds[2], stds[1], rtol=0.1)
    # The camera's own errors: without them all state a twentieth of that.
    exact = lf.bounds(_Subject(world.vertices, lf.Camera(
        told["camera"].matrix, told["camera"].distortion, told["camera"].world_from_camera,
        told["camera"].shape), told["source"]))  # fmt: skip
    assert np.max(stds[1] / np.sqrt(np.diag(corners(exact.path.covariance)))) > 10


@cache
def freed_path() -> lf.LightPath:
    """A camera told with a focal length 2 % too short, and freed of it."""
    world = random_world(0, 3, prior=KNOWN, uneven=0.0)
    told = what_the_user_tells(world) | {"n_legs": 3}
    short = told["camera"].with_lens_moved(focal_share=-0.02)
    wrong = told | {"camera": short}
    return lf.reconstruct(record(world, 0), free=("focal_length", "index"), **wrong)


def test_what_is_freed_is_found():
    world, path = random_world(0, 3, prior=KNOWN, uneven=0.0), freed_path()
    total, dof = squared_pull(world, path)
    assert total < chi2.ppf(1 - FALSE_ALARM, dof)
    assert path.camera.matrix[1, 1] == pytest.approx(world.view.focal_px[0], rel=2e-3)


def test_only_what_has_a_plausible_size_is_freed():
    # A bend's is that of a curved leg, the emission time's that of the source's.
    sizes = {kind.split()[0] for kind in PLAUSIBLE} | {"emission_time", "bend"}
    assert set(FREE_NAMES) <= sizes
    world = random_world(0, 1, prior=KNOWN)
    with pytest.raises(ValueError, match="'weather' is none of source, "):
        lf.reconstruct(record(world, 0), free=("weather",), **what_the_user_tells(world))


@pytest.mark.usefixtures("unexamined")
@pytest.mark.parametrize("seed", [pytest.param(0, marks=pytest.mark.long), 3])
def test_a_price_is_what_the_path_pays(seed):
    """The source told 1 mm off in the direction that is said to be the dearest: so much that the
    fit no longer believes its times, which costs up to four times what small errors promise."""
    world = random_world(seed, 3, prior=KNOWN, uneven=0.0)
    told, recording = what_the_user_tells(world) | {"n_legs": 3}, record(world, seed)
    path = lf.reconstruct(recording, **told)
    words = next(line for line in path.prices if line.startswith("source exact: 1 mm in "))
    axis, corner = "xyz".index(words.split()[5]), int(words.split()[8])
    off = replace(told["source"], position_mm=world.vertices[0] + np.eye(3)[axis])
    moved_path = lf.reconstruct(recording, **told | {"source": off})
    paid = np.linalg.norm((moved_path.vertices_mm - path.vertices_mm)[corner])
    assert paid == pytest.approx(float(words.split()[10]), rel=0.1)


@pytest.mark.usefixtures("unexamined")
def test_the_papers_chain_follows_its_camera():
    """Its shared part against the chain run again with the camera at another place."""
    world = random_world(0, 1, prior=KNOWN, uneven=0.0)
    told, recording = what_the_user_tells(world) | {"n_legs": 1}, record(world, 0)
    unsure = replace(told["camera"], pose_covariance=np.diag([0, 0, 0, 0, 0, 0.01]))
    path = lf.reconstruct(recording, method="paper", **told | {"camera": unsure})
    there = told["camera"].perturbed([0, 0, 0, 0, 0, 0.1])
    other = lf.reconstruct(recording, method="paper", **told | {"camera": there})
    std = np.sqrt(np.diag(path.covariance_parts["shared"])).reshape(-1, 4)[:, :3]
    np.testing.assert_allclose(std, np.abs(other.vertices_mm - path.vertices_mm), rtol=0.02)
    assert (path.covariance_parts["shared"] != 0).any()


@pytest.mark.usefixtures("unexamined")
def test_the_papers_chain_follows_its_clock():
    """Its shared part against the chain run again on a clock whose zero lies elsewhere."""
    world = random_world(0, 1, prior=KNOWN, uneven=0.0)
    told, recording = what_the_user_tells(world) | {"n_legs": 1}, record(world, 0)
    unsure = with_shared_errors(told["timing"], offset_std_ps=1.0)
    path = lf.reconstruct(recording, method="paper", **told | {"timing": unsure})
    later = replace(told["timing"], skew_ps=told["timing"].skew_ps + 1.0)
    other = lf.reconstruct(recording, method="paper", **told | {"timing": later})
    std = np.sqrt(np.diag(path.covariance_parts["shared"])).reshape(-1, 4)[:, :3]
    np.testing.assert_allclose(std, np.abs(other.vertices_mm - path.vertices_mm), rtol=0.02)
    assert (path.covariance_parts["shared"] != 0).any()
