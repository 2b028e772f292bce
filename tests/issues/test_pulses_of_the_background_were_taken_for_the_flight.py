"""Light that a recording without the flight shows too was looked for on a path.

Of a background only the rate was used: a leak of the laser, reflections in a room and a signal of
the trigger stood in it, were given with it, and yet made legs, were called another camera's clock
or contradicted a right path. Codes that such light reaches take no part.
"""

from dataclasses import replace

import numpy as np
import pytest
from scipy.special import ndtr
from scipy.stats import binom

import lightflight as lf
from benchmarks.backgrounds import FRAMES, recorded
from benchmarks.random_labs import pulls_of, told_of
from lightflight.errors import CalibrationError, NothingFoundError, SuspectDataWarning
from lightflight.path.verdict import Level
from lightflight.reconstruct.model.cells import cells_about, lag_edges
from lightflight.reconstruct.model.sighting import Sighting, blind_pixels
from lightflight.timing.clock.calibration import TimingCalibration
from lightflight.timing.clock.code_clock import ClockWithoutCodes
from lightflight.timing.pulses.background import without_background_pulses
from tests.oracles.worlds.border import calibrated, histograms
from tests.oracles.worlds.clock import pf32_clock

heard = pytest.mark.filterwarnings("ignore:the background holds pulses")


@heard
@pytest.mark.parametrize(
    ("kind", "share", "seed"),
    [("leak", 0.003, 1400), ("signal", 0.3, 1400), ("reflections", 0.3, 1409)],
)
def test_the_path_is_where_it_is(kind, share, seed):
    """Three fixed recordings; without the background two are contradicted and one is refused."""
    lab, hist, background = recorded(kind, share, seed)
    path = lf.reconstruct(hist, **told_of(lab), background=background)
    assert path.verdict.level is Level.TRUST
    assert path.n_legs == len(lab.vertices) - 1
    assert pulls_of(lab, path)[:, 1].max() < 5.0


def test_it_is_said():
    lab, hist, background = recorded("signal", 0.3, 1400)
    with pytest.raises(CalibrationError, match="a signal of the camera"):
        lf.reconstruct(hist, **told_of(lab))
    with pytest.warns(SuspectDataWarning, match="the background holds pulses in 1152 of 1152"):
        lf.find_arrivals(hist, timing=told_of(lab)["timing"], background=background)


@heard
def test_a_flight_that_was_not_blocked_is_asked_about():
    lab, hist, _ = recorded("leak", 0.03, 1400)
    with pytest.raises(NothingFoundError, match="was the flight blocked while the background"):
        lf.reconstruct(hist, **told_of(lab), background=hist)


def test_a_level_changes_nothing():
    """Chance makes a pulse in one pixel of a hundred; in so many of 4,096 once in 10,000 times."""
    rng = np.random.default_rng(5)
    hist, background = (
        lf.Histograms(
            rng.poisson(0.3, (64, 64, 128)).astype(np.uint16), bin_width_ps=55.0, n_frames=FRAMES
        )
        for _ in range(2)
    )
    clock = without_background_pulses(hist, background, None)
    n_cut = 0 if clock is None else len(clock.cut)
    assert n_cut <= binom.isf(1e-4, 4096, 0.01)


@pytest.mark.parametrize("reversed_codes", [False, True])
def test_faint_light_of_all_pixels_is_seen_in_their_sum(reversed_codes):
    """A third of a photon in each pixel, as late as it is: none shows it, all lose its codes."""
    rng = np.random.default_rng(6)
    late = rng.normal(0.0, 4.0, (32, 32, 1))
    light = 0.35 * share_of_codes(40.0 + late)[..., :: -1 if reversed_codes else 1]
    hist, background = (
        lf.Histograms(
            rng.poisson(0.02 + light).astype(np.uint16), bin_width_ps=55.0, n_frames=FRAMES,
            reversed_codes=reversed_codes, laser_period_ps=128 * 55.0,
        )
        for _ in range(2)
    )  # fmt: skip
    nominal = TimingCalibration.nominal(hist)
    timing = replace(nominal, skew_ps=55.0 * late[..., 0])
    with pytest.warns(SuspectDataWarning, match="in 1024 of 1024 pixels"):
        clock = without_background_pulses(hist, background, timing)
    assert light[clock.cut.reshape(light.shape)].sum() > 0.9 * light.sum()
    assert 5 < clock.cut.sum(axis=1).mean() < 10


@heard
@pytest.mark.parametrize("photons", [0.0, 1.0])
def test_codes_of_a_real_camera_are_laid_over_each_other_by_their_times(photons):
    """Gains apart by half a percent are 200 ps at the other end of a period, and codes unequal.

    A level on them is no pulse; a photon of a leak costs a pixel fewer than 12 of 1,024 codes.
    """
    rng = np.random.default_rng(9)
    true = pf32_clock(3)
    lower, upper = true.intervals()
    late = true.skew_ps[:, np.newaxis]
    light = ndtr((upper - late - 9_000.0) / 60.0) - ndtr((lower - late - 9_000.0) / 60.0)
    mean = 0.2 * np.clip(upper - lower, 0.0, None) / 55.0 + photons * np.clip(light, 0.0, None)
    hist, background = (
        replace(
            histograms(rng.poisson(mean).reshape(32, 32, -1).astype(np.uint32), true),
            n_frames=FRAMES,
        )
        for _ in range(2)
    )
    clock = without_background_pulses(hist, background, calibrated(true, hist.shape))
    if photons:
        cut = clock.cut_in(*(each.ravel() for each in np.indices((32, 32))))
        assert light[cut].sum() > 0.8 * light.sum()
        assert cut.sum(axis=1).mean() < 12
    else:
        assert clock is None or len(clock.cut) <= binom.isf(1e-4, 1024, 0.01)


def share_of_codes(at: np.ndarray) -> np.ndarray:
    """Of a pulse at a code, in each of 128."""
    z = (np.arange(128) + 0.5 - at) / 1.5
    return np.exp(-0.5 * z**2) / (1.5 * np.sqrt(2.0 * np.pi))


def test_bright_light_of_the_flight_is_worth_more_than_what_lies_under_it():
    """Two photons under 4,000: its codes stay, where no flight comes they take no part."""
    rng = np.random.default_rng(7)
    share = share_of_codes(np.array(40.0))
    mean = np.full((32, 32, 128), 0.02) + 2.0 * share
    lit = mean.copy()
    lit[10] += 4000.0 * share
    hist, background = (
        lf.Histograms(rng.poisson(one).astype(np.uint16), bin_width_ps=55.0, n_frames=FRAMES)
        for one in (lit, mean)
    )
    with pytest.warns(SuspectDataWarning, match="the background holds pulses"):
        clock = without_background_pulses(hist, background, None)
    cut = clock.cut_in(*(each.ravel() for each in np.indices((32, 32)))).reshape(32, 32, 128)
    assert not cut[10, :, 38:43].any()
    assert cut[:10, :, 38:43].all()


def test_codes_that_take_no_part_last_no_time_and_are_no_cells():
    """Against a count by hand: a cell has all codes of its time, none cut, or is none."""
    rng = np.random.default_rng(8)
    hist = lf.Histograms(
        rng.poisson(3.0, (2, 3, 200)).astype(np.uint16), bin_width_ps=50.0, laser_period_ps=10_000.0
    )
    lost = np.array([50, 51, 52, 90, 199])
    clock = ClockWithoutCodes.of(
        TimingCalibration.nominal(hist), np.full(len(lost), 4), lost, hist.n_codes
    )
    emptied = clock.emptied(hist)
    assert emptied.counts[1, 1, lost].sum() == 0
    assert emptied.counts.sum() == hist.counts.sum() - hist.counts[1, 1, lost].sum()
    lower, upper = clock.code_intervals_ps([1, 0], [1, 0])
    assert np.flatnonzero(upper[0] <= lower[0]).tolist() == lost.tolist()
    assert (upper[1] > lower[1]).all()
    pixel, code = clock.codes
    assert (pixel == 4).all()
    assert code.tolist() == lost.tolist()
    arrivals = lf.find_arrivals(hist)
    seen = Sighting(emptied, clock, arrivals, arrivals.arrival_ps, blind_pixels(arrivals, clock))
    edges = lag_edges(40.0, 25.0, 1.5, 10_000.0)
    cells = cells_about(
        seen, np.array([1, 0]), np.array([1, 0]), np.array([2600.0, 2600.0]), edges, nominal=True
    )
    for low, high, n, live in zip(
        cells.edges_ps[0, :-1] + 2600.0, cells.edges_ps[0, 1:] + 2600.0, cells.counts[0],
        cells.live[0], strict=True,
    ):  # fmt: skip
        inside = np.arange(int(np.rint(low / 50.0)), int(np.rint(high / 50.0))) % 200
        if live:
            assert n == hist.counts[1, 1, inside].sum()
            assert not np.isin(inside, lost).any()
    assert cells.live[1].sum() > cells.live[0].sum() > 0.5 * cells.live[1].sum()
