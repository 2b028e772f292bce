"""`photon`: agrees with `joint` where light is plenty, and goes on where `joint` must stop."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import lightflight as lf
from lightflight.errors import NothingFoundError
from lightflight.path.error import path_error
from lightflight.path.light_path import LightPath
from lightflight.reconstruct.all_counts.counts import merged
from lightflight.reconstruct.chain import reconstruct
from lightflight.reconstruct.limits.bounds import bounds
from lightflight.reconstruct.model.sighting import Sighting
from tests.labs import Lab, corner_in_view, known_path, one_leg, three_legs


def fitted(lab: Lab, hist=None, **options) -> LightPath:
    if hist is None and options.keys() <= {"method"}:
        return known_path(lab, options.get("method", "photon"))
    settings = {
        "camera": lab.camera, "source": lab.known, "timing": lab.timing, "method": "photon",
    }  # fmt: skip
    given = lab.recording(1) if hist is None else hist
    return reconstruct(given, **(settings | options))


@pytest.fixture(scope="module")
def triple() -> LightPath:
    return fitted(three_legs())


class TestBright:
    @pytest.mark.parametrize(
        "lab", [pytest.param(one_leg, marks=pytest.mark.long), three_legs, corner_in_view]
    )
    def test_agrees_with_joint(self, lab):
        """Both are near the bound, so they differ by a fraction of an error."""
        joint, photon = (fitted(lab(), method=m) for m in ("joint", "photon"))
        assert photon.method == "photon"
        assert photon.n_legs == joint.n_legs
        assert photon.goodness.converged
        for a, b in zip(photon.legs, joint.legs, strict=True):
            assert abs(a.angle_deg - b.angle_deg) < 1.0 * b.angle_std_deg
            assert 0.7 < a.angle_std_deg / b.angle_std_deg < 1.1

    def test_stated_errors_are_the_bound(self, triple):
        lab = three_legs()
        bound = bounds(triple, source=lab.known, photons_per_pixel=40_000.0, pulse_std_ps=70.0,
                       background_per_code=lab.background_per_code)  # fmt: skip
        table = triple.sample(300)
        seen = table["in_view"]
        variance = sum(table[f"{axis}_std_mm"][seen] ** 2 for axis in "xyz")
        assert np.sqrt(np.mean(variance)) == pytest.approx(bound.position_rms_mm, rel=0.12)

    def test_emission_time_fitted(self):
        lab = three_legs()
        path = fitted(lab, source=lab.timed)
        assert path_error(path, lab.truth, lab.camera).position_rms_mm < 0.4
        assert abs(path.emission_time_ps - 2000.0) < 6 * path.vertex_std[0, 3]


@pytest.mark.usefixtures("nothing_twice")
class TestDim:
    @pytest.mark.parametrize("photons", [pytest.param(100.0, marks=pytest.mark.long), 30.0])
    @pytest.mark.usefixtures("unexamined")
    def test_few_photons_in_the_brightest_pixel(self, photons):
        """Mean square pull of four recordings' angles: 1 within 0.71; five of these is 4.5."""
        lab, pulls = one_leg(), []
        for seed in range(4):
            path = fitted(lab, lab.recording(seed, photons), n_legs=1)
            pulls.append((path.legs[0].angle_deg - 5.0) / path.legs[0].angle_std_deg)
            ideal = bounds(path, source=lab.known, photons_per_pixel=photons, pulse_std_ps=70.0,
                           background_per_code=lab.background_per_code)  # fmt: skip
            assert path.legs[0].angle_std_deg < 1.5 * ideal.angle_std_deg[0]
        assert np.mean(np.square(pulls)) < 4.5

    @pytest.mark.usefixtures("unexamined")
    def test_at_the_end_of_the_light_it_is_right_or_says_no(self):
        """Six and eight photons in the brightest pixel, some 200 in all, two recordings each."""
        lab, refusals = one_leg(), []
        for photons in (6.0, 8.0):
            for seed in range(2):
                try:
                    path = fitted(lab, lab.recording(seed, photons))
                except NothingFoundError as problem:
                    refusals.append(str(problem))
                    continue
                pull = (path.legs[0].angle_deg - 5.0) / path.legs[0].angle_std_deg
                assert path.n_legs == 1
                assert abs(pull) < 5.0
                assert path.legs[0].angle_std_deg < 1.0
        assert len(refusals) <= 3
        assert all("too little light" in sentence for sentence in refusals)

    def test_no_light_at_all(self):
        lab = one_leg()
        rng = np.random.default_rng(0)
        dark = lab.histograms(rng.poisson(lab.background_per_code, lab.signal.shape))
        with pytest.raises(NothingFoundError, match="too little light"):
            fitted(lab, dark)


class TestSays:
    def test_covariance_is_whole_and_in_classes(self, triple):
        assert np.linalg.eigvalsh(triple.covariance).min() > -1e-9
        for part in triple.covariance_parts.values():
            assert np.linalg.eigvalsh(part).min() > -1e-6 * np.trace(triple.covariance)

    def test_pixel_errors_have_their_share(self):
        """As `joint` has it, which works out each class from its own data."""
        lab = one_leg()
        timing = lab.doubtful_timing(np.random.default_rng(4), pixel_std_ps=3.0)
        path = fitted(lab, timing=timing)
        clean = fitted(lab)
        other = fitted(lab, timing=timing, method="joint")
        for name in ("photon", "pixel"):
            ours, theirs = (np.trace(one.covariance_parts[name]) for one in (path, other))
            assert ours == pytest.approx(theirs, rel=0.25), name
        assert np.trace(path.covariance_parts["pixel"]) > 0.4 * np.trace(path.covariance)
        assert path.legs[0].angle_std_deg > 1.4 * clean.legs[0].angle_std_deg
        assert abs(path.legs[0].angle_deg - 5.0) < 5 * path.legs[0].angle_std_deg

    def test_residuals_follow_the_refined_path(self, triple):
        table = triple.residuals
        np.testing.assert_allclose(
            table["arrival_ps"], table["model_ps"] + table["residual_ps"], atol=1e-9
        )
        used = table["used"]
        scaled = table["residual_ps"][used] / table["std_ps"][used]
        assert np.mean(scaled**2) == pytest.approx(1.0, abs=6 * np.sqrt(2 / used.sum()))
        assert triple.goodness.n_pulses >= len(np.unique(table["col"][used]))


@pytest.mark.usefixtures("unexamined", "nothing_twice")
class TestOptions:
    def test_repeats_add_up(self):
        lab = one_leg()
        one = fitted(lab)
        both = fitted(lab, [lab.recording(1), lab.recording(2)])
        assert both.legs[0].angle_std_deg == pytest.approx(
            one.legs[0].angle_std_deg / np.sqrt(2), rel=0.08
        )
        total = lab.histograms(
            lab.recording(1).counts.astype(int) + lab.recording(2).counts.astype(int)
        )
        added = fitted(lab, total)
        assert both.legs[0].angle_deg == pytest.approx(
            added.legs[0].angle_deg, abs=0.3 * added.legs[0].angle_std_deg
        )

    def test_a_clock_whose_scale_is_off(self):
        lab = one_leg()
        timing = lab.doubtful_timing(np.random.default_rng(0), scale_std=0.007, scale_sigmas=1.5)
        path = fitted(lab, timing=timing)
        pull = (path.legs[0].angle_deg - 5.0) / path.legs[0].angle_std_deg
        assert abs(pull) < 5.0

    @pytest.mark.filterwarnings("ignore:the recording contradicts")  # it does
    def test_wrong_pixels_do_not_pull(self):
        lab = one_leg()
        skew = np.zeros((32, 32))
        skew[15, [3, 9, 14, 20, 27]] = 200.0
        path = fitted(lab, timing=replace(lab.timing, skew_ps=skew))
        assert abs(path.legs[0].angle_deg - 5.0) < 5 * path.legs[0].angle_std_deg

    def test_hot_pixels_that_lose_light_to_their_noise_do_not_pull(self):
        """Twelve pixels on the legs keep a third of their light: 0.74 mm were they believed."""
        lab = three_legs()
        mean = lab.mean()
        light = mean.sum(axis=2)
        hot = np.argwhere(light > 0.3 * light.max())[::7]
        mean[tuple(hot.T)] = mean[tuple(hot.T)] / 3.0 + 20.0
        hist = lab.histograms(np.random.default_rng(3).poisson(mean))
        path = fitted(lab, hist)
        assert path_error(path, lab.truth, lab.camera).position_rms_mm < 0.25
        clean = fitted(lab).vertex_std[1:3]
        assert (path.vertex_std[1:3] < 1.3 * clean).all()

    @pytest.mark.filterwarnings("ignore:the recording contradicts")  # it does
    def test_a_lamp_that_flashes_does_not_pull(self):
        lab = one_leg()
        counts = np.array(lab.recording(1).counts, dtype=np.int64)
        counts[13:18, 8:11, 100:105] += np.random.default_rng(1).poisson(800.0, (5, 3, 5))
        path = fitted(lab, lab.histograms(counts))
        assert path.n_legs == 1
        assert abs(path.legs[0].angle_deg - 5.0) < 5 * path.legs[0].angle_std_deg

    # Most codes are without any background, as those of no camera are.
    @pytest.mark.filterwarnings("ignore:the recording contradicts")
    def test_a_pulse_on_the_fold_of_the_period(self):
        """The same recording, codes rolled so that the period ends in the middle of the flight."""
        lab = one_leg()
        n = 1000
        counts = np.zeros((32, 32, n), dtype=np.int64)
        counts[:, :, : lab.signal.shape[2]] = lab.recording(1).counts
        # 1,000 codes of 50 ps make the period whole, so that rolling is a shift of the clock.
        whole = lab.histograms(counts, bin_width_ps=55.0, laser_period_ps=55_000.0)
        rolled = lab.histograms(
            np.roll(counts, -80, axis=2), bin_width_ps=55.0, laser_period_ps=55_000.0
        )
        source = replace(lab.known, emission_time_ps=2000.0 - 80 * 55.0)
        clock = type(lab.timing).nominal
        plain = fitted(lab, whole, timing=clock(whole))
        folded = fitted(lab, rolled, timing=clock(rolled), source=source)
        # Strengths of diffuse light settle to a tenth of their errors, the path to a hundredth.
        off = folded.legs[0].angle_deg - plain.legs[0].angle_deg
        assert abs(off) < 0.03 * plain.legs[0].angle_std_deg


@pytest.mark.usefixtures("nothing_twice")
class TestCamera:
    """What the camera does to the pulse: its shape, and photons hidden by earlier ones."""

    @staticmethod
    def pulls(recordings, timing) -> np.ndarray:
        lab = one_leg()
        paths = [fitted(lab, hist, timing=timing, n_legs=1) for hist in recordings]
        return np.array([(p.legs[0].angle_deg - 5.0) / p.legs[0].angle_std_deg for p in paths])

    @staticmethod
    def with_echoes(n):
        """A pulse and its echoes in the next codes: a tail whose counts are known exactly.

        `n` recordings, the clock that knows their response and one that takes it for a Gaussian.
        """
        lab, late = one_leg(), np.array([0.72, 0.1, 0.07, 0.05, 0.03, 0.02, 0.01])
        signal = sum(w * np.roll(lab.signal, k, axis=2) for k, w in enumerate(late))
        recordings = [
            lab.histograms(rng.poisson(4000.0 * signal + lab.background_per_code))
            for rng in map(np.random.default_rng, range(n))
        ]
        time = np.arange(-600.0, 1200.0)
        density = sum(
            w * np.exp(-0.5 * ((time - 55.0 * k) / 70.0) ** 2) for k, w in enumerate(late)
        )
        lateness = np.full(lab.camera.shape, 55.0 * float(late @ np.arange(7)))
        blunt = replace(lab.timing, skew_ps=lateness)
        return lab, recordings, replace(blunt, response_curve=np.stack([time, density])), blunt

    @pytest.mark.filterwarnings("ignore::lightflight.errors.SuspectDataWarning")
    def test_the_calibrated_response_is_the_shape_of_the_pulse(self):
        lab, recordings, shaped, _ = self.with_echoes(4)
        right = self.pulls(recordings, shaped)
        # Mean square of four pulls: 1 within 0.71; the mean of four within 0.5.
        assert np.mean(right**2) < 3.1
        assert abs(right.mean()) < 1.7
        assert fitted(lab, recordings[0], timing=shaped, n_legs=1).verdict.level == "trust"

    @pytest.mark.filterwarnings("ignore::lightflight.errors.SuspectDataWarning")
    @pytest.mark.long
    def test_another_response_than_the_calibrated_one_is_contradicted(self):
        """What echoes bring of a Gaussian's late light a halo nearly takes up, but not all."""
        lab, (recording,), _, blunt = self.with_echoes(1)
        assert fitted(lab, recording, timing=blunt, n_legs=1).verdict.level == "contradicted"

    @pytest.mark.usefixtures("unexamined")
    @pytest.mark.long
    def test_half_of_all_frames_occupied_at_one_period_per_frame(self):
        lab, frames = one_leg(), 30_000
        rate = (20_000.0 * lab.signal + lab.background_per_code) / frames
        first = np.exp(rate - np.cumsum(rate, axis=2)) * -np.expm1(-rate)
        outcome = np.concatenate([first, 1.0 - first.sum(axis=2, keepdims=True)], axis=2)
        counts = [np.random.default_rng(s).multinomial(frames, outcome)[..., :-1] for s in range(4)]
        given = {"n_frames": frames, "periods_per_frame": 1}
        told = [lab.histograms(one, **given) for one in counts]
        untold = [lab.histograms(counts[0])]
        right, wrong = (self.pulls(recordings, lab.timing) for recordings in (told, untold))
        # Of four pulls, as above.
        assert np.mean(right**2) < 3.1
        assert abs(right.mean()) < 1.7
        assert abs(wrong[0]) > 3.0

    def test_repeats_fill_as_many_frames_as_they_have_together(self):
        lab = one_leg()
        parts = [
            Sighting(
                hist, lab.timing, lf.find_arrivals(hist, timing=lab.timing), np.zeros(0),
                np.zeros(lab.camera.shape, bool),
            )
            for hist in (lab.recording(k, n_frames=50_000 * (k + 1)) for k in range(2))
        ]  # fmt: skip
        assert merged(parts).histograms.n_frames == 150_000
