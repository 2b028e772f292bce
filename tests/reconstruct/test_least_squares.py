"""The weighted fit on times made by hand: exact without noise, and honest with it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from lightflight.camera.model import Camera
from lightflight.errors import NothingFoundError
from lightflight.flight import Medium, Source
from lightflight.reconstruct.fit.ends import freedom_at
from lightflight.reconstruct.fit.least_squares import Solution, TimeData, fit_path, reweighted
from lightflight.reconstruct.model.freedom import Freedom, freedom_of_path
from lightflight.reconstruct.model.geometry import PathState, footprints, overshoots
from lightflight.reconstruct.model.image_plane import mean_focal_px
from lightflight.reconstruct.model.picture import LineDataInPicture
from lightflight.reconstruct.model.setting import Setting
from tests.path_fakes import PAPER_VERTICES
from tests.reconstruct.fakes import PAPER, camera_like, path_in_view

AIR = Medium()
TRUE = PathState(PAPER_VERTICES, 2000.0)
KNOWN = Source(PAPER_VERTICES[0], emission_time_ps=2000.0)
NO_TIME = Source(PAPER_VERTICES[0])


def times_of(
    state: PathState, camera: Camera, *, medium: Medium = AIR, std: float = 1.0
) -> TimeData:
    """Exact arrival times of pixels (fractional) along each leg, 24 per leg."""
    legs, rows, cols = [], [], []
    for k in range(state.n_legs):
        f = np.linspace(0, 1, 2001)[:, np.newaxis]
        points = (1 - f) * state.vertices_mm[k] + f * state.vertices_mm[k + 1]
        points = points[camera.sees(points)]
        row, col = camera.pixels_from_points(
            points[np.linspace(0, len(points) - 1, 24).astype(int)]
        )
        legs.append(np.full(24, k))
        rows.append(row)
        cols.append(col)
    leg, row, col = (np.concatenate(x) for x in (legs, rows, cols))
    exact = footprints(state, camera=camera, medium=medium, legs=leg, rows=row, cols=col).arrival_ps
    n = len(leg)
    return TimeData(
        leg=leg,
        row=row,
        col=col,
        arrival_ps=exact,
        footprint_ps=np.zeros(n),
        photon_var=np.full(n, std**2),
        pixel_var=np.zeros(n),
        modes_ps=np.zeros((n, 0)),
        weight=np.ones(n),
        index=np.arange(n),
        view=np.zeros(n, dtype=int),
    )


def lines_of(state: PathState, camera: Camera, *, std_px: float = 0.005) -> LineDataInPicture:
    """The legs' exact images by two points each."""
    focal = mean_focal_px(camera)
    inside = (state.vertices_mm - camera.center_mm) @ camera.world_from_camera[:3, :3]
    image = focal * inside[:, :2] / inside[:, 2:]
    anchors = [
        image[k] + share * (image[k + 1] - image[k])
        for k in range(state.n_legs)
        for share in (0.3, 0.7)
    ]
    return LineDataInPicture(
        np.repeat(np.arange(state.n_legs), 2),
        np.array(anchors),
        np.eye(2 * state.n_legs) / std_px,
        np.zeros(2 * state.n_legs, dtype=int),
    )


def noisy(times: TimeData, lines: LineDataInPicture, rng) -> tuple[TimeData, LineDataInPicture]:
    """Times and anchors moved by as much as their errors say."""
    std_px = 1.0 / lines.whitening[0, 0]
    moved = times.arrival_ps + np.sqrt(times.photon_var + times.pixel_var) * rng.normal(
        size=len(times.leg)
    )
    anchors = lines.anchors + std_px * rng.normal(size=lines.anchors.shape)
    return replace(times, arrival_ps=moved), replace(lines, anchors=anchors)


def freedom_for(source: Source, state: PathState = TRUE, camera: Camera = PAPER) -> Freedom:
    return freedom_at(state, Setting(camera, source, AIR))


def solved(times, lines, freedom, *, start=TRUE, camera=PAPER, medium=AIR, floor=0.0) -> Solution:
    setting = Setting(camera, Source(), medium)
    return fit_path(start, times, lines, freedom, setting, floor_var=floor)


def test_a_start_that_is_no_path_is_refused(capfd):
    """A leg without length has no direction; LAPACK wrote of illegal values to the terminal."""
    vertices = PAPER_VERTICES.copy()
    vertices[2] = vertices[1]
    start = replace(TRUE, vertices_mm=vertices)
    with np.errstate(invalid="ignore"), pytest.raises(NothingFoundError, match="no path can be"):
        solved(times_of(TRUE, PAPER), lines_of(TRUE, PAPER), freedom_for(KNOWN), start=start)
    assert not capfd.readouterr().err


class TestWithoutNoise:
    @pytest.mark.parametrize("source", [KNOWN, NO_TIME, Source()])
    def test_finds_the_path_from_a_start_some_millimetres_off(self, source):
        rng = np.random.default_rng(1)
        freedom = freedom_for(source)
        step = freedom.basis @ rng.normal(0.0, 5.0, freedom.basis.shape[1])
        found = solved(
            times_of(TRUE, PAPER), lines_of(TRUE, PAPER), freedom, start=TRUE.moved(step)
        )
        assert found.converged
        # Ends move in a plane of their own: the path is compared, not the end of its last leg.
        np.testing.assert_allclose(found.state.vertices_mm[1:3], PAPER_VERTICES[1:3], atol=2e-3)
        assert found.state.start_time_ps == pytest.approx(2000.0, abs=0.01)
        assert found.chi2 < 1e-4
        assert found.line_chi2 < 1e-4

    @pytest.mark.parametrize("seed", range(4))
    def test_any_camera_lens_and_indices(self, seed):
        camera, medium = camera_like(seed), Medium(1.3, 1.05)
        state = path_in_view(camera, 2, seed)
        source = Source(state.vertices_mm[0], emission_time_ps=state.start_time_ps)
        freedom = freedom_for(source, state, camera)
        rng = np.random.default_rng(seed)
        start = state.moved(freedom.basis @ rng.normal(0.0, 3.0, freedom.basis.shape[1]))
        found = solved(
            times_of(state, camera, medium=medium),
            lines_of(state, camera),
            freedom,
            start=start,
            camera=camera,
            medium=medium,
        )
        assert found.converged
        np.testing.assert_allclose(found.state.vertices_mm[1], state.vertices_mm[1], atol=2e-3)

    def test_footprint_corrections_are_part_of_the_model(self):
        times = times_of(TRUE, PAPER)
        shifted = replace(
            times, arrival_ps=times.arrival_ps + 1.5, footprint_ps=np.full(len(times.leg), 1.5)
        )
        found = solved(shifted, lines_of(TRUE, PAPER), freedom_for(KNOWN))
        assert found.chi2 < 1e-6


class TestErrors:
    """250 fits; pulls' widths scatter by 1 / sqrt(500) = 4.5 %, their means by 0.063: five."""

    RUNS = 250

    @pytest.mark.parametrize("source", [KNOWN, NO_TIME])
    def test_pulls_and_chi_square(self, source):
        rng = np.random.default_rng(3)
        times, lines, freedom = times_of(TRUE, PAPER), lines_of(TRUE, PAPER), freedom_for(source)
        pulls, chi2, dofs = [], [], []
        for _ in range(self.RUNS):
            found = solved(*noisy(times, lines, rng), freedom)
            moved = found.state.vertices_mm - TRUE.vertices_mm
            offset = np.append(moved.ravel(), found.state.start_time_ps - 2000.0)
            parameters = np.linalg.lstsq(freedom.basis, offset, rcond=None)[0]
            pulls.append(parameters / np.sqrt(np.diag(found.covariance)))
            chi2.append(found.chi2)
            dofs.append(found.dof)
        width, mean = np.std(pulls, axis=0), np.mean(pulls, axis=0)
        assert width.min() > 0.77
        assert width.max() < 1.23
        assert np.abs(mean).max() < 0.32
        # chi2 of the times: its mean scatters by sqrt(2 dof / runs) = 0.73; lines take a share.
        assert np.mean(chi2) == pytest.approx(dofs[0], abs=5.0)

    def test_covariance_is_the_inverse_of_what_the_data_weigh(self):
        times, lines, freedom = times_of(TRUE, PAPER), lines_of(TRUE, PAPER), freedom_for(KNOWN)
        one = solved(times, lines, freedom).covariance
        doubled = replace(
            times, photon_var=1.5 * times.photon_var, pixel_var=2.5 * times.photon_var
        )
        softer = replace(lines, whitening=lines.whitening / 2.0)
        four = solved(doubled, softer, freedom).covariance
        np.testing.assert_allclose(four, 4.0 * one, rtol=1e-3)

    def test_gains_say_what_each_datum_moves(self):
        times, lines, freedom = times_of(TRUE, PAPER), lines_of(TRUE, PAPER), freedom_for(NO_TIME)
        base = solved(times, lines, freedom)
        for index in (0, 30, 70):
            late = times.arrival_ps.copy()
            late[index] += 0.5
            found = solved(replace(times, arrival_ps=late), lines, freedom)
            step = found.state.vertices_mm - base.state.vertices_mm
            offset = np.append(step.ravel(), found.state.start_time_ps - base.state.start_time_ps)
            expected = freedom.basis @ base.photon_gain[: freedom.basis.shape[1], index] * 0.5
            np.testing.assert_allclose(offset, expected, atol=0.02 * np.abs(expected).max())

    def test_gains_add_up_to_the_covariance(self):
        found = solved(times_of(TRUE, PAPER), lines_of(TRUE, PAPER), freedom_for(NO_TIME))
        variance = np.ones(found.photon_gain.shape[1])
        total = (found.photon_gain * variance) @ found.photon_gain.T
        total = total + found.line_gain @ found.line_gain.T + found.prior_covariance
        np.testing.assert_allclose(total, found.covariance, rtol=1e-6, atol=1e-9)

    def test_the_floor_adds_to_every_pulse(self):
        times, lines, freedom = times_of(TRUE, PAPER), lines_of(TRUE, PAPER), freedom_for(KNOWN)
        raised = solved(times, lines, freedom, floor=3.0)
        same = solved(replace(times, photon_var=times.photon_var + 3.0), lines, freedom)
        np.testing.assert_allclose(raised.covariance, same.covariance, rtol=1e-9)


class TestPriorsAndSharedErrors:
    def test_a_source_with_an_error_stays_within_it(self):
        source = Source(PAPER_VERTICES[0] + 0.5, position_std_mm=1.0, emission_time_ps=2000.0)
        found = solved(times_of(TRUE, PAPER), lines_of(TRUE, PAPER), freedom_for(source))
        # Data and truth pull it back; what they cannot see (along the flight) stays at the prior.
        assert np.abs(found.state.vertices_mm[0]).max() < 0.6
        std = np.sqrt(np.diag(found.covariance))[:3]
        assert (std < 1.001).all()
        assert std.max() > 0.05

    def test_a_waypoint_holds_its_corner(self):
        freedom = freedom_of_path(
            TRUE,
            source=Source(PAPER_VERTICES[0]),
            waypoints=((1, PAPER_VERTICES[1] + [0.0, 0.0, 1.0], 0.01),),
            start_basis=None,
            end_bases=(np.eye(3)[:, 1:],),
        )
        found = solved(times_of(TRUE, PAPER, std=50.0), lines_of(TRUE, PAPER), freedom)
        assert found.state.vertices_mm[1, 2] == pytest.approx(51.0, abs=0.05)

    def test_a_shared_error_is_solved_for_and_counted(self):
        """The clock runs 0.3 % fast; a mode of one sigma 0.2 % per delay can take that up."""
        times = times_of(TRUE, PAPER)
        stretch = times.arrival_ps - 2000.0
        modes = 0.002 * stretch[:, np.newaxis]
        wrong = replace(times, arrival_ps=times.arrival_ps + 0.003 * stretch, modes_ps=modes)
        lines, freedom = lines_of(TRUE, PAPER), freedom_for(KNOWN)
        found = solved(wrong, lines, freedom)
        blind = solved(replace(wrong, modes_ps=np.zeros((len(times.leg), 0))), lines, freedom)
        clean = solved(times, lines, freedom)
        true = TRUE.vertices_mm[1:3]
        assert found.modes == pytest.approx([1.5], abs=0.3)
        assert (
            np.abs(found.state.vertices_mm[1:3] - true).max()
            < 0.3 * np.abs(blind.state.vertices_mm[1:3] - true).max()
        )
        assert found.covariance[0, 0] > clean.covariance[0, 0]

    def test_a_shared_error_that_the_data_do_not_see_is_what_was_told(self):
        """All times late alike, and an emission time that is free: 5 ps of the one in the other."""
        times = times_of(TRUE, PAPER)
        late = replace(times, modes_ps=np.full((len(times.leg), 1), 5.0))
        freedom = freedom_for(NO_TIME)
        found = solved(late, lines_of(TRUE, PAPER), freedom)
        n = freedom.basis.shape[1]
        assert found.covariance[n, n] == pytest.approx(1.0, rel=1e-3)
        clean = solved(times, lines_of(TRUE, PAPER), freedom)
        own = [np.diag(one.covariance)[freedom.labels.index("emission time")]
               for one in (found, clean)]  # fmt: skip
        assert own[0] - own[1] == pytest.approx(25.0, rel=1e-3)

    def test_an_uncertain_pose_moves_the_camera_and_widens_the_errors(self):
        rng = np.random.default_rng(2)
        pose_std = np.array([1e-3, 1e-3, 1e-3, 0.5, 0.5, 0.5])
        known_poorly = replace(PAPER, pose_covariance=np.diag(pose_std**2))
        truly = PAPER.perturbed(pose_std * rng.normal(size=6))
        times, lines, freedom = times_of(TRUE, truly), lines_of(TRUE, truly), freedom_for(KNOWN)
        found = solved(times, lines, freedom, camera=known_poorly)
        firm = solved(times, lines, freedom, camera=PAPER)
        assert found.chi2 < firm.chi2
        error = found.state.vertices_mm[1] - TRUE.vertices_mm[1]
        n = freedom.basis.shape[1]
        spread = freedom.basis @ found.covariance[:n, :n] @ freedom.basis.T
        block = spread[3:6, 3:6]
        assert error @ np.linalg.solve(block, error) < 30.0
        assert np.trace(block) > 4 * np.trace(
            (freedom.basis @ firm.covariance[:n, :n] @ freedom.basis.T)[3:6, 3:6]
        )


class TestOutliers:
    def test_far_pulses_are_weighted_out(self):
        times, lines, freedom = times_of(TRUE, PAPER), lines_of(TRUE, PAPER), freedom_for(KNOWN)
        late = times.arrival_ps.copy()
        late[[5, 40]] += 200.0
        spoiled = replace(times, arrival_ps=late)
        first = solved(spoiled, lines, freedom)
        cut = reweighted(spoiled, first, floor_var=30.0**2, cut=5.0)
        np.testing.assert_array_equal(np.flatnonzero(cut.weight == 0), [5, 40])
        again = solved(cut, lines, freedom)
        np.testing.assert_allclose(again.state.vertices_mm[1:3], PAPER_VERTICES[1:3], atol=2e-3)
        assert again.residual_ps[5] == pytest.approx(200.0, abs=0.1), "outliers keep their residual"
        assert again.dof == first.dof - 2


class TestCorners:
    def test_overshoot_is_how_far_a_pixel_lies_beyond_its_corner(self):
        camera = Camera.facing_plane((32, 32))
        state = PathState(np.array([[-100.0, 4, 0], [50, 4, 0], [50, 100, 0]]), 0.0)
        col = np.array([10.0, 15.5 + 50.0 / 245 * 32 + 0.7, 31.0])
        legs, rows = np.array([0, 0, 1]), np.array([15.0, 15.0, 10.0])
        print_ = footprints(state, camera=camera, medium=AIR, legs=legs, rows=rows, cols=col)
        over, slopes = overshoots(state, print_, camera=camera)
        jacobian = slopes()
        np.testing.assert_allclose(over, [0.0, 0.7, 0.0], atol=1e-6)
        h = 1e-3
        for k in range(9):
            step = np.zeros(10)
            step[k] = h
            values = []
            for side in (step, -step):
                at = state.moved(side)
                moved = footprints(at, camera=camera, medium=AIR, legs=legs, rows=rows, cols=col)
                values.append(overshoots(at, moved, camera=camera)[0])
            np.testing.assert_allclose(
                jacobian[:, k],
                (values[0] - values[1]) / (2 * h),
                atol=3e-3 * np.abs(jacobian).max(),
            )

    def test_ends_of_the_path_are_no_corners(self):
        camera = Camera.facing_plane((32, 32))
        state = PathState(np.array([[-50.0, 4, 0], [50, 4, 0]]), 0.0)
        col = np.array([2.0, 30.0])
        print_ = footprints(
            state, camera=camera, medium=AIR, legs=np.zeros(2, int), rows=np.full(2, 15.0), cols=col
        )
        over, _ = overshoots(state, print_, camera=camera)
        np.testing.assert_array_equal(over, 0.0)
