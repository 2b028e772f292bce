"""Pulse fits: against a plain reference, under symmetries, and what each flag says."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from scipy.optimize import curve_fit
from scipy.special import ndtr

from lightflight import flags as fl
from lightflight.errors import NothingFoundError
from lightflight.recording.histograms import Histograms
from lightflight.timing.pulses import fits
from lightflight.timing.pulses.fits import widen_delays
from lightflight.timing.pulses.pulses import fit_pulses
from tests.pulse_fakes import STD, WIDTH, expected_counts, pulse_cube, reference_fit, wrapped

PERIOD = 908 * WIDTH


def fake_timing(lower, upper, *, period=None, shape=None, flags=None):
    """What `fit_pulses` asks of a calibration, for code intervals given outright."""
    n = len(lower)
    shape = shape or (1, n)
    return SimpleNamespace(
        shape=shape,
        laser_period_ps=period,
        response=None,
        has_flat=True,
        flags=np.zeros(shape, np.uint32) if flags is None else flags,
        phases=np.full((*shape, 1), 1.001),
        check_matches=lambda hist: None,
        code_intervals_ps=lambda rows, cols: (lower[cols], upper[cols]),
    )


def uneven_codes(rng, n_codes, *, dead=(), backward=False, start=0.0):
    """Code intervals of one pixel, unequal, dead ones without width: (lower, upper)."""
    widths = WIDTH * rng.uniform(0.3, 1.7, n_codes)
    widths[list(dead)] = 0.0
    edges = start + np.concatenate([[0.0], np.cumsum(widths)])
    lower, upper = edges[:-1], edges[1:]
    if backward:
        lower, upper = -upper, -lower
    return lower, upper


CASES: dict[str, dict[str, Any]] = {
    "plain": {},
    "no background": {"background": 0.0},
    "one photon per ten codes": {"photons": 300, "background": 0.1 / WIDTH},
    "bright": {"photons": 40_000.0},
    "wide pulse": {"std": 400.0, "photons": 5000},
    "narrow pulse": {"std": 25.0},
    "backward codes": {"backward": True, "delay": -6000.0},
    "on the fold": {"period": True, "delay": 20.0},
    "on the fold, backward": {"backward": True, "period": True, "delay": -35.0},
    "on dead codes": {"dead": [120, 121], "delay": 6600.0},
    "fold with lost time": {"period": True, "lost": 180.0, "delay": -90.0, "photons": 4000},
}


@pytest.mark.parametrize("name", CASES)
def test_fit_agrees_with_a_full_range_reference_in_uneven_codes(name, rng):
    case: dict[str, Any] = {
        "delay": 6000.0, "std": STD, "photons": 1000.0, "background": 1.0 / WIDTH, "dead": (),
        "backward": False, "period": False, "lost": 0.0, **CASES[name],
    }  # fmt: skip
    lower, upper = uneven_codes(rng, 240, dead=case["dead"], backward=case["backward"])
    span = upper.max() - lower.min()
    period = span + case["lost"] if case["period"] else np.inf
    truth = np.array([case[key] for key in ("delay", "std", "photons", "background")])
    delay, std, photons, background = truth
    counts = rng.poisson(expected_counts(lower, upper, delay, std, photons, background, period))
    hist = Histograms(counts[None, None], bin_width_ps=WIDTH)
    timing = fake_timing(lower[None], upper[None], period=period if case["period"] else None)

    pulses = fit_pulses(hist, timing=timing)
    best, covariance = reference_fit(counts, lower, upper, truth, period)

    assert len(pulses.row) == 1
    errors = np.sqrt(np.diag(covariance))
    widen_delays(best[np.newaxis], covariance[np.newaxis])
    stated = np.sqrt(np.diag(covariance))
    got = np.array([
        pulses.delay_ps[0], pulses.std_ps[0], pulses.photons[0], pulses.background_per_ps[0]
    ])  # fmt: skip
    off = got - best
    if case["period"]:
        off[0] = wrapped(off[0], period)
        assert 0.0 <= pulses.delay_ps[0] < period
    # Stopped at 1e-3 standard errors; at zero background the error of the background has no
    # meaning for the reference, so only its own size is asked for.
    if case["background"] > 0:
        assert np.all(np.abs(off) < 3e-3 * errors)
        assert np.sqrt(np.diag(pulses.covariance[0])) == pytest.approx(stated, rel=2e-3)
    else:
        assert np.all(np.abs(off[:3]) < 3e-3 * errors[:3])
        assert np.sqrt(np.diag(pulses.covariance[0]))[:2] == pytest.approx(stated[:2], rel=2e-2)
        assert 0.0 <= got[3] < 2.0 / span


def test_moving_all_codes_by_whole_codes_moves_the_delay_by_exactly_that(rng):
    hist = pulse_cube(rng, 40, [(rng.uniform(0, PERIOD, 40), 500)], 0.5)
    moved = Histograms(
        np.roll(hist.counts, 300, axis=2), bin_width_ps=WIDTH, laser_period_ps=PERIOD
    )
    before, after = fit_pulses(hist), fit_pulses(moved)
    off = wrapped(after.delay_ps - before.delay_ps - 300 * WIDTH, PERIOD)
    assert np.abs(off).max() < 1e-3 * np.sqrt(before.covariance[:, 0, 0]).min()
    assert after.photons == pytest.approx(before.photons, rel=1e-4)


def test_backward_codes_mirror_the_delay(rng):
    hist = pulse_cube(rng, 40, [(rng.uniform(0, PERIOD, 40), 500)], 0.5)
    mirrored = Histograms(
        hist.counts, bin_width_ps=WIDTH, laser_period_ps=PERIOD, reversed_codes=True
    )
    forward, backward = fit_pulses(hist), fit_pulses(mirrored)
    off = wrapped(forward.delay_ps + backward.delay_ps, PERIOD)
    assert np.abs(off).max() < 1e-3 * np.sqrt(forward.covariance[:, 0, 0]).min()


def test_codes_beyond_the_period_are_not_taken_for_dark_time(rng):
    """A backward clock with 1,024 codes and a period of 908: the last 116 cannot be reached."""
    delay = rng.uniform(0, PERIOD, 60)
    counts = np.zeros((1, 60, 1024), dtype=np.uint32)
    counts[..., :908] = pulse_cube(rng, 60, [(delay, 800)], 5.0).counts
    hist = Histograms(counts, bin_width_ps=WIDTH, laser_period_ps=PERIOD, reversed_codes=True)
    pulses = fit_pulses(hist)
    assert pulses.background_per_ps.mean() * WIDTH == pytest.approx(5.0, rel=0.01)
    off = wrapped(pulses.delay_ps + delay, PERIOD) / np.sqrt(pulses.covariance[:, 0, 0])
    assert np.abs(off).max() < 5


def test_threads_and_tiles_change_nothing(rng, monkeypatch):
    hist = pulse_cube(rng, 30, [(rng.uniform(0, PERIOD, 30), 400), (900.0, 200)], 0.3)
    whole = fit_pulses(hist)
    assert (np.bincount(whole.col) > 1).any()
    monkeypatch.setattr(fits, "TILE_CODES", 7 * 908)
    tiled = fit_pulses(hist, threads=2)
    for name in ("row", "col", "delay_ps", "std_ps", "photons", "covariance", "chi2", "flags"):
        np.testing.assert_array_equal(getattr(whole, name), getattr(tiled, name))


def test_no_photon_code_is_never_light(rng):
    delay = rng.uniform(2000, PERIOD - 2000, 30)
    hist = pulse_cube(rng, 30, [(delay, 500)], 0.2)
    counts = hist.counts.copy()
    counts[..., 0] = 10_000_000
    marked = Histograms(counts, bin_width_ps=WIDTH, laser_period_ps=PERIOD, no_photon_code=0)
    assert fit_pulses(marked).delay_ps == pytest.approx(fit_pulses(hist).delay_ps, abs=0.05)


def test_without_a_code_width_the_unit_is_codes(rng):
    hist = pulse_cube(rng, 20, [(rng.uniform(2000, 40_000, 20), 500)], 0.2, folds=False)
    in_codes = fit_pulses(Histograms(hist.counts))
    in_ps = fit_pulses(hist)
    assert in_codes.laser_period_ps is None
    assert in_codes.delay_ps * WIDTH == pytest.approx(in_ps.delay_ps, rel=1e-7)
    assert in_codes.covariance[:, 0, 0] * WIDTH**2 == pytest.approx(
        in_ps.covariance[:, 0, 0], rel=1e-4
    )


def test_least_squares_is_the_curve_fit_of_the_paper(rng):
    hist = pulse_cube(rng, 8, [(rng.uniform(2000, 5000, 8), 900)], 2.0, n_codes=128, folds=False)
    pulses = fit_pulses(hist, method="least_squares")
    middle = (np.arange(128) + 0.5) * WIDTH

    def model(t, delay, std, photons, background):
        z = (t - delay) / std
        return photons * WIDTH * np.exp(-0.5 * z**2) / std / np.sqrt(2 * np.pi) + background

    for i in range(8):
        start = (pulses.delay_ps[i] + 9.0, 80.0, 800.0, 1.0)
        best, _ = curve_fit(model, middle, hist.counts[0, i].astype(float), p0=start)
        assert pulses.delay_ps[i] == pytest.approx(best[0], abs=2e-2)
        assert pulses.std_ps[i] == pytest.approx(abs(best[1]), rel=1e-3)
        assert pulses.background_per_ps[i] * WIDTH == pytest.approx(best[3], rel=1e-3)
    assert pulses.method == "least_squares"


def test_scaled_intensities_give_the_same_times_and_errors_at_every_scale(rng):
    cube = pulse_cube(rng, 30, [(rng.uniform(2000, 5000, 30), 900)], 2.0, n_codes=128, folds=False)
    results = [
        fit_pulses(Histograms(cube.counts * scale, bin_width_ps=WIDTH, poisson=False))
        for scale in (1.0, 1e-4, 1e5)
    ]
    for other in results[1:]:
        assert other.delay_ps == pytest.approx(results[0].delay_ps, abs=1e-3)
        assert other.covariance[:, 0, 0] == pytest.approx(results[0].covariance[:, 0, 0], rel=1e-2)
    assert results[0].method == "least_squares"
    assert not (results[0].flags & fl.EXCLUDING).any()


def test_as_many_pulses_are_found_as_a_cavity_sends_into_a_pixel(rng):
    """Fourteen pulses 450 ps and more apart, 8 % weaker each; 40 pixels.

    A pull of 560 beyond 5 by chance: 3e-4. Their rms errs by 3 %, and 15 % are allowed.
    """
    delays = 3_000.0 + np.cumsum(np.tile([450.0, 2_050.0], 7))
    photons = 3_000.0 * 0.92 ** np.arange(14)
    hist = pulse_cube(rng, 40, list(zip(delays, photons, strict=True)), 0.02)
    pulses = fit_pulses(hist, max_pulses=100)
    assert (np.bincount(pulses.col) == 14).all()
    pull = (pulses.delay_ps.reshape(40, 14) - delays) / np.sqrt(
        pulses.covariance[:, 0, 0].reshape(40, 14)
    )
    assert np.abs(pull).max() < 5.0
    assert np.sqrt(np.mean(pull**2)) == pytest.approx(1.0, abs=0.15)
    np.testing.assert_array_equal(
        pulses.pulse_index.reshape(40, 14), np.tile(np.arange(14), (40, 1))
    )


def test_two_pulses_are_ordered_and_the_strongest_is_drawn(rng):
    hist = pulse_cube(rng, 50, [(4000.0, 300.0), (4430.0, 3000.0)], 0.2)
    pulses = fit_pulses(hist)
    assert np.bincount(pulses.col).tolist() == [2] * 50
    assert pulses.pulse_index.tolist() == [0, 1] * 50
    assert (pulses.flags & fl.MULTIPLE_PULSES).all()
    assert pulses.delay_ps[::2] == pytest.approx(4000.0, abs=30)
    assert pulses.std_ps[::2].tolist() == pulses.std_ps[1::2].tolist()
    assert pulses.image("delay_ps")[0] == pytest.approx(4430.0, abs=10)
    assert (pulses.image("n_pulses") == 2).all()
    assert np.bincount(fit_pulses(hist, max_pulses=1).col).max() == 1


def test_pulses_on_both_sides_of_the_fold_are_one_pulse(rng):
    pulses = fit_pulses(pulse_cube(rng, 50, [(5.0, 2000.0)], 0.2))
    assert len(pulses.row) == 50
    assert np.abs(wrapped(pulses.delay_ps - 5.0, PERIOD)).max() < 10


def test_each_flag_is_set_by_what_it_names(rng):
    n = 40
    hist = pulse_cube(rng, n, [(rng.uniform(2000, 40_000, n), 1500.0)], 0.1, folds=False)
    counts = hist.counts.copy()
    codes = np.arange(908) * WIDTH
    counts[0, 0] = 0
    counts[0, 1] = 0
    counts[0, 1, [30, 400, 700]] = 1
    counts[0, 2] = rng.poisson(0.2, 908)
    counts[0, 3] = rng.poisson(
        expected_counts(codes, codes + WIDTH, 20_000.0, 300.0, 1500.0, 0.002)
    )
    counts[0, 4] = rng.poisson(0.1, 908)
    counts[0, 4, 300] = 1500
    counts[0, 5] = rng.poisson(20.0, 908)
    counts[0, 6] = rng.poisson(expected_counts(codes, codes + WIDTH, 30.0, STD, 1500.0, 0.002))
    counts[0, 7, 500] = np.iinfo(np.uint16).max
    counts[0, 8] = rng.poisson(80.0, 908)
    mask = np.zeros((1, n), dtype=bool)
    mask[0, 9] = True
    hist = Histograms(counts.astype(np.uint16), bin_width_ps=WIDTH, n_frames=100_000)
    pulses = fit_pulses(hist, exclude_mask=mask)
    flags = pulses.image("flags")[0]
    expected = {
        0: fl.NO_PHOTONS | fl.DEAD, 1: fl.TOO_FEW, 2: fl.NO_PULSE, 3: fl.TOO_WIDE,
        4: fl.TOO_NARROW,
        5: fl.NO_PULSE | fl.ABNORMAL_COUNT, 6: fl.NEAR_GATE_EDGE, 9: fl.MASKED,
        8: fl.NO_PULSE | fl.ABNORMAL_COUNT | fl.SCREAMING,
    }  # fmt: skip
    for pixel, wanted in expected.items():
        got = flags[pixel] & ~np.uint32(fl.POOR_FIT)
        assert fl.names_from_flags(got) == fl.names_from_flags(wanted), pixel
    assert flags[7] & fl.SATURATED
    assert not flags[10:].any()
    assert np.isnan(pulses.delay_ps[pulses.col == 2]).all()
    assert np.isnan(pulses.covariance[pulses.col == 2]).all()
    assert pulses.background_per_ps[pulses.col == 2] * WIDTH == pytest.approx(0.2, abs=0.1)


def test_bright_pixels_and_moderately_wider_ones_are_not_called_abnormal(rng):
    n = 60
    photons = np.full(n, 300.0)
    photons[:5] = 60_000.0
    std = np.full((n, 1), STD)
    std[5:10] = 1.4 * STD
    codes = np.arange(908) * WIDTH
    delay = rng.uniform(2000, 40_000, (n, 1))
    mean = expected_counts(codes, codes + WIDTH, delay, std, photons[:, None], 0.05 / WIDTH)
    pulses = fit_pulses(Histograms(rng.poisson(mean)[None], bin_width_ps=WIDTH))
    assert not (pulses.flags & fl.EXCLUDING).any()
    assert np.bincount(pulses.col).max() == 1


def test_flags_of_the_calibration_reach_the_pulses(rng):
    lower = np.tile(np.arange(908) * WIDTH, (4, 1))
    upper = lower + WIDTH
    flags = np.zeros((1, 4), np.uint32)
    flags[0, 1], flags[0, 2] = fl.DEAD, fl.UNCALIBRATED
    lower[3], upper[3] = np.nan, np.nan
    hist = pulse_cube(rng, 4, [(5000.0, 800.0)], 0.1, folds=False)
    pulses = fit_pulses(hist, timing=fake_timing(lower, upper, flags=flags))
    assert [int(f) for f in pulses.flags] == [0, fl.DEAD, fl.UNCALIBRATED, fl.NO_PULSE]


def test_a_real_code_density_recording_shows_no_pulse(data_dir):
    path = data_dir / "pf32-codedensity-20mhz" / "pf32_codedensity_20mhz.npz"
    counts = np.load(path)["hist"]
    hist = Histograms(
        counts, bin_width_ps=55.0, laser_period_ps=1e12 / 20_000_040, n_frames=50_000,
        reversed_codes=True, no_photon_code=0,
    )  # fmt: skip
    pulses = fit_pulses(hist)
    assert len(pulses.row) == 1024
    assert (pulses.flags & fl.NO_PULSE).all()
    assert np.count_nonzero(pulses.flags & fl.SCREAMING) == 73


def test_a_background_recording_joins_the_likelihood(rng):
    """Its level is the ratio of frames; the error of the background shrinks as its counts say."""
    delay = rng.uniform(500, 3000, 400)
    lit = pulse_cube(rng, 400, [(delay, 300)], 0.5, n_codes=64, folds=False, n_frames=10_000)
    dark = Histograms(rng.poisson(2.0, lit.counts.shape), bin_width_ps=WIDTH, n_frames=40_000)
    alone, joined = fit_pulses(lit), fit_pulses(lit, background=dark)
    pull = (joined.background_per_ps * WIDTH - 0.5) / np.sqrt(joined.covariance[:, 3, 3]) / WIDTH
    assert abs(pull.mean()) < 0.2
    assert 0.87 < pull.std() < 1.13
    shrink = np.sqrt(joined.covariance[:, 3, 3] / alone.covariance[:, 3, 3])
    assert shrink.mean() == pytest.approx(np.sqrt(1 / 5.2), rel=0.05)
    time_pull = (joined.delay_ps - delay) / np.sqrt(joined.covariance[:, 0, 0])
    assert 0.87 < time_pull.std() < 1.13
    with pytest.raises(ValueError, match="n_frames of both"):
        fit_pulses(lit, background=Histograms(dark.counts, bin_width_ps=WIDTH))
    with pytest.raises(ValueError, match="same camera settings"):
        fit_pulses(lit, background=Histograms(dark.counts[:, :3], bin_width_ps=WIDTH, n_frames=1))


@pytest.mark.parametrize(
    ("change", "error", "words"),
    [
        ({"method": "magic"}, ValueError, 'method must be one of "likelihood", "least'),
        ({"max_pulses": 0}, ValueError, "max_pulses must be at least 1"),
        ({"threads": 0}, ValueError, "threads must be at least 1"),
        (
            {"exclude_mask": np.zeros((3, 3))},
            ValueError,
            "exclude_mask must have the",
        ),
    ],
)
def test_bad_options_raise_one_sentence(change, error, words, rng):
    hist = pulse_cube(rng, 4, [(5000.0, 800.0)], 0.1)
    with pytest.raises(error, match=words):
        fit_pulses(hist, **change)


def test_recordings_with_nothing_in_them_are_refused(rng):
    empty = Histograms(np.zeros((2, 2, 64), dtype=np.uint16), bin_width_ps=WIDTH)
    with pytest.raises(NothingFoundError, match="no photons"):
        fit_pulses(empty)
    hot = Histograms(rng.poisson(800.0, (2, 2, 64)), bin_width_ps=WIDTH, n_frames=60_000)
    with pytest.raises(NothingFoundError, match="hot or saturated"):
        fit_pulses(hot)
    counts = pulse_cube(rng, 30, [(600.0, 3000.0)], 1.0, n_codes=24, std=280.0).counts
    short = Histograms(counts, bin_width_ps=WIDTH, laser_period_ps=24 * WIDTH)
    with pytest.raises(NothingFoundError, match="fill the laser period"):
        fit_pulses(short)


def test_image_names_the_missing_column(rng):
    pulses = fit_pulses(pulse_cube(rng, 4, [(5000.0, 800.0)], 0.1))
    with pytest.raises(ValueError, match="no column 'delay'"):
        pulses.image("delay")


@settings(max_examples=20)
@given(
    data=st.data(),
    n_codes=st.sampled_from([1, 2, 5, 16, 64]),
    folds=st.booleans(),
    kind=st.sampled_from([np.uint8, np.uint16, np.uint32]),
)
def test_any_counts_give_a_finite_pulse_or_a_reason(data, n_codes, folds, kind):
    peak = data.draw(st.sampled_from([1, 3, 40, np.iinfo(kind).max]))
    seed = data.draw(st.integers(0, 2**32 - 1))
    numbers = np.random.default_rng(seed)
    counts = numbers.integers(0, int(peak) + 1, (2, 3, n_codes)).astype(kind)
    counts[numbers.random(counts.shape) < data.draw(st.sampled_from([0.0, 0.5, 0.95]))] = 0
    period: dict[str, Any] = {"laser_period_ps": n_codes * WIDTH} if folds else {}
    try:
        pulses = fit_pulses(Histograms(counts, bin_width_ps=WIDTH, **period))
    except NothingFoundError:
        return
    finite = (
        np.isfinite(pulses.delay_ps)
        & np.isfinite(pulses.std_ps)
        & np.isfinite(pulses.photons)
        & np.isfinite(pulses.covariance).all(axis=(1, 2))
    )
    assert (finite | ~pulses.usable).all()
    assert set(zip(pulses.row, pulses.col, strict=True)) == {
        (r, c) for r in (0, 1) for c in (0, 1, 2)
    }


def test_gaussian_tail_function_of_the_fakes_is_the_normal_integral():
    """The oracle's own anchor: a pulse in the middle of one wide code is all inside it."""
    lower, upper = np.array([-1000.0]), np.array([1000.0])
    assert expected_counts(lower, upper, 0.0, STD, 100.0, 0.5)[0] == pytest.approx(1100.0)
    half = expected_counts(np.array([0.0]), upper, 0.0, STD, 100.0, 0.0)[0]
    assert half == pytest.approx(100.0 * (ndtr(1000 / STD) - 0.5))


@pytest.mark.parametrize(("photons", "background"), [(50.0, 0.2), (100.0, 5.0), (1000.0, 1.0)])
def test_stated_errors_of_delays_hold_however_few_the_photons(rng, photons, background):
    """6,000 pulls: their width is known to 0.9 %; the information alone gives 1.035 at worst."""
    delay = rng.uniform(0, PERIOD, 6000)
    pulses = fit_pulses(pulse_cube(rng, 6000, [(delay, photons)], background), max_pulses=1)
    pull = wrapped(pulses.delay_ps - delay, PERIOD) / np.sqrt(pulses.covariance[:, 0, 0])
    assert np.std(pull[pulses.usable]) == pytest.approx(1.0, abs=0.028)
