"""Shapes of a pulse: recordings drawn from them come back without bias and with true errors."""

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter1d

from lightflight import flags as fl
from lightflight.recording.histograms import Histograms
from lightflight.timing.calibrate.chain import calibrate_timing
from lightflight.timing.calibrate.flat_response import tail_of_flat
from lightflight.timing.clock.calibration import TimingCalibration
from lightflight.timing.clock.response import Response
from lightflight.timing.pulses.arrivals import find_arrivals
from lightflight.timing.pulses.pulses import fit_pulses
from tests.pulse_fakes import WIDTH

N_CODES = 256
PERIOD = N_CODES * WIDTH
STD, TAIL, SHARE = 60.0, 180.0, 0.3


def late_pulses(rng, delay_ps, photons, *, background=0.3, skew_ps=0.0):
    """Histograms (1, n, codes): photons drawn one by one, some late by an exponential time."""
    counts = np.zeros((len(delay_ps), N_CODES), np.uint32)
    for row, delay in zip(counts, delay_ps + skew_ps, strict=True):
        times = rng.normal(delay, STD, rng.poisson(photons))
        late = rng.random(len(times)) < SHARE
        times[late] += rng.exponential(TAIL, np.count_nonzero(late))
        row += np.bincount((times % PERIOD // WIDTH).astype(int), minlength=N_CODES).astype(
            np.uint32
        )
        row += rng.poisson(background, N_CODES).astype(np.uint32)
    return Histograms(counts[None], bin_width_ps=WIDTH, laser_period_ps=PERIOD)


@pytest.mark.parametrize("ratio", [0.3, 1.0, 4.0])
def test_tailed_gaussian_is_the_density_of_its_photons(ratio, rng):
    """2,000,000 draws; a cumulated share is known to 3.5e-4 (one sigma)."""
    shape = Response.with_tail(std_ps=50.0, tail_ps=50.0 * ratio, tail_share=0.7)
    draws = rng.normal(0.0, 50.0, 2_000_000)
    draws[:1_400_000] += rng.exponential(50.0 * ratio, 1_400_000)
    assert shape.std_ps == pytest.approx(draws.std(), rel=0.005)
    z, cumulated, density = shape.table()
    share = np.searchsorted(np.sort(draws), z * shape.std_ps + draws.mean()) / len(draws)
    np.testing.assert_allclose(cumulated, share, atol=0.002)
    assert (np.diff(cumulated) >= 0).all()
    assert cumulated[-1] == pytest.approx(1.0)
    assert density.min() >= 0


def test_a_tabulated_gaussian_is_the_gaussian_fit(rng):
    delay = rng.uniform(2000, 12_000, 40)
    hist = late_pulses(rng, delay, 3000)
    plain = fit_pulses(hist, max_pulses=1, response="clock")
    tabulated = fit_pulses(hist, max_pulses=1, response=Response.gaussian(3.0))
    std = np.sqrt(plain.covariance[:, 0, 0])
    np.testing.assert_allclose(tabulated.delay_ps, plain.delay_ps, atol=0.02 * std.min())
    np.testing.assert_allclose(tabulated.std_ps, plain.std_ps, rtol=1e-3)
    found, expected = (np.diagonal(fit.covariance, axis1=1, axis2=2) for fit in (tabulated, plain))
    np.testing.assert_allclose(found, expected, rtol=2e-3)


@pytest.mark.parametrize("measured", [False, True])
def test_pulses_of_a_known_shape(rng, measured):
    """1,000 pixels of 3,000 photons: pull widths to 2.2 %, pull means to 0.032 (one sigma)."""
    delay = rng.uniform(0, PERIOD, 1000)
    hist = late_pulses(rng, delay, 3000)
    response = Response.with_tail(std_ps=STD, tail_ps=TAIL, tail_share=SHARE)
    if measured:  # the curve of another recording of the same response, in codes
        curve = late_pulses(rng, np.full(1, 5000.0), 5e6, background=20.0)
        response = curve.counts[0, 0]
    pulses = fit_pulses(hist, response=response)
    assert len(pulses.row) == 1000
    assert pulses.usable.all()
    mean = delay + SHARE * TAIL
    error = (pulses.delay_ps - mean + PERIOD / 2) % PERIOD - PERIOD / 2
    pull = error / np.sqrt(pulses.covariance[:, 0, 0])
    assert 0.92 < pull.std() < 1.08
    assert abs(pull.mean()) < (0.25 if measured else 0.13)  # the curve has errors of its own
    if not measured:
        off = (pulses.photons - 3000) / np.sqrt(pulses.covariance[:, 2, 2])
        assert abs(off.mean()) < 0.13
        assert 0.92 < off.std() < 1.08
        assert (pulses.chi2 / pulses.dof).mean() == pytest.approx(1.0, abs=0.01)
        poor = fit_pulses(hist, max_pulses=1, response="clock")
        assert ((poor.flags & fl.POOR_FIT) != 0).mean() > 0.9
        assert ((pulses.flags & fl.POOR_FIT) != 0).mean() < 0.01


def test_two_tailed_pulses_are_two(rng):
    first = rng.uniform(2000, 8000, 100)
    one, two = late_pulses(rng, first, 8000), late_pulses(rng, first + 1500.0, 2000)
    both = Histograms(one.counts + two.counts, bin_width_ps=WIDTH, laser_period_ps=PERIOD)
    response = Response.with_tail(std_ps=STD, tail_ps=TAIL, tail_share=SHARE)
    pulses = fit_pulses(both, response=response)
    assert len(pulses.row) == 200
    apart = pulses.delay_ps[1::2] - pulses.delay_ps[::2]
    assert apart.mean() == pytest.approx(1500.0, abs=3.0)


def test_the_flat_tells_its_tail_and_data_use_it(rng, tmp_path):
    """64 pixels of 20,000 photons; a recording by the same response, 500 ps later."""
    skew = rng.normal(0.0, 200.0, 64)
    flat = late_pulses(rng, np.full(64, 4000.0), 20_000, skew_ps=skew)
    with pytest.warns(UserWarning, match="no code-density"):
        timing = calibrate_timing(flat=flat, flat_arrival_ps=4000.0, flat_pulse="tail")
    shape = timing.response
    true = Response.with_tail(std_ps=STD, tail_ps=TAIL, tail_share=SHARE)
    assert timing.response_std_ps.mean() == pytest.approx(true.std_ps, rel=0.05)
    assert (
        abs(shape.table()[1] - np.interp(shape.table()[0], *true.anchored().table()[:2])).max()
        < 0.02
    )
    later = late_pulses(rng, np.full(64, 4500.0), 20_000, skew_ps=skew)
    arrivals = find_arrivals(later, timing=timing)
    error = arrivals.arrival_ps - 4500.0
    assert np.sqrt(np.mean(error**2)) < 1.6 * np.sqrt(2.0) * true.std_ps / np.sqrt(20_000)
    timing.save(tmp_path / "clock.h5")
    again = TimingCalibration.load(tmp_path / "clock.h5")
    np.testing.assert_array_equal(again.response_curve, timing.response_curve)
    assert ((arrivals.flags & fl.POOR_FIT) != 0).sum() <= 2


def test_the_tail_of_a_gaussian_is_none(rng):
    counts = np.zeros((16, N_CODES), np.uint32)
    for row in counts:
        times = rng.normal(5000.0, STD, 20_000)
        row += np.bincount((times // WIDTH).astype(int), minlength=N_CODES).astype(np.uint32)
    flat = Histograms(counts[None] + np.uint32(1), bin_width_ps=WIDTH, laser_period_ps=PERIOD)
    z, cumulated, _ = tail_of_flat(flat, timing=TimingCalibration.nominal(flat)).table()
    gauss = Response.gaussian().table()
    assert abs(cumulated - np.interp(z, gauss[0], gauss[1])).max() < 0.01


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: Response(np.arange(2.0), np.ones(2)), "at least 3"),
        (lambda: Response(np.zeros(4), np.ones(4)), "ascend"),
        (lambda: Response(np.arange(4.0), np.zeros(4)), "zero everywhere"),
        (lambda: Response.with_tail(std_ps=0.0, tail_ps=1.0), "positive"),
        (lambda: Response.with_tail(std_ps=1.0, tail_ps=1.0, tail_share=2.0), "0 ... 1"),
    ],
)
def test_shapes_that_cannot_be(make, words):
    with pytest.raises(ValueError, match=words):
        make()


def test_measured_curves_that_cannot_be(rng):
    hist = late_pulses(rng, np.full(1, 5000.0), 100)
    for curve, words in ((np.ones(7), "one count per code"), (np.ones(N_CODES), "flat")):
        with pytest.raises(ValueError, match=words):
            fit_pulses(hist, response=curve)
    with pytest.raises(ValueError, match="least squares"):
        fit_pulses(hist, response=Response.gaussian(), method="least_squares")


@pytest.mark.parametrize(("share", "tail_ps"), [(0.25, 250.0), (1.0, 60.0)])
def test_a_pulse_that_flight_widens_stays_where_it_is(share, tail_ps):
    """Counts without noise: what is left is the bias. About its mean the same shape lags by ps."""
    edges = np.arange(0.0, 12_000.0, WIDTH)
    fine = np.arange(-2000.0, 10_000.0, 1.0)
    shape = Response.with_tail(std_ps=68.0, tail_ps=tail_ps, tail_share=share)
    density = np.interp(fine, shape.time_ps, shape.density, left=0.0, right=0.0)
    place = {}
    for name, pulse in (("mean", shape), ("anchor", shape.anchored())):
        for wider_ps in (0.0, 18.0):
            seen = gaussian_filter1d(density, wider_ps) if wider_ps else density
            come = np.interp(edges, fine + 0.5 + 3000.0, np.cumsum(seen) / seen.sum())
            counts = np.rint(3e7 * np.diff(come) + 3000.0).astype(np.uint32)
            hist = Histograms(counts[None, None], bin_width_ps=WIDTH, laser_period_ps=50_000.0)
            place[name, wider_ps] = fit_pulses(hist, response=pulse, max_pulses=1).delay_ps[0]
    assert abs(place["anchor", 18.0] - place["anchor", 0.0]) < 0.1
    lag = place["mean", 18.0] - place["mean", 0.0]
    assert lag > (1.0 if share < 1.0 else 0.1)


def test_a_symmetric_shape_is_anchored_in_its_middle():
    assert Response.gaussian(60.0).anchored().place_ps == pytest.approx(0.0, abs=0.01)
