"""`joint` on recordings of the brute-force oracle: what it finds, and what it says about it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from lightflight import flags
from lightflight.errors import NothingFoundError, SuspectDataWarning
from lightflight.flight import Medium, Source
from lightflight.path.error import path_error
from lightflight.path.light_path import LightPath
from lightflight.reconstruct.chain import reconstruct
from lightflight.reconstruct.fit.joint import fit_joint
from lightflight.reconstruct.fit.result import covariance_parts
from lightflight.reconstruct.model.geometry import PathState
from lightflight.reconstruct.model.setting import Setting
from lightflight.reconstruct.sightings import sighting_from_histograms
from lightflight.timing.clock.calibration import TimingCalibration
from tests.labs import START_PS, Lab, corner_in_view, known_path, one_leg, three_legs, uneven_leg
from tests.path_fakes import PAPER_VERTICES


def joint(lab: Lab, hist=None, **options) -> LightPath:
    if hist is None and not options:
        return known_path(lab, "joint")
    settings = {"camera": lab.camera, "source": lab.known, "timing": lab.timing}
    given = lab.recording(1) if hist is None else hist
    return reconstruct(given, **(settings | options))


@pytest.fixture(scope="module")
def single() -> LightPath:
    return joint(one_leg())


@pytest.fixture(scope="module")
def triple() -> LightPath:
    return joint(three_legs())


class TestFinds:
    def test_one_leg(self, single):
        assert single.n_legs == 1
        assert single.legs[0].angle_deg == pytest.approx(5.0, abs=0.03)
        error = path_error(single, one_leg().truth, one_leg().camera)
        assert error.position_rms_mm < 0.15
        assert error.event_time_rms_ps < 0.3

    def test_three_legs_with_mirrors_outside_the_picture(self, triple):
        assert triple.n_legs == 3
        error = path_error(triple, three_legs().truth, three_legs().camera)
        assert error.position_rms_mm < 0.3
        away = np.linalg.norm(triple.vertices_mm - PAPER_VERTICES, axis=1)
        assert away[1:3].max() < 1.5

    def test_a_corner_in_the_picture(self):
        lab = corner_in_view()
        path = joint(lab)
        assert path.n_legs == 2
        assert np.linalg.norm(path.vertices_mm[1] - lab.vertices_mm[1]) < 0.25

    @pytest.mark.usefixtures("unexamined", "nothing_twice")
    def test_emission_time_fitted(self):
        path = joint(three_legs(), source=three_legs().timed)
        assert path.emission_time_ps == pytest.approx(START_PS, abs=1.5)
        assert path.prior == "source known, emission time fitted"
        assert path_error(path, three_legs().truth, three_legs().camera).position_rms_mm < 0.4

    @pytest.mark.usefixtures("unexamined", "nothing_twice")
    def test_nothing_known(self):
        """Blind: entry, exit and mirrors come from the times alone, a few millimetres off."""
        path = joint(three_legs(), source=Source())
        assert path.prior == "source unknown"
        _, col = three_legs().camera.pixels_from_points(path.vertices_mm[0])
        assert float(col) == pytest.approx(-0.5, abs=0.01), "vertex 0 is the entry into view"
        assert path_error(path, three_legs().truth, three_legs().camera).position_rms_mm < 10.0

    @pytest.mark.usefixtures("unexamined", "nothing_twice")
    def test_times_belong_to_the_footprint_not_to_the_centre_ray(self):
        """Light that changes by 30 % per pixel shifts a pixel's time by a picosecond and more.

        12 recordings: the mean angle is known to 0.29 of an error; taken for the centre ray's
        the times would tilt the leg by some errors.
        """
        lab = uneven_leg()
        true = np.rad2deg(np.arctan2(33.0, 375.0))
        paths = [joint(lab, lab.recording(seed)) for seed in range(12)]
        offset = np.mean([p.legs[0].angle_deg - true for p in paths])
        std = np.mean([p.legs[0].angle_std_deg for p in paths])
        assert abs(offset) < 1.7 * std  # 6 / sqrt(12)
        assert np.mean([p.goodness.reduced_chi2 for p in paths]) < 1.2


class TestSays:
    def test_goodness(self, triple):
        good = triple.goodness
        assert good.converged
        assert good.error_floor_ps == 0.0
        assert good.reduced_chi2 == pytest.approx(1.0, abs=6 * np.sqrt(2 / good.dof))
        used = triple.residuals["used"]
        assert good.n_pulses == used.sum()
        assert good.n_rejected == (~used).sum()
        rms = np.sqrt(np.mean(triple.residuals["residual_ps"][used] ** 2))
        assert good.residual_rms_ps == pytest.approx(rms)

    def test_residuals_add_up(self, triple):
        table = triple.residuals
        np.testing.assert_allclose(
            table["arrival_ps"], table["model_ps"] + table["residual_ps"], atol=1e-9
        )
        scaled = (table["residual_ps"] / table["std_ps"])[table["used"]]
        assert np.sum(scaled**2) == pytest.approx(triple.goodness.chi2, rel=1e-6)
        assert set(table["leg"]) == {0, 1, 2}
        times = triple.vertex_times_ps
        inside = table["used"] & (table["leg"] == 1)
        assert (table["event_time_ps"][inside] > times[1]).all()
        assert (table["event_time_ps"][inside] < times[2]).all()

    def test_covariance_is_the_sum_of_its_classes(self):
        """Of the fit's own covariance, whose classes are worked out each from its data."""
        lab = one_leg()
        timing = lab.doubtful_timing(np.random.default_rng(2), pixel_std_ps=2.0, scale_std=5e-5)
        setting = Setting(lab.camera, lab.timed, Medium())
        sighting = sighting_from_histograms(
            lab.recording(1), setting, timing=timing, background=None, exclude_mask=None,
            least_squares=False,
        )  # fmt: skip
        fit = fit_joint([sighting], PathState(lab.vertices_mm, START_PS), setting, legs=None)
        parts, state = covariance_parts(fit), fit.solution.state

        def events(move):
            moved = state.moved(move)
            times = moved.vertex_times_ps(setting.medium)
            return np.column_stack((moved.vertices_mm, times)).ravel()

        by_freedom = np.transpose(
            [(events(1e-4 * way) - events(-1e-4 * way)) / 2e-4 for way in fit.freedom.basis.T]
        )
        free = by_freedom.shape[1]
        whole = by_freedom @ fit.solution.covariance[:free, :free] @ by_freedom.T
        scale = np.sqrt(np.diag(whole)) + 1e-6
        np.testing.assert_allclose(
            sum(parts.values()) / np.outer(scale, scale), whole / np.outer(scale, scale), atol=1e-5
        )
        for name in ("photon", "pixel", "shared"):
            assert np.trace(parts[name]) > 0.02 * np.trace(whole), name

    def test_classes_of_errors_where_all_is_exact(self, triple):
        parts = triple.covariance_parts
        assert set(parts) == {"photon", "pixel", "shared"}
        np.testing.assert_allclose(parts["pixel"], 0.0, atol=1e-12)
        # Nothing told is uncertain: what is shared is what the counts leave unknown of haze.
        assert np.trace(parts["shared"]) < 0.01 * np.trace(triple.covariance)
        np.testing.assert_allclose(triple.covariance, triple.covariance.T, atol=1e-12)
        assert np.linalg.eigvalsh(triple.covariance).min() > -1e-9

    def test_pixel_and_shared_errors_have_classes_of_their_own(self):
        lab, rng = one_leg(), np.random.default_rng(2)
        clean = joint(lab)
        pixel = joint(lab, timing=lab.doubtful_timing(rng, pixel_std_ps=3.0))
        # 0.2 ps at this distance; a larger one the data would know better than the calibration.
        shared = joint(lab, timing=lab.doubtful_timing(rng, scale_std=5e-5))

        def share(path, name):
            return np.trace(path.covariance_parts[name]) / np.trace(path.covariance)

        assert share(pixel, "pixel") > 0.5
        assert share(shared, "shared") > 0.2
        assert pixel.legs[0].angle_std_deg > 1.5 * clean.legs[0].angle_std_deg
        assert shared.legs[0].angle_std_deg > 1.5 * clean.legs[0].angle_std_deg

    def test_the_source_is_exact_where_it_is_known(self, triple):
        np.testing.assert_array_equal(triple.vertices_mm[0], PAPER_VERTICES[0])
        np.testing.assert_array_equal(triple.vertex_std[0], 0.0)
        assert triple.emission_time_ps == START_PS

    def test_truth_and_prior_are_carried(self, triple):
        assert triple.prior == "source known, emission time known"
        assert triple.method == "joint"

    @pytest.mark.filterwarnings("ignore:the recording contradicts")  # as it should
    def test_a_clock_worse_than_it_says_is_noticed_and_counted(self):
        """Pixel delays of 4 ps that the calibration does not know of."""
        lab = one_leg()
        wrong = replace(
            lab.doubtful_timing(np.random.default_rng(5), pixel_std_ps=4.0),
            skew_std_ps=np.zeros(lab.camera.shape),
        )
        path = joint(lab, timing=wrong)
        assert 2.0 < path.goodness.error_floor_ps < 6.0
        assert any("scatter about the path" in s for s in path.statements)
        assert path.legs[0].angle_std_deg > 1.5 * joint(lab).legs[0].angle_std_deg


@pytest.mark.usefixtures("unexamined", "nothing_twice")
class TestOptions:
    def test_repeats_are_fitted_together(self):
        lab = one_leg()
        one = joint(lab)
        four = joint(lab, [lab.recording(seed) for seed in range(1, 5)])
        assert four.goodness.n_pulses > 3.5 * one.goodness.n_pulses
        assert four.legs[0].angle_std_deg == pytest.approx(one.legs[0].angle_std_deg / 2, rel=0.1)
        pull = (four.legs[0].angle_deg - 5.0) / four.legs[0].angle_std_deg
        assert abs(pull) < 6.0

    def test_calibration_errors_do_not_average_over_repeats(self):
        lab = one_leg()
        timing = lab.doubtful_timing(np.random.default_rng(3), pixel_std_ps=10.0)
        one, four = (
            joint(lab, [lab.recording(s) for s in range(n)], timing=timing) for n in (1, 4)
        )
        assert four.legs[0].angle_std_deg > 0.85 * one.legs[0].angle_std_deg

    @pytest.mark.parametrize("how", ["path", "vertices"])
    def test_a_start_replaces_the_search(self, triple, how):
        lab = three_legs()
        moved = PAPER_VERTICES + np.array([[0, 0, 0], [4, -1, 5], [-4, 1, -5], [3, 1, 3.0]])
        start = triple if how == "path" else moved
        path = joint(lab, start=start)
        std = triple.vertex_std[1:3, :3]
        assert (np.abs(path.vertices_mm - triple.vertices_mm)[1:3] < 0.3 * std + 1e-6).all()

    def test_number_of_legs_given(self):
        assert joint(three_legs(), n_legs=3).n_legs == 3

    def test_a_waypoint_pulls_its_mirror(self):
        lab = three_legs()
        source = Source(PAPER_VERTICES[0], position_std_mm=1.0)
        free = joint(lab, source=source)
        held = joint(lab, source=source, waypoints=((1, PAPER_VERTICES[1], 0.05),))
        assert np.linalg.norm(held.vertices_mm[1] - PAPER_VERTICES[1]) < 0.2
        assert (held.vertex_std[1, :3] < 0.0501).all()
        assert held.vertex_std[1, :3].max() < free.vertex_std[1, :3].max()

    def test_a_source_with_an_error_is_moved(self):
        lab = three_legs()
        off = Source(PAPER_VERTICES[0] + [0.0, 0.8, -0.6], position_std_mm=1.0)
        path = joint(lab, source=off)
        away = path.vertices_mm[0] - PAPER_VERTICES[0]
        std = path.vertex_std[0, :3]
        assert (np.abs(away) < 5 * std).all()
        assert (std <= 1.0001).all()
        assert std.min() > 0.0

    def test_masked_pixels_take_no_part(self):
        lab = one_leg()
        mask = np.zeros((32, 32), dtype=bool)
        mask[:, 10:20] = True
        path = joint(lab, exclude_mask=mask)
        assert not np.isin(path.residuals["col"], np.arange(10, 20)).any()
        assert path.legs[0].angle_deg == pytest.approx(5.0, abs=6 * path.legs[0].angle_std_deg)

    def test_reversed_codes_read_as_what_they_are(self):
        lab = one_leg()
        # Code k of a reversed clock that ends the period holds what a forward clock's mirror does.
        n_codes = 910
        counts = np.zeros((32, 32, n_codes), dtype=np.int64)
        forward = lab.recording(1).counts
        counts[:, :, n_codes - 1 - np.arange(forward.shape[2])] = forward
        first = 50_000.0 - n_codes * 55.0
        hist = lab.histograms(counts, reversed_codes=True, first_edge_ps=first)
        path = joint(lab, hist, timing=TimingCalibration.nominal(hist))
        # More empty codes tell the background a little better; nothing else differs.
        assert path.legs[0].angle_deg == pytest.approx(joint(lab).legs[0].angle_deg, abs=2e-4)


class TestTrouble:
    def test_screaming_and_dead_pixels(self):
        lab = three_legs()
        counts = np.array(lab.recording(1).counts, dtype=np.int64)
        rng = np.random.default_rng(0)
        hot = rng.choice(1024, 60, replace=False)
        flat = counts.reshape(1024, -1)
        flat[hot[:40]] += rng.poisson(300.0, (40, flat.shape[1]))
        flat[hot[40:]] = 0
        path = joint(lab, lab.histograms(counts))
        assert path.n_legs == 3
        assert path_error(path, lab.truth, lab.camera).position_rms_mm < 0.3
        assert path.goodness.reduced_chi2 < 1.5

    def test_wrong_times_are_left_out(self):
        """Five pixels on the leg whose clocks are 200 ps off, three pulses: none of its own."""
        lab = one_leg()
        skew = np.zeros((32, 32))
        skew[15, [3, 9, 14, 20, 27]] = 200.0
        with pytest.warns(SuspectDataWarning, match="the recording contradicts this path"):
            path = joint(lab, timing=replace(lab.timing, skew_ps=skew))
        table = path.residuals
        wrong = (table["row"] == 15) & np.isin(table["col"], [3, 9, 14, 20, 27])
        assert not wrong.any()
        assert path.legs[0].angle_deg == pytest.approx(5.0, abs=6 * path.legs[0].angle_std_deg)

    def test_outliers_are_left_out_and_marked(self):
        """The same by 20 ps, a third of a pulse and ten errors: the leg's light, wrongly timed."""
        lab = one_leg()
        skew = np.zeros((32, 32))
        skew[15, [3, 9, 14, 20, 27]] = 20.0
        path = joint(lab, timing=replace(lab.timing, skew_ps=skew))
        table = path.residuals
        wrong = (table["row"] == 15) & np.isin(table["col"], [3, 9, 14, 20, 27])
        assert wrong.sum() == 5
        assert not (wrong & table["used"]).any()
        assert (table["flags"][wrong] & flags.OUTLIER != 0).all()
        assert path.explained is not None
        assert path.explained.n_pulses == table["used"].sum()
        assert path.legs[0].angle_deg == pytest.approx(5.0, abs=6 * path.legs[0].angle_std_deg)

    def test_a_second_flash_is_no_part_of_the_path(self):
        """A lamp in the corner of the picture flashes a nanosecond later."""
        lab = one_leg()
        counts = np.array(lab.recording(1).counts, dtype=np.int64)
        counts[3:6, 3:6, 95:100] += np.random.default_rng(1).poisson(2000.0, (3, 3, 5))
        with pytest.warns(SuspectDataWarning, match=r"clearest other light is .* pixel \(3, 3\)"):
            path = joint(lab, lab.histograms(counts))
        assert path.n_legs == 1
        assert path.legs[0].angle_deg == pytest.approx(5.0, abs=6 * path.legs[0].angle_std_deg)

    def test_fewer_pixels_than_unknowns(self):
        """Five pixels side by side, nothing known but where to begin: entry, time and exit are
        five unknowns, and the pixels by the ends say where the view begins."""
        lab = one_leg()
        mask = np.ones((32, 32), dtype=bool)
        mask[15, 9:14] = False
        with pytest.raises(NothingFoundError, match="fewer than its 5 unknowns"):
            joint(lab, exclude_mask=mask, source=Source(), start=lab.truth)


@pytest.mark.usefixtures("unexamined", "nothing_twice")
class TestSharedErrors:
    """Errors of a whole recording, larger than the gate that tells pulses from outliers."""

    @pytest.mark.parametrize("sigmas", [-2.0, 0.5, 2.0])
    def test_a_clock_whose_scale_is_off(self, sigmas):
        """0.7 % per sigma is what an unknown dead time costs: 50 ps here at two sigma."""
        lab = one_leg()
        timing = lab.doubtful_timing(np.random.default_rng(0), scale_std=0.007, scale_sigmas=sigmas)
        path = joint(lab, timing=timing)
        assert path.goodness.n_pulses > 90
        pull = (path.legs[0].angle_deg - 5.0) / path.legs[0].angle_std_deg
        assert abs(pull) < 5.0

    @pytest.mark.parametrize("side", [-1.0, 1.0])
    def test_a_camera_that_stands_elsewhere(self, side):
        """A centimetre nearer than thought: 30 ps, and a fifth of a pixel at the picture's rim."""
        lab = one_leg()
        std = np.array([2e-3, 2e-3, 2e-3, 6.0, 6.0, 6.0])
        wrong = lab.camera.perturbed(side * np.array([1e-3, -2e-3, 1e-3, 4.0, -3.0, 9.0]))
        camera = replace(wrong, pose_covariance=np.diag(std**2))
        path = joint(lab, camera=camera)
        assert path.goodness.n_pulses > 90
        offset = path.vertices_mm[-1] - lab.vertices_mm[0]
        true = lab.vertices_mm[1] - lab.vertices_mm[0]
        along = offset @ true / (true @ true)
        beside = offset - along * true
        spread = path.covariance[-4:-1, -4:-1]
        assert beside @ np.linalg.pinv(spread, rcond=1e-8) @ beside < 40.0
        assert path.legs[0].angle_std_deg > 0.1
