"""The clock of a real camera (PF32, uncorrelated light): figures anyone can recompute."""

import numpy as np
import pytest

import lightflight as lf
from lightflight import flags
from lightflight.errors import UncalibratedWarning
from lightflight.timing.calibrate.code_density import fit_code_density

PATTERN = (1.036, 0.922, 0.990, 1.096, 0.968, 0.982, 0.936, 1.069)


def _histograms(counts, n_frames):
    return lf.Histograms(
        counts, bin_width_ps=55.0, laser_period_ps=1e12 / 20_000_040, n_frames=n_frames,
        periods_per_frame=2000, reversed_codes=True, no_photon_code=0,
    )  # fmt: skip


@pytest.fixture(scope="module")
def recording(data_dir):
    folder = data_dir / "pf32-codedensity-20mhz"
    if not folder.is_dir():
        pytest.skip(f"no {folder.name} in {data_dir}")
    with np.load(folder / "pf32_codedensity_20mhz.npz") as file:
        return _histograms(file["hist"], int(file["n_frames"]))


@pytest.fixture(scope="module")
def fit(recording):
    return fit_code_density(recording)


@pytest.fixture(scope="module")
def timings(recording):
    """By where dead codes leave their time, without a flat."""
    found = {}
    for dead_codes in ("absorbed", "lost", None):
        with pytest.warns(UncalibratedWarning, match="no flat"):
            found[dead_codes] = lf.calibrate_timing(recording, dead_codes=dead_codes)
    return found


def test_mean_code_under_both_hypotheses(timings):
    # 55.06 and 54.67 ps from the counts over the plateau and the end of the array's sum
    widths = {}
    for dead_codes, timing in timings.items():
        widths[dead_codes] = timing.bin_width_ps
        assert timing.notes[0].startswith("mean code 55.05 ps if")
        assert "54.65 ps if it is lost" in timing.notes[0]
    assert widths["absorbed"] == pytest.approx(55.06, abs=0.02)
    assert widths["lost"] == pytest.approx(54.67, abs=0.02)
    assert widths[None] == pytest.approx(0.5 * (55.06 + 54.67), abs=0.02)
    assert timings[None].scale_std == pytest.approx(0.0036, abs=0.0001)


def test_gain_spread_is_told_from_its_noise(fit):
    good = flags.is_usable(fit.flags)
    codes = fit.codes_absorbed[good]
    noise = np.sqrt(np.mean((fit.absorbed_std[good] / codes) ** 2))
    seen = np.std(1.0 / codes) * codes.mean()
    assert noise < 0.0007
    assert 0.0058 < np.sqrt(seen**2 - noise**2) < 0.0070


def test_eight_phases(fit):
    good = flags.is_usable(fit.flags)
    assert fit.structured
    assert fit.n_phases == 8
    # error of the array's mean: 3.3 % / sqrt(951) = 0.1 %
    np.testing.assert_allclose(fit.phases[good].mean(axis=0), PATTERN, atol=0.004)
    # each pixel adds 3.0 % of its own; with the pattern's 5.8 % that is 6.5 % in all
    assert fit.phase_spread == pytest.approx(0.030, abs=0.002)
    assert np.hypot(fit.phase_spread, np.std(PATTERN)) == pytest.approx(0.065, abs=0.002)


def test_dead_and_double_codes(fit):
    assert fit.first_live_code == 8
    assert fit.dead_codes == tuple(range(8))
    assert not fit.code_widths[:8].any()
    good = flags.is_usable(fit.flags)
    assert fit.first_live_width[good].mean() == pytest.approx(1.8, abs=0.05)
    assert fit.end_code[good].mean() == pytest.approx(914.8, abs=0.3)
    assert 0.5 < fit.end_blur_codes < 0.9


def test_screaming_pixels(fit, recording):
    screaming = (fit.flags & flags.SCREAMING) != 0
    assert np.count_nonzero(screaming) == 73
    np.testing.assert_array_equal(screaming, recording.photons > 30_000)
    assert np.count_nonzero(fit.flags) == 73


def test_pattern_suffices_away_from_the_end(fit):
    good = flags.is_usable(fit.flags)
    # expected counts of 8 per code add 1 / mean to the variance of each term of chi-square
    noise2 = 2.0 * fit.dof + fit.dof / fit.flux[good]
    z = (fit.chi2[good] - fit.dof) / np.sqrt(noise2)
    assert abs(z.mean()) < 0.5
    assert z.std() == pytest.approx(1.0, abs=0.15)


def test_sync_disturbs_the_clock_for_half_a_nanosecond(fit):
    # found in this recording: widths ring by -6 % and +3 % over the last 40 codes
    assert 30 < len(fit.end_widths) < 64
    assert fit.end_widths[5:11].mean() == pytest.approx(0.943, abs=0.01)
    assert fit.end_widths[20:30].mean() == pytest.approx(1.023, abs=0.01)


def test_halves_of_the_photons_agree_within_stated_errors(recording):
    rng = np.random.default_rng(5)
    counts = recording.counts.astype(np.int64)
    half = rng.binomial(counts, 0.5)
    first, second = (fit_code_density(_histograms(c, 50_000)) for c in (half, counts - half))
    good = flags.is_usable(first.flags) & flags.is_usable(second.flags)
    gain = (first.codes_lost - second.codes_lost)[good]
    gain = gain / np.hypot(first.lost_std, second.lost_std)[good]
    # 951 pixels: widths of pulls are known to 2.3 %; ends of 4 counts per code are not Gaussian
    assert gain.std() == pytest.approx(1.0, abs=0.15)
    assert abs(gain.mean()) < 0.3


def test_flat_light_holds_no_pulse(recording, timings):
    from lightflight.timing.pulses.pulses import fit_pulses

    pulses = fit_pulses(recording, timing=timings["absorbed"])
    # chance of a false pulse is 1e-4 per pixel: more than 3 of 951 in 1e-5 of recordings
    assert np.count_nonzero(pulses.usable) <= 3
