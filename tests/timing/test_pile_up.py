"""Pile-up: one photon per frame, drawn photon by photon, comes back with its time and number."""

from dataclasses import replace

import numpy as np
import pytest

from lightflight import flags as fl
from lightflight.recording.histograms import Histograms
from lightflight.timing.pulses.pile_up import pile_up_of
from lightflight.timing.pulses.pulses import fit_pulses
from tests.pulse_fakes import STD, WIDTH

N_CODES = 200
PERIOD = N_CODES * WIDTH
CENTRE = 0.5 * PERIOD


def first_photons(rng, n_pixels, n_frames, *, rate, background_share):
    """Codes (n_pixels, n_codes) of the earliest photon of every period that holds one or more.

    `n_frames` periods per pixel with `rate` photons each, listed one by one; later ones are lost.
    """
    counts = np.zeros((n_pixels, N_CODES), np.uint32)
    for row in counts:
        photons = rng.poisson(rate, n_frames)
        owner = np.repeat(np.arange(n_frames), photons)
        time = rng.normal(CENTRE, STD, len(owner))
        lost = rng.random(len(owner)) < background_share
        time[lost] = rng.uniform(0.0, PERIOD, np.count_nonzero(lost))
        earliest = np.full(n_frames, np.inf)
        np.minimum.at(earliest, owner, time)
        seen = earliest[np.isfinite(earliest)]
        row += np.bincount((seen // WIDTH).astype(int), minlength=N_CODES).astype(np.uint32)
    return counts


def frames_of(rng, n_pixels, n_frames, periods_per_frame, *, occupancy, background_share):
    """Histograms of frames, and the photons that came per pixel.

    The first photon of a frame lies in the first period that holds one: how many frames have
    such a period is drawn, then the photons of that period one by one.
    """
    per_frame = -np.log1p(-occupancy)
    rate = per_frame / periods_per_frame
    options = {"rate": rate, "background_share": background_share}
    if periods_per_frame == 1:
        counts = first_photons(rng, n_pixels, n_frames, **options)
    else:
        counts = np.zeros((n_pixels, N_CODES), np.uint32)
        for row in counts:
            wanted = rng.binomial(n_frames, occupancy)
            while row.sum() < wanted:
                tried = int(1.3 * (wanted - int(row.sum())) / -np.expm1(-rate)) + 100
                more = first_photons(rng, 1, tried, **options)[0]
                if row.sum() + more.sum() > wanted:  # a fair choice of those that are too many
                    more = rng.multivariate_hypergeometric(more, wanted - int(row.sum()))
                row += more.astype(np.uint32)
    hist = Histograms(
        counts[None], bin_width_ps=WIDTH, laser_period_ps=PERIOD, n_frames=n_frames,
        periods_per_frame=periods_per_frame,
    )  # fmt: skip
    return hist, per_frame * n_frames


@pytest.mark.parametrize(
    ("periods_per_frame", "occupancy", "n_pixels"), [(1, 0.5, 2500), (1, 0.1, 2500), (20, 0.5, 900)]
)
def test_time_and_photons_come_back(rng, periods_per_frame, occupancy, n_pixels):
    """Bias of the time at most 0.1 standard errors, known to 0.02 (2,500) or 0.03 (900 pixels).

    Uncorrected it is 2 at one period per frame and half of them occupied.
    """
    n_frames = 2000
    hist, came = frames_of(
        rng, n_pixels, n_frames, periods_per_frame, occupancy=occupancy, background_share=0.2
    )
    pulses = fit_pulses(hist, max_pulses=1)
    assert pulses.usable.all()
    pull = (pulses.delay_ps - CENTRE) / np.sqrt(pulses.covariance[:, 0, 0])
    assert abs(pull.mean()) < 0.1
    assert 0.93 < pull.std() < 1.07 + 2.0 / np.sqrt(n_pixels)
    photons = pulses.photons + pulses.background_per_ps * PERIOD
    empty = 1.0 - hist.photons.ravel() / n_frames
    np.testing.assert_allclose(photons, -n_frames * np.log(empty), rtol=0.03)
    known = 4.0 * np.sqrt(n_frames * occupancy / (1.0 - occupancy) / n_pixels)
    assert photons.mean() == pytest.approx(came, abs=known)
    assert pulses.photons.mean() == pytest.approx(0.8 * came, abs=known)
    spread = (pulses.photons - 0.8 * came) / np.sqrt(pulses.covariance[:, 2, 2])
    assert 0.9 < spread.std() < 1.1
    if periods_per_frame == 1 and occupancy == 0.5:
        bent = fit_pulses(replace(hist, n_frames=None), max_pulses=1)
        off = (bent.delay_ps - CENTRE) / np.sqrt(bent.covariance[:, 0, 0])
        assert off.mean() < -1.0  # late photons are hidden by early ones
    flagged = (pulses.flags & fl.PILE_UP) != 0
    assert flagged.all() == (occupancy / periods_per_frame > 0.01)


def test_four_thousand_periods_bend_nothing_and_only_thin(rng):
    """2,500 pixels as on a PF32: the first photon of 4,000 periods, half of the frames occupied.

    Drawn from the exact law, since 4,000 periods a frame are too many to list: within the period
    of the first photon, codes thin out by exp(-rate before them).
    """
    n_frames, periods = 40_000, 4000
    edges = np.arange(N_CODES + 1) * WIDTH
    from scipy.special import ndtr

    share = 0.8 * np.diff(ndtr((edges - CENTRE) / STD)) + 0.2 / N_CODES
    rate = share * np.log(2.0) / periods
    first = np.exp(-np.append(0.0, np.cumsum(rate)[:-1])) * -np.expm1(-rate)
    counts = np.stack(
        [rng.multinomial(rng.binomial(n_frames, 0.5), first / first.sum()) for _ in range(2500)]
    )
    hist = Histograms(
        counts[None], bin_width_ps=WIDTH, laser_period_ps=PERIOD, n_frames=n_frames,
        periods_per_frame=periods,
    )  # fmt: skip
    pulses = fit_pulses(hist, max_pulses=1)
    pull = (pulses.delay_ps - CENTRE) / np.sqrt(pulses.covariance[:, 0, 0])
    assert abs(pull.mean()) < 0.1
    assert pulses.photons.mean() == pytest.approx(0.8 * n_frames * np.log(2.0), rel=0.002)
    assert not ((pulses.flags & fl.PILE_UP) != 0).any()


def test_nothing_is_corrected_where_frames_are_unknown(rng):
    counts = rng.poisson(5.0, (2, 2, 50)).astype(np.uint32)
    for known in ({}, {"n_frames": 500}, {"n_frames": 100, "periods_per_frame": 1}):
        found = pile_up_of(Histograms(counts, bin_width_ps=WIDTH, **known))
        assert (found.scale == 1.0).all()
        assert np.isinf(found.trials).all()


def test_counts_follow_minus_log_of_the_empty_frames(rng):
    counts = np.zeros((1, 1, 64), np.uint32)
    counts[0, 0, 30] = 900
    hist = Histograms(counts, bin_width_ps=WIDTH, n_frames=1000, periods_per_frame=10)
    found = pile_up_of(hist)
    assert found.rate[0] == pytest.approx(-np.log(0.1) / 10)
    # 900 ends of periods at this rate: as many periods as that takes
    assert found.trials[0] == pytest.approx(900 / (1.0 - 0.1**0.1))
    full = pile_up_of(Histograms(counts, bin_width_ps=WIDTH, n_frames=900, periods_per_frame=1))
    assert np.isfinite([full.scale, full.trials]).all()
