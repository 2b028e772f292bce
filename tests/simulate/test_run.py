"""`simulate`: kinds, seeds, switches, metadata, and what it refuses."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.special import ndtr
from scipy.stats import chi2 as chi2_law

from lightflight import Camera, Source
from lightflight.errors import GeometryError
from lightflight.recording.counting import histogram
from lightflight.recording.recording import Recording
from lightflight.simulate import (
    Scene,
    angle_scene,
    ideal,
    paper_scene,
    pf32,
    simulate,
    spad256,
    streak,
)
from lightflight.simulate.recorder import occupied_frames
from tests.simulate.fakes import QUIET, SMALL, photons_of_events, small_scene

FALSE_ALARM = 1e-6


def drawn_frames(scene, **options) -> np.ndarray:
    frames = simulate(scene, kind="frames", **options).frames
    assert isinstance(frames, np.ndarray)
    return frames


# --- what a recording says of itself ----------------------------------------------------


def test_pf32_histograms_carry_the_camera_s_own_description():
    hist = simulate(paper_scene(), photons_per_pixel=400.0)
    assert hist.counts.shape == (32, 32, 1024)
    assert hist.counts.dtype == np.uint32
    assert (hist.bin_width_ps, hist.laser_period_ps) == (55.0, 50_000.0)
    assert hist.reversed_codes
    assert hist.no_photon_code == 0
    assert (hist.n_frames, hist.periods_per_frame) == (10_000, 4000)
    assert (hist.counts.sum(axis=2) == 10_000).all()
    assert hist.counts[..., 1:8].sum() == 0


def test_truth_says_where_the_pulse_was():
    scene = paper_scene()
    truth = simulate(scene, photons_per_pixel=10.0).truth
    assert truth.vertices_mm.shape == (4, 3)
    assert truth.emission_time_ps == 2000.0
    legs = np.linalg.norm(np.diff(truth.vertices_mm, axis=0), axis=1)
    np.testing.assert_allclose(
        np.diff(truth.vertex_times_ps), 1.00027 * legs / 0.299792458, rtol=1e-12
    )
    assert truth.expected_counts.max() == pytest.approx(10.0)
    np.testing.assert_allclose(truth.expected_leg_counts.sum(axis=0), truth.expected_counts)
    lower, upper = truth.code_intervals_ps()
    assert lower.shape == upper.shape == (32, 32, 1024)
    assert (upper >= lower).all()


def test_source_says_when_and_how_wide_where_it_knows():
    known = small_scene(source=Source(emission_time_ps=777.0, pulse_fwhm_ps=20.0))
    assert (known.emission_time_ps, known.pulse_fwhm_ps) == (777.0, 20.0)
    unknown = small_scene(true_emission_time_ps=123.0, true_pulse_fwhm_ps=30.0)
    assert (unknown.emission_time_ps, unknown.pulse_fwhm_ps) == (123.0, 30.0)


# --- seeds ------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", ["histograms", "code_density", "flat", "dark"])
def test_one_seed_is_one_recording(kind):
    scene = small_scene(pf32(crosstalk_probability=0.05))
    one, again, other = (
        simulate(scene, photons_per_pixel=300.0, seed=s, kind=kind) for s in (3, 3, 4)
    )
    np.testing.assert_array_equal(one.counts, again.counts)
    assert (one.counts != other.counts).any()


def test_threads_do_not_change_a_recording():
    scene = angle_scene(3.0, ideal(response_tail_fraction=0.1, response_tail_ps=100.0))
    # 700,000 photons: six chunks
    alone, many = (simulate(scene, photons_per_pixel=10_000.0, threads=n) for n in (1, 3))
    assert alone.photons.sum() > 4 * 131_072
    np.testing.assert_array_equal(alone.counts, many.counts)


def test_threads_do_not_change_raw_recordings():
    """Crosstalk too; more photons than two chunks hold."""
    scene = small_scene(pf32(**QUIET, crosstalk_probability=0.02))
    alone, many = (
        simulate(scene, photons_per_pixel=60_000.0, kind="events", threads=n) for n in (1, 3)
    )
    assert len(alone.code) > 2 * 131_072
    np.testing.assert_array_equal(alone.code, many.code)
    for one, other in zip(photons_of_events(alone), photons_of_events(many), strict=True):
        np.testing.assert_array_equal(one, other)


@pytest.mark.parametrize("kind", ["frames", "events"])
def test_raw_recordings_repeat_as_well(kind):
    scene = small_scene(pf32())
    one, again = (simulate(scene, photons_per_pixel=200.0, seed=9, kind=kind) for _ in range(2))
    np.testing.assert_array_equal(histogram(one).counts, histogram(again).counts)
    if kind == "frames":
        np.testing.assert_array_equal(one.frames, again.frames)
    else:
        np.testing.assert_array_equal(one.code, again.code)


# --- raw recordings ---------------------------------------------------------------------


def test_frames_and_events_are_the_same_photons():
    scene = small_scene(pf32())
    frames = simulate(scene, photons_per_pixel=800.0, seed=2, kind="frames")
    events = simulate(scene, photons_per_pixel=800.0, seed=2, kind="events")
    assert isinstance(frames, Recording)
    assert isinstance(frames.frames, np.ndarray)
    assert frames.frames.dtype == np.uint16
    assert frames.frames.shape == (20_000, 8, 8)
    assert events.n_photons == np.count_nonzero(frames.frames)
    np.testing.assert_array_equal(histogram(frames).counts, histogram(events).counts)


def test_frames_add_up_to_what_histograms_would_hold():
    scene = small_scene(pf32(screaming_fraction=0.05))
    frames = simulate(scene, photons_per_pixel=2000.0, seed=2, kind="frames")
    hist = simulate(scene, photons_per_pixel=2000.0, seed=3)
    a, b = histogram(frames).photons.astype(float), hist.photons.astype(float)
    # two independent recordings: differences within sqrt(a + b) or less, 64 pixels
    chi2 = ((a - b) ** 2 / (a + b)).sum()
    assert chi2 < chi2_law.isf(FALSE_ALARM, 64)
    assert a.sum() == pytest.approx(b.sum(), rel=6 * np.sqrt(2 / a.sum()))


def test_frames_come_in_random_order():
    # two pixels' photons must not keep to codes early or late in the recording
    frames = drawn_frames(small_scene(pf32(**QUIET)), photons_per_pixel=4000.0)
    half = len(frames) // 2
    early, late = (np.count_nonzero(part) for part in (frames[:half], frames[half:]))
    assert abs(early - late) < 6 * np.sqrt(early + late)
    codes = [part[part > 0].astype(float) for part in (frames[:half], frames[half:])]
    error = np.sqrt(sum(c.var() / len(c) for c in codes))
    assert abs(codes[0].mean() - codes[1].mean()) < 6 * error


def test_frames_may_be_written_where_the_user_wants(tmp_path):
    scene = small_scene(pf32())
    out = np.lib.format.open_memmap(
        tmp_path / "frames.npy", mode="w+", dtype=np.uint16, shape=(500, 8, 8)
    )
    seen = []
    recording = simulate(
        scene, photons_per_pixel=20.0, kind="frames", n_frames=500, frames_out=out,
        progress=lambda done, total: seen.append((done, total)),
    )  # fmt: skip
    assert recording.frames is out
    assert seen == [(1, 1)]
    plain = simulate(scene, photons_per_pixel=20.0, kind="frames", n_frames=500)
    np.testing.assert_array_equal(out, plain.frames)


def test_drift_is_seen_in_the_order_of_frames():
    detector = pf32(**QUIET, drift_ps=2000.0, response_fwhm_ps=10.0)
    frames = drawn_frames(small_scene(detector), photons_per_pixel=4000.0)
    part = len(frames) // 10
    first, last = (p[p > 0].astype(float).mean() for p in (frames[:part], frames[-part:]))
    # delays grow by 0.9 x 2000 ps between the middles of these parts; codes run backwards.
    # 10 % of 28,000 photons each, spread by drift within a block and by transit: < 0.1 code
    assert first - last == pytest.approx(0.9 * 2000.0 / 55.06, rel=0.15)


def test_events_of_a_camera_without_frames():
    recording = simulate(small_scene(), photons_per_pixel=300.0, kind="events")
    assert recording.frame_starts is None
    assert recording.n_frames is None
    assert histogram(recording).photons.sum() == recording.n_photons


def test_events_with_frames_may_hold_several_photons_each():
    detector = pf32(**QUIET, first_photon_only=False)
    recording = simulate(
        small_scene(detector), photons_per_pixel=5000.0, kind="events", n_frames=100
    )
    assert (recording.n_photons or 0) > 100 * 64
    assert (np.diff(np.asarray(recording.frame_starts).astype(np.int64)) >= 0).all()


# --- calibration recordings -------------------------------------------------------------


@pytest.mark.parametrize("dead_codes", ["absorbed", "lost"])
def test_code_density_counts_go_by_the_true_widths(dead_codes):
    detector = pf32(seed=2, dead_codes=dead_codes, **QUIET)
    hist = simulate(small_scene(detector), kind="code_density", photons_per_pixel=50_000.0)
    lower, upper = detector.true_code_intervals_ps((8, 8))
    width = upper - lower
    counts = hist.counts[..., 1:].astype(float)
    mean = hist.photons[..., None] * (width / width.sum(axis=-1, keepdims=True))[..., 1:]
    wide = mean > 5
    assert counts[mean == 0].sum() == 0
    chi2 = ((counts - mean)[wide] ** 2 / mean[wide]).sum()
    dof = wide.sum() - 64
    assert chi2_law.ppf(FALSE_ALARM, dof) < chi2 < chi2_law.isf(FALSE_ALARM, dof)
    assert hist.photons.mean() == pytest.approx(50_000.0, rel=6 / np.sqrt(50_000 * 64))


def test_code_density_holds_the_dark_counts_too_and_screams():
    detector = pf32(seed=0, dark_rate_hz=500.0, screaming_fraction=0.1)
    hist = simulate(small_scene(detector), kind="code_density", photons_per_pixel=20_000.0)
    screaming = hist.truth.screaming
    assert screaming.sum() == 6
    quiet = hist.photons[~screaming]
    # dark rates differ between pixels; their mean is allowed for in the light
    assert quiet.mean() == pytest.approx(20_000.0, rel=0.02)
    assert (np.asarray(hist.occupancy)[screaming] > 0.6).all()
    assert (np.asarray(hist.occupancy) <= 1.0).all()


def test_four_million_counts_per_pixel_are_drawn_at_once():
    hist = simulate(small_scene(pf32(**QUIET)), kind="code_density")
    assert hist.photons.mean() == pytest.approx(4e6, rel=1e-3)


@pytest.mark.parametrize("tail", [0.0, 0.3])
def test_flat_pulse_lies_at_its_arrival_plus_skew(tail):
    detector = pf32(seed=3, **QUIET, response_tail_fraction=tail, response_tail_ps=150.0)
    hist = simulate(
        small_scene(detector), kind="flat", photons_per_pixel=20_000.0, flat_arrival_ps=4321.0
    )
    assert hist.truth.flat_arrival_ps == 4321.0
    lower, upper = detector.true_code_intervals_ps((8, 8))
    middle = 0.5 * (lower + upper)
    counts = hist.counts.astype(float)
    counts[..., 0] = 0.0
    mean = (counts * middle).sum(axis=-1) / counts.sum(axis=-1)
    late = mean - detector.pixels((8, 8)).skew_ps - 4321.0
    # 20,000 photons of 70 ps: 0.5 ps; uneven codes add about 1 ps per pixel, 0.15 to the mean
    assert np.abs(late - tail * 150.0).max() < 8.0
    assert late.mean() == pytest.approx(tail * 150.0, abs=1.0)
    total = hist.photons.mean()
    # 4 % occupancy loses 2 %
    assert total == pytest.approx(20_000.0 * (1 - np.exp(-0.04)) / 0.04, rel=0.004)


def test_flat_codes_follow_the_distribution_of_the_pulse():
    detector = ideal(bin_width_ps=20.0, n_codes=2500, drift_ps=100.0)
    hist = simulate(
        small_scene(detector, source=Source(pulse_fwhm_ps=68.0)),
        kind="flat", photons_per_pixel=5000.0, flat_arrival_ps=49_990.0,
    )  # fmt: skip
    edges = np.arange(2501) * 20.0
    std = np.hypot(68.0, 150.0) / 2.3548200450309493
    share = np.zeros(2500)
    for shift in (np.arange(100) + 0.5) - 50.0:
        for fold in (0.0, -50_000.0):
            share += np.diff(ndtr((edges - 49_990.0 - shift - fold) / std)) / 100
    counts = hist.counts.sum(axis=(0, 1)).astype(float)
    mean = 64 * 5000.0 * share
    lit = mean > 5
    chi2 = ((counts - mean)[lit] ** 2 / mean[lit]).sum()
    assert chi2 < chi2_law.isf(FALSE_ALARM, lit.sum())
    assert counts[:20].sum() > 1000
    assert counts[-20:].sum() > 1000


def test_flat_may_reach_each_pixel_at_its_own_time():
    arrival = 4000.0 + 10.0 * np.arange(64).reshape(8, 8)
    hist = simulate(small_scene(), kind="flat", photons_per_pixel=2000.0, flat_arrival_ps=arrival)
    mean = (hist.counts * (np.arange(909) + 0.5) * 55.0).sum(axis=2) / hist.photons
    assert np.abs(mean - arrival).max() < 6 * 72.0 / np.sqrt(2000)


def test_flat_is_near_the_pulse_unless_told_otherwise():
    truth = simulate(small_scene(), kind="flat", photons_per_pixel=10.0).truth
    low, high = np.nanmin(truth.mean_arrival_ps), np.nanmax(truth.mean_arrival_ps)
    assert low - 100 < truth.flat_arrival_ps < high + 100
    assert truth.flat_arrival_ps % 100 == 0


def test_dark_recording_holds_no_signal():
    scene = small_scene(ideal(), background=500.0)
    hist = simulate(scene, kind="dark", seed=1)
    assert hist.truth.expected_counts.max() == 0
    assert hist.photons.mean() == pytest.approx(500.0, rel=6 / np.sqrt(64 * 500))


# --- background and lost photons --------------------------------------------------------


def test_background_is_what_was_asked_for_in_every_pixel():
    wanted = np.linspace(0.0, 4000.0, 64).reshape(8, 8)
    hist = simulate(small_scene(background=wanted), photons_per_pixel=1e-6, seed=1)
    chi2 = ((hist.photons - wanted)[wanted > 0] ** 2 / wanted[wanted > 0]).sum()
    assert hist.photons[0, 0] == 0
    assert chi2_law.ppf(FALSE_ALARM, 63) < chi2 < chi2_law.isf(FALSE_ALARM, 63)
    # uniform in time: 126,000 photons over 909 codes
    codes = hist.counts.sum(axis=(0, 1)).astype(float)
    chi2 = ((codes - codes.mean()) ** 2 / codes.mean()).sum()
    assert chi2 < chi2_law.isf(FALSE_ALARM, 908)


@pytest.mark.parametrize("level", [600.0, 6000.0])
def test_few_and_many_background_counts_follow_the_true_widths(level):
    detector = pf32(seed=3, **QUIET, first_photon_only=False)
    scene = small_scene(detector, background=level)
    hist = simulate(scene, kind="dark", seed=5, n_frames=10**6)
    lower, upper = detector.true_code_intervals_ps((8, 8))
    mean = level * (upper - lower).reshape(64, -1)[:, 1:].T / 50_000.0
    counts = hist.counts.reshape(64, -1)[:, 1:].T.astype(float)
    # phases differ between pixels: sum over the codes of each phase in each pixel
    phase = np.arange(1, 1024) % 8
    m = np.array([mean[phase == k].sum(axis=0) for k in range(8)])
    c = np.array([counts[phase == k].sum(axis=0) for k in range(8)])
    chi2 = ((c - m) ** 2 / m).sum()
    assert chi2_law.ppf(FALSE_ALARM, m.size) < chi2 < chi2_law.isf(FALSE_ALARM, m.size)


@pytest.mark.parametrize("photons", [200.0, 40_000.0])
def test_first_photon_of_a_frame_shuts_out_the_others(photons):
    detector = pf32(seed=1, **QUIET)
    n_frames = int(photons)
    hist = simulate(small_scene(detector), photons_per_pixel=photons, n_frames=n_frames, seed=4)
    expected = hist.truth.expected_counts
    wanted = n_frames * -np.expm1(-expected / n_frames)
    lit = wanted > 20
    odds = wanted / n_frames
    chi2 = ((hist.photons - wanted) ** 2 / (wanted * (1 - odds) + 1e-9))[lit].sum()
    assert odds.max() > 0.6
    assert chi2_law.ppf(FALSE_ALARM, lit.sum()) < chi2 < chi2_law.isf(FALSE_ALARM, lit.sum())


def test_first_photons_are_signal_and_background_by_their_shares():
    scene = small_scene(pf32(seed=1, **QUIET), background=3000.0)
    hist = simulate(scene, photons_per_pixel=3000.0, n_frames=5000, seed=4)
    raw = hist.truth.expected_counts + 3000.0
    kept = -np.expm1(-raw / 5000) * 5000 / raw
    clean = hist.truth.expected_counts < 1e-6
    assert hist.photons[clean].mean() == pytest.approx(
        3000.0 * kept[clean].mean(), rel=6 * 0.02 / np.sqrt(clean.sum())
    )
    # counts between arrival +- 5 sigma in the brightest pixel, background there taken off
    lower, upper = hist.truth.code_intervals_ps()
    row, col = divmod(int(np.argmax(raw)), 8)
    at = hist.truth.mean_arrival_ps[0, row, col] + hist.truth.skew_ps[row, col]
    near = (lower[row, col] > at - 400) & (upper[row, col] < at + 400)
    near[0] = False
    flat = 3000.0 * (upper - lower)[row, col][near].sum() / 50_000.0
    wanted = kept[row, col] * (3000.0 + flat)
    assert hist.counts[row, col][near].sum() == pytest.approx(wanted, rel=6 / np.sqrt(wanted))


@pytest.mark.parametrize(
    ("photons", "frames"),
    # thrown one by one; Gaussian number of frames; Poisson number lost
    [(3, 4), (50, 40), (10, 1), (4000, 3000), (60_000, 20_000), (900, 20_000), (4000, 400_000)],
)
def test_occupied_frames_have_the_right_mean_and_spread(photons, frames):
    # 4000 draws against exact moments: means to 6 standard errors, variances to 6.7
    drawn = occupied_frames(np.full(4000, photons), frames, np.random.default_rng(1)).astype(float)
    q1, q2 = (1 - 1 / frames) ** photons, (max(1 - 2 / frames, 0.0)) ** photons
    mean = frames * (1 - q1)
    variance = frames * q1 * (1 - q1) + frames * (frames - 1) * (q2 - q1**2)
    tolerance = 6 * np.sqrt(max(variance, 0.0) / 4000) + 0.02
    assert drawn.mean() == pytest.approx(mean, abs=tolerance)
    assert drawn.var() == pytest.approx(variance, rel=0.15, abs=0.05)
    assert drawn.max() <= min(photons, frames)
    assert drawn.min() >= 1


def test_no_photons_occupy_no_frames():
    drawn = occupied_frames(np.array([0, 5, 0]), 10**6, np.random.default_rng(1))
    np.testing.assert_array_equal(drawn > 0, [False, True, False])
    many = occupied_frames(np.array([0, 10**7]), 10**6, np.random.default_rng(1))
    assert many[0] == 0
    assert 999_900 < many[1] <= 10**6


# --- every defect changes what it should, and nothing else ------------------------------


def counts_with(**defects):
    base = {"bin_width_ps": 50.0, "n_codes": 1000}
    return simulate(small_scene(ideal(**(base | defects))), photons_per_pixel=3000.0, seed=6)


@pytest.mark.parametrize(
    "defects",
    [
        {"skew_range_ps": 300.0},
        {"gain_rms": 0.01},
        {"phase_rms": 0.05, "phase_pattern": (1.1, 0.9)},
        {"response_fwhm_ps": 300.0},
        {"trigger_jitter_fwhm_ps": 100.0},
        {"response_tail_fraction": 0.2, "response_tail_ps": 300.0},
        {"drift_ps": 500.0},
        {"reversed_codes": True},
    ],
)
def test_defects_of_the_clock_move_photons_between_codes_only(defects):
    plain, defective = counts_with(), counts_with(**defects)
    np.testing.assert_array_equal(plain.photons, defective.photons)
    assert (plain.counts != defective.counts).any()


def test_reversed_clock_counts_backwards():
    plain, reverse = counts_with(), counts_with(reversed_codes=True)
    np.testing.assert_array_equal(plain.counts, reverse.counts[..., ::-1])


def test_dead_codes_that_are_lost_lose_their_light():
    kept = counts_with()
    lost = counts_with(first_live_code=80, dead_time_is_lost=True)
    # codes 0 to 79 hold delays up to 4000 ps
    np.testing.assert_array_equal(lost.counts[..., 80:], kept.counts[..., 80:])
    assert lost.counts[..., :80].sum() == 0
    assert kept.counts[..., :80].sum() > 0


def test_dead_codes_that_are_absorbed_lose_nothing():
    kept = counts_with()
    absorbed = counts_with(first_live_code=8)
    np.testing.assert_array_equal(absorbed.counts[..., 8:], kept.counts[..., :-8])


def test_sensitivity_thins_each_pixel_alone():
    plain = counts_with()
    efficiency = np.ones((8, 8))
    efficiency[:, 2] = 0.0
    efficiency[:, 5] = 0.5
    thinned = counts_with(efficiency_map=efficiency)
    others = [0, 1, 3, 4, 6, 7]
    np.testing.assert_array_equal(plain.truth.expected_counts[:, others],
                                  thinned.truth.expected_counts[:, others])  # fmt: skip
    assert thinned.photons[:, 2].sum() == 0
    assert thinned.truth.expected_counts[:, 2].sum() == 0
    half = thinned.photons[:, 5].sum() / thinned.truth.expected_counts[:, 5].sum()
    assert half == pytest.approx(1.0, abs=6 / np.sqrt(thinned.photons[:, 5].sum()))


def test_crosstalk_adds_to_the_neighbours():
    plain, crossed = counts_with(), counts_with(crosstalk_probability=0.2)
    expected = plain.truth.expected_counts
    padded = np.pad(expected, 1)
    neighbours = padded[:-2, 1:-1] + padded[2:, 1:-1] + padded[1:-1, :-2] + padded[1:-1, 2:]
    wanted = expected + 0.05 * neighbours
    lit = wanted > 5
    chi2 = ((crossed.photons - wanted)[lit] ** 2 / wanted[lit]).sum()
    assert chi2_law.ppf(FALSE_ALARM, lit.sum()) < chi2 < chi2_law.isf(FALSE_ALARM, lit.sum())
    np.testing.assert_array_equal(crossed.truth.expected_counts, expected)


def test_of_photons_that_meet_in_one_pixel_and_frame_one_is_kept():
    background = np.full((8, 8), 900.0)
    crossed, plain = (
        simulate(
            small_scene(pf32(**QUIET, crosstalk_probability=p), background=background),
            kind="events",
            seed=2,
            photons_per_pixel=1.0,
            n_frames=2000,
        )
        for p in (0.8, 0.0)
    )
    frame, row, col = photons_of_events(crossed)
    place = frame * 64 + row * 8 + col
    assert len(np.unique(place)) == len(place)
    n_plain = len(photons_of_events(plain)[0])
    # an empty place is filled where at least one of its k neighbours fires and reaches it
    share = n_plain / (2000 * 64)
    padded = np.pad(np.ones((8, 8)), 1)
    k = padded[:-2, 1:-1] + padded[2:, 1:-1] + padded[1:-1, :-2] + padded[1:-1, 2:]
    wanted = n_plain + 2000 * np.sum((1 - share) * (1 - (1 - 0.2 * share) ** k))
    assert len(place) == pytest.approx(wanted, rel=0.01)


def test_crosstalk_of_the_dark_counts_and_the_flat():
    one = np.zeros((8, 8))
    one[3, 3] = 80_000.0
    scene = small_scene(ideal(crosstalk_probability=0.1), background=one)
    hist = simulate(scene, kind="dark", seed=2)
    assert hist.photons[3, 4] == pytest.approx(2000.0, abs=6 * np.sqrt(2000))
    assert hist.photons[5, 5] == 0
    flat = simulate(small_scene(ideal(crosstalk_probability=0.1)), kind="flat", seed=2,
                    photons_per_pixel=10_000.0)  # fmt: skip
    assert flat.photons[3, 3] == pytest.approx(11_000.0, abs=6 * np.sqrt(11_000))
    assert flat.photons[0, 0] == pytest.approx(10_500.0, abs=6 * np.sqrt(10_500))


def test_afterpulses_follow_their_photons():
    plain = counts_with()
    after = counts_with(afterpulse_probability=0.1, afterpulse_time_ps=3000.0)
    n, extra = plain.photons.sum(), after.photons.sum() - plain.photons.sum()
    assert extra == pytest.approx(0.1 * n, abs=6 * np.sqrt(0.09 * n))
    late = after.counts.astype(np.int64) - plain.counts
    assert (late >= 0).all()
    codes = late.sum(axis=(0, 1))
    start = (plain.counts.sum(axis=(0, 1)) * np.arange(1000)).sum() / n
    # within one mean time: 63 %
    soon = codes[: int(start + 3000 / 50)].sum() / extra
    assert soon == pytest.approx(1 - np.exp(-1), abs=6 * 0.5 / np.sqrt(extra))


def test_afterpulses_of_a_first_photon_camera_are_never_first():
    scene = [small_scene(pf32(**QUIET, afterpulse_probability=p)) for p in (0.0, 0.5)]
    a, b = (simulate(s, photons_per_pixel=500.0) for s in scene)
    np.testing.assert_array_equal(a.counts, b.counts)


def test_dark_counts_and_screaming_pixels_come_at_their_rates():
    detector = pf32(seed=8, dark_rate_hz=1000.0, screaming_fraction=0.1)
    hist = simulate(small_scene(detector), kind="dark", n_frames=20_000)
    defects = detector.pixels((8, 8))
    mean = -np.expm1(-defects.dark_rate_hz * 200e-6)
    z = (hist.photons / 20_000 - mean) / np.sqrt(mean * (1 - mean) / 20_000)
    assert np.abs(z).max() < 6
    assert (hist.photons[defects.screaming] > 0.59 * 20_000).all()
    assert np.median(defects.dark_rate_hz) == pytest.approx(1000.0, rel=0.5)


# --- other cameras ----------------------------------------------------------------------


def test_gate_of_a_gated_array_loses_what_comes_outside_it():
    camera = Camera.facing_plane((64, 64), field_of_view_mm=(245.0, 245.0))
    scene = Scene([(-200, 0, 0), (200, 0, 0)], camera=camera,
                  detector=spad256(**QUIET, first_edge_ps=3000.0))  # fmt: skip
    hist = simulate(scene, photons_per_pixel=200.0)
    assert hist.counts.shape == (64, 64, 512)
    assert hist.first_edge_ps == 3000.0
    assert hist.photons.sum() > 0.9 * hist.truth.expected_counts.sum()
    late = Scene([(-200, 0, 0), (200, 0, 0)], camera=camera,
                 detector=spad256(**QUIET, first_edge_ps=30_000.0))  # fmt: skip
    assert simulate(late, photons_per_pixel=200.0).photons.sum() == 0


def test_streak_camera_sweeps_once():
    scene = small_scene(streak(first_edge_ps=3800.0), source=Source(pulse_fwhm_ps=5.0))
    hist = simulate(scene, photons_per_pixel=500.0)
    assert hist.laser_period_ps is None
    assert hist.photons.sum() == pytest.approx(hist.truth.expected_counts.sum(), rel=0.05)
    row, col = divmod(int(np.argmax(hist.truth.expected_counts)), 8)
    times = 3800.0 + 2.0 * (np.arange(1024) + 0.5)
    mean = np.average(times, weights=hist.counts[row, col])
    assert mean == pytest.approx(hist.truth.mean_arrival_ps[0, row, col], abs=6 * 20 / np.sqrt(450))


# --- what it refuses --------------------------------------------------------------------


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"kind": "video"}, "kind must be one of"),
        ({"photons_per_pixel": 0.0}, "photons_per_pixel must be positive"),
        ({"photons_per_pixel": float("nan")}, "photons_per_pixel must be positive"),
        ({"n_frames": 100}, "detector has no frames"),
        ({"seed": -1}, "seed must be >= 0"),
        ({"kind": "frames"}, "cannot write frames"),
        ({"kind": "flat", "flat_arrival_ps": np.zeros(3)}, "flat_arrival_ps must be one"),
        ({"frames_out": np.zeros((1, 8, 8), np.uint16)}, "frames_out is for"),
    ],
)
def test_calls_that_make_no_sense(changes, message):
    with pytest.raises(ValueError, match=message):
        simulate(small_scene(), **changes)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"n_frames": 0}, "n_frames must be"),
        ({"kind": "code_density", "photons_per_pixel": 100.0, "n_frames": 100}, "do not fit into"),
        (
            {"kind": "frames", "n_frames": 10, "frames_out": np.zeros((9, 8, 8), np.uint16)},
            "frames_out must be",
        ),
    ],
)
def test_calls_that_frames_forbid(changes, message):
    with pytest.raises(ValueError, match=message):
        simulate(small_scene(pf32()), **changes)


def test_camera_that_does_not_see_the_path_is_said_so():
    scene = Scene([(0.0, 900.0, 0.0), (10.0, 900.0, 0.0)], camera=SMALL)
    with pytest.raises(GeometryError, match="no pixel catches light"):
        simulate(scene)
    behind = Scene([(0.0, 0.0, 600.0), (10.0, 0.0, 700.0)], camera=SMALL)
    with pytest.raises(GeometryError, match="no pixel catches light"):
        simulate(behind)
