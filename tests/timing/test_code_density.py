"""Code density: the numbers of a known clock come back, with their errors."""

import numpy as np
import pytest

from lightflight import flags
from lightflight.errors import CalibrationError, SuspectDataWarning
from lightflight.recording.histograms import Histograms
from lightflight.timing.calibrate.code_density import fit_code_density, pixel_flags
from lightflight.timing.calibrate.code_pattern import drawn_to_mean, find_pattern_length
from lightflight.timing.calibrate.period_end import live_fraction
from tests.clock_fakes import PERIOD_PS, PF32_PATTERN, fake_clock


@pytest.mark.parametrize("n_phases", [1, 3, 8, 16])
def test_pattern_length_is_found(rng, n_phases):
    pattern = 1.0 + 0.05 * np.cos(2.0 * np.pi * np.arange(n_phases) / max(n_phases, 2)) ** 3
    pattern = pattern + (0.04 * (np.arange(n_phases) == 0) if n_phases > 1 else 0.0)
    clock = fake_clock(rng, (8, 8), pattern=tuple(pattern), own_std=0.0)
    counts = clock.uniform(rng, 40_000).counts.reshape(64, -1)
    assert find_pattern_length(counts, start=24, stop=860) == n_phases


def test_pattern_that_only_the_whole_array_shows(rng):
    # 200 photons per pixel: 25 per phase, four times the noise of the pattern
    clock = fake_clock(rng, (16, 16), own_std=0.0)
    fit = fit_code_density(clock.uniform(rng, 400))
    assert fit.n_phases == 8
    # its error is 1 / sqrt(400 * 256 / 8) = 0.9 %: 5 sigma of eight, chance 5e-6
    np.testing.assert_allclose(fit.phases.mean(axis=(0, 1)), PF32_PATTERN, atol=0.045)


@pytest.mark.parametrize("reversed_codes", [True, False])
@pytest.mark.parametrize("lost", [True, False])
def test_numbers_of_a_clock_come_back_with_their_errors(rng, reversed_codes, lost):
    clock = fake_clock(rng, reversed_codes=reversed_codes, lost=lost)
    fit = fit_code_density(clock.uniform(rng, 1e6))
    assert fit.structured
    assert fit.n_phases == 8
    assert fit.first_live_code == 8
    assert fit.dead_codes == tuple(range(8))
    assert len(fit.end_widths) == 0
    codes = (fit.codes_lost if lost else fit.codes_absorbed).ravel()
    std = (fit.lost_std if lost else fit.absorbed_std).ravel()
    pull = (codes - PERIOD_PS / clock.width_ps) / std
    # 256 pixels: the width of pulls is known to 0.044, their mean to 0.063
    assert abs(pull.std() - 1.0) < 0.22
    assert abs(pull.mean()) < 0.35
    phase_pull = (fit.phases.reshape(-1, 8) - clock.phases) / fit.phase_std.reshape(-1, 8)
    assert abs(phase_pull.std() - 1.0) < 0.09
    assert std.max() < 0.05
    np.testing.assert_allclose(fit.phase_spread, 0.03, rtol=0.1)


def test_goodness_is_that_of_chance(rng):
    fit = fit_code_density(fake_clock(rng).uniform(rng, 1e6))
    z = (fit.chi2 - fit.dof) / np.sqrt(2.0 * fit.dof)
    assert abs(z.mean()) < 0.35
    assert abs(z.std() - 1.0) < 0.22
    assert not fit.misfit_std.any()
    assert not fit.flags.any()


def test_first_live_code_of_its_own_width_in_each_pixel(rng):
    clock = fake_clock(rng, start_std=0.4)
    fit = fit_code_density(clock.uniform(rng, 1e6))
    true = (clock.upper - clock.lower)[:, 8] / clock.width_ps
    np.testing.assert_allclose(fit.first_live_width.ravel(), true, atol=0.25)
    pull = (fit.codes_absorbed.ravel() - PERIOD_PS / clock.width_ps) / fit.absorbed_std.ravel()
    assert abs(pull.std() - 1.0) < 0.22


def test_smooth_trend_goes_into_shared_widths(rng):
    clock = fake_clock(rng, trend=0.02)
    fit = fit_code_density(clock.uniform(rng, 1e6))
    code = np.arange(30, 860)
    slope = np.polyfit(code / 900.0, fit.code_widths[code], 1)[0]
    assert slope == pytest.approx(0.02, abs=0.001)
    assert not fit.misfit_std.any()


def test_codes_before_the_end_of_the_period_have_widths_of_their_own(rng):
    """All codes differ by 4 %, and where a tenth of the pixels' periods have ended as everywhere.

    A pixel counts 700 photons a code: the pixels that see the last of these make 0.5 % or less.
    Where the codes were as wide as the others it would be 4 %.
    """
    own = 1.0 + 0.04 * rng.normal(size=330)
    widths = own * (1.0 + 0.01 * rng.normal(size=(256, 1)))
    edges = np.minimum(np.cumsum(np.pad(50.0 * widths, ((0, 0), (1, 0))), axis=1), 15_000.0)
    counts = rng.poisson(2e5 * np.diff(edges) / 15_000.0).reshape(16, 16, -1)
    fit = fit_code_density(Histograms(counts, bin_width_ps=50.0, laser_period_ps=15_000.0))
    assert fit.period_end_seen
    plain, last = np.arange(20, 270), np.arange(280, 296)
    found = fit.code_widths / fit.code_widths[plain].mean()
    off = (found / (own / own[plain].mean()) - 1.0)[last]
    assert np.sqrt(np.mean(off**2)) < 0.015


def test_ringing_near_the_end_of_the_period_is_measured(rng):
    def near_end(codes):
        return 1.0 - 0.06 * np.exp(-0.5 * ((codes - 9.0) / 3.0) ** 2)

    clock = fake_clock(rng, near_end=near_end)
    fit = fit_code_density(clock.uniform(rng, 2e5))
    assert 9 < len(fit.end_widths) < 40
    distance = np.arange(4, 13)
    np.testing.assert_allclose(fit.end_widths[distance], near_end(distance + 0.5), atol=0.012)
    code = np.arange(860, 915)
    inside = (clock.upper - clock.lower)[:, code] > 0.5 * clock.width_ps[:, None]
    true = (clock.upper - clock.lower)[:, code] / clock.width_ps[:, None]
    phase = fit.phases.reshape(-1, 8)[:, code % 8]
    end = fit.end_code.reshape(-1, 1)
    model = phase * np.interp(end - code - 0.5, distance + 0.5, fit.end_widths[distance], right=1)
    near = inside & (end - code > 5) & (end - code < 15)
    # phases are known to 0.6 %; without the ringing 3 % would remain
    assert np.std(model[near] / true[near]) < 0.012


def test_free_widths_where_no_pattern_suffices(rng):
    clock = fake_clock(rng, (6, 6), free_std=0.1)
    fit = fit_code_density(clock.uniform(rng, 1e6))
    assert not fit.structured
    assert fit.n_phases == 1024
    true = (clock.upper - clock.lower)[:, 20:860]
    measured = fit.phases.reshape(36, -1)[:, 20:860]
    ratio = measured / true
    ratio = ratio / ratio.mean(axis=1, keepdims=True)
    assert ratio.std() == pytest.approx(1.0 / np.sqrt(1e6 / 906.0), rel=0.05)


def test_small_misfit_keeps_the_pattern_and_is_stated(rng):
    clock = fake_clock(rng, (12, 12), free_std=0.01)
    fit = fit_code_density(clock.uniform(rng, 4e6))
    assert fit.structured
    assert np.median(fit.misfit_std) == pytest.approx(0.01, rel=0.1)


def test_bad_pixels_are_flagged_and_hold_what_is_typical(rng):
    clock = fake_clock(rng)
    photons = np.full(256, 20_000.0)
    photons[[3, 77]] = 49_000.0
    photons[10] = 0.0
    photons[11] = 30.0
    fit = fit_code_density(clock.uniform(rng, photons, n_frames=50_000, periods_per_frame=4000))
    words = fit.flags.ravel()
    assert (words[[3, 77]] == flags.SCREAMING).all()
    assert words[10] == flags.NO_PHOTONS | flags.DEAD | flags.UNCALIBRATED
    assert words[11] == flags.DEAD | flags.UNCALIBRATED
    assert np.count_nonzero(words) == 4
    for name in ("codes_lost", "end_code", "phases"):
        assert np.isfinite(getattr(fit, name)).all()
    assert fit.lost_std.ravel()[10] == pytest.approx(0.0065 * 906, rel=0.2)


def test_screaming_is_relative_to_the_array():
    # a calibration at 70 % occupancy is bright, not screaming
    photons = np.full(100, 70_000.0)
    photons[5] = 99_500.0
    words = pixel_flags(photons, n_frames=100_000)
    assert np.flatnonzero(words).tolist() == [5]
    assert np.flatnonzero(pixel_flags(photons, n_frames=None)).tolist() == []
    photons[5] = 700_000.0
    assert np.flatnonzero(pixel_flags(photons, n_frames=None)).tolist() == [5]


def test_result_does_not_depend_on_pixel_order(rng):
    hist = fake_clock(rng, (8, 8)).uniform(rng, 1e5)
    order = rng.permutation(64)
    shuffled = Histograms(
        hist.counts.reshape(64, 1, -1)[order], bin_width_ps=55.0, laser_period_ps=PERIOD_PS,
        reversed_codes=True, no_photon_code=0,
    )  # fmt: skip
    fit, other = fit_code_density(hist), fit_code_density(shuffled)
    np.testing.assert_allclose(
        other.codes_absorbed.ravel(), fit.codes_absorbed.ravel()[order], rtol=1e-6
    )


def test_one_pixel_suffices(rng):
    clock = fake_clock(rng, (1, 1))
    fit = fit_code_density(clock.uniform(rng, 1e6))
    assert fit.n_phases == 8
    pull = (fit.codes_absorbed - PERIOD_PS / clock.width_ps) / fit.absorbed_std
    assert abs(pull.item()) < 5.0


def test_codes_that_stop_before_the_period_show_no_end(rng):
    fit = fit_code_density(
        fake_clock(rng, (8, 8), n_codes=800, first_live=0, start=()).uniform(rng, 1e5)
    )
    assert not fit.period_end_seen
    assert fit.first_live_code == 0


def test_a_flat_is_refused(rng):
    clock = fake_clock(rng, (4, 4))
    with pytest.raises(CalibrationError, match=r"holds a pulse near code 8\d\d"):
        fit_code_density(clock.pulse(rng, 2000.0, 1e5))


def test_no_usable_pixel_is_refused(rng):
    hist = fake_clock(rng, (4, 4)).uniform(rng, 20)
    with pytest.raises(CalibrationError, match="no pixel of the code-density recording"):
        fit_code_density(hist)


def test_pile_up_within_a_period_is_said(rng):
    hist = fake_clock(rng, (4, 4)).uniform(rng, 30_000, n_frames=100_000, periods_per_frame=2)
    with pytest.warns(SuspectDataWarning, match="photons per pixel and laser period"):
        fit_code_density(hist)


def test_live_fraction_equals_its_integral(rng):
    from scipy.integrate import quad
    from scipy.stats import norm

    end = np.array([10.3, 12.0])
    for blur in (0.01, 0.3, 2.0):
        got = live_fraction(end, np.arange(8.0, 16.0), blur)
        for i, place in enumerate(end):
            for j in range(7):
                code = 8.0 + j
                want = quad(
                    lambda u, p=place, b=blur: norm.cdf((p - u) / b), code, code + 1, points=[place]
                )[0]
                assert got[i, j] == pytest.approx(want, abs=1e-7)


def test_drawing_to_the_mean_lowers_the_error(rng):
    true = rng.normal(1.0, 0.03, (4000, 1))
    std = np.full_like(true, 0.06)
    seen = true + std * rng.normal(size=true.shape)
    value, value_std, spread = drawn_to_mean(seen, std, np.ones(4000, bool))
    assert spread == pytest.approx(0.03, rel=0.15)
    assert (value - true).std() < 0.5 * (seen - true).std()
    assert ((value - true) / value_std).std() == pytest.approx(1.0, abs=0.06)
