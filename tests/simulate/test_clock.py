"""The true clock: code of a photon against a search in explicitly summed edges."""

from __future__ import annotations

import numpy as np
import pytest

from lightflight.simulate import Detector, ideal, pf32, spad256, streak
from lightflight.simulate.clock import LOST

SHAPE = (4, 5)


def explicit_edges(detector: Detector, shape) -> np.ndarray:
    """Edges of each pixel by adding up one code after the other."""
    defects = detector.pixels(shape)
    edges = np.zeros((*shape, detector.n_codes + 1))
    n = defects.phases.shape[-1]
    k1 = detector.first_live_code
    start = dict(enumerate(detector.start_code_widths, start=k1))
    for row in range(shape[0]):
        for col in range(shape[1]):
            width = detector.true_code_width_ps * defects.gain[row, col]
            phases = defects.phases[row, col]
            at = detector.first_edge_ps
            if detector.dead_time_is_lost:
                at += width * sum(phases[k % n] for k in range(k1))
                at -= width * sum(phases[k % n] * (f - 1) for k, f in start.items())
            edges[row, col, : k1 + 1] = at
            for k in range(k1, detector.n_codes):
                at += width * phases[k % n] * start.get(k, 1.0)
                edges[row, col, k + 1] = at
    if detector.laser_period_ps is not None:
        edges = np.minimum(edges, detector.first_edge_ps + detector.laser_period_ps)
    return edges


DETECTORS = {
    "ideal": ideal(),
    "pf32": pf32(seed=4),
    "pf32 lost": pf32(seed=4, dead_codes="lost"),
    "pf32 forward": pf32(seed=4, reversed_codes=False),
    "gated": spad256(seed=2, first_edge_ps=4_000.0),
    "streak": streak(first_edge_ps=3_000.0),
}


@pytest.mark.parametrize("name", DETECTORS)
def test_edges_are_the_summed_widths(name):
    detector = DETECTORS[name]
    edges = detector.clock(SHAPE).edges_ps(np.arange(20)).reshape(*SHAPE, -1)
    np.testing.assert_allclose(edges, explicit_edges(detector, SHAPE), rtol=0, atol=1e-7)


@pytest.mark.parametrize("name", DETECTORS)
def test_a_photon_gets_the_code_whose_interval_holds_it(name, rng):
    detector = DETECTORS[name]
    clock = detector.clock(SHAPE)
    delay = rng.uniform(-60_000.0, 120_000.0, 20_000)
    pixel = rng.integers(0, 20, 20_000)
    code = clock.codes_from_delays(pixel, delay)
    lower, upper = (edge.reshape(20, -1) for edge in detector.true_code_intervals_ps(SHAPE))
    seen = code != LOST
    assert seen.any()
    low, high = lower[pixel[seen], code[seen]], upper[pixel[seen], code[seen]]
    period = detector.laser_period_ps
    folded = delay[seen] if period is None else low + np.mod(delay[seen] - low, period)
    # a photon a rounding error before its code's lower edge folds to just below one period
    if period is not None:
        folded = np.where(folded - low > period - 1e-6, folded - period, folded)
    assert (folded >= low - 1e-6).all()
    assert (folded <= high + 1e-6).all()


@pytest.mark.parametrize("name", DETECTORS)
def test_photons_are_lost_only_where_no_code_reaches(name, rng):
    detector = DETECTORS[name]
    clock = detector.clock(SHAPE)
    delay = rng.uniform(0.0, 50_000.0, 20_000)
    pixel = rng.integers(0, 20, 20_000)
    lost = clock.codes_from_delays(pixel, delay) == LOST
    edges = explicit_edges(detector, SHAPE).reshape(20, -1)
    interval = clock.interval_from_delay(delay)
    covered = (interval >= edges[pixel, 0]) & (interval < edges[pixel, -1])
    near = np.minimum(np.abs(interval - edges[pixel, 0]), np.abs(interval - edges[pixel, -1]))
    assert (lost == ~covered)[near > 1e-6].all()


def test_pf32_is_as_measured():
    detector = pf32(seed=0)
    shape = (32, 32)
    defects = detector.pixels(shape)
    lower, upper = detector.true_code_intervals_ps(shape)
    width = upper - lower
    assert detector.true_code_width_ps == pytest.approx(55.06, abs=0.01)
    assert (width[..., :8] == 0).all()
    # over 1024 pixels the eight-phase mean scatters by 0.030 / 32 = 0.1 %
    first = width[..., 8].mean() / (detector.true_code_width_ps * 1.036)
    assert first == pytest.approx(1.76, rel=0.02)
    np.testing.assert_allclose(width.sum(axis=-1), 50_000.0, rtol=1e-12)
    last = (width > 0).cumsum(axis=-1).argmax(axis=-1) + 1
    assert np.mean(last) == pytest.approx(915.1, abs=1.0)
    # spread of 1024 Gaussians: 2.2 % standard error
    assert defects.gain.std() == pytest.approx(0.0065, rel=0.14)
    pattern = defects.phases.mean(axis=(0, 1))
    np.testing.assert_allclose(
        pattern, [1.036, 0.922, 0.990, 1.096, 0.968, 0.982, 0.936, 1.069], atol=0.013
    )
    assert (defects.phases - pattern).std() == pytest.approx(0.030, rel=0.06)
    assert defects.screaming.sum() == 73
    assert np.abs(defects.skew_ps).max() <= 300.0
    assert np.ptp(defects.skew_ps) > 590.0


def test_lost_dead_time_takes_light_from_the_period():
    detector = pf32(seed=0, dead_codes="lost")
    assert detector.true_code_width_ps == pytest.approx(54.67, abs=0.01)
    lower, upper = detector.true_code_intervals_ps((8, 8))
    live = (upper - lower).sum(axis=-1)
    # 6.5 of 914.6 codes are dark; the eight widths of 64 pixels scatter by well below 1 %
    assert np.mean(live) == pytest.approx(50_000.0 * (1 - 6.5 / 914.6), rel=2e-3)


def test_camera_is_the_same_camera_every_time_and_another_with_another_seed():
    one, again, other = (pf32(seed=s).pixels((8, 8)) for s in (5, 5, 6))
    np.testing.assert_array_equal(one.skew_ps, again.skew_ps)
    np.testing.assert_array_equal(one.phases, again.phases)
    assert (one.skew_ps != other.skew_ps).all()


def test_switching_one_random_defect_leaves_the_others():
    with_all, without = pf32(seed=5), pf32(seed=5, gain_rms=0.0, screaming_fraction=0.0)
    a, b = with_all.pixels((8, 8)), without.pixels((8, 8))
    assert (b.gain == 1.0).all()
    assert not b.screaming.any()
    np.testing.assert_array_equal(a.skew_ps, b.skew_ps)
    np.testing.assert_array_equal(a.phases, b.phases)
    np.testing.assert_array_equal(a.dark_rate_hz[~a.screaming], b.dark_rate_hz[~a.screaming])


def test_given_maps_take_the_place_of_drawn_ones(rng):
    gain = 1.0 + 0.01 * rng.standard_normal((3, 4))
    phases = 1.0 + 0.1 * rng.standard_normal((3, 4, 8))
    skew = rng.uniform(-100, 100, (3, 4))
    screaming = np.zeros((3, 4), bool)
    screaming[1, 2] = True
    efficiency = rng.uniform(0.2, 1.0, (3, 4))
    detector = pf32(
        gain_map=gain, phase_map=phases, skew_map_ps=skew, screaming_map=screaming,
        efficiency_map=efficiency,
    )  # fmt: skip
    defects = detector.pixels((3, 4))
    np.testing.assert_array_equal(defects.gain, gain)
    np.testing.assert_array_equal(defects.skew_ps, skew)
    np.testing.assert_array_equal(defects.screaming, screaming)
    np.testing.assert_allclose(defects.phases.mean(axis=-1), 1.0)
    np.testing.assert_allclose(defects.phases[..., 0] / defects.phases[..., 1],
                               phases[..., 0] / phases[..., 1])  # fmt: skip
    np.testing.assert_allclose(defects.efficiency, efficiency / efficiency.max())


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"gain_map": np.ones((4, 3))}, "gain_map has shape"),
        ({"gain_map": np.ones((3, 4, 1))}, "gain_map has shape"),
        ({"gain_map": np.zeros((3, 4))}, "gain_map must be positive"),
        ({"phase_map": np.zeros((3, 4, 8))}, "phase_map must be positive"),
        ({"phase_map": np.ones((3, 4))}, "phase_map has shape"),
        ({"skew_map_ps": np.full((3, 4), np.nan)}, "skew_map_ps holds NaN"),
        ({"efficiency_map": np.zeros((3, 4))}, "efficiency_map must be >= 0"),
    ],
)
def test_maps_that_cannot_be_are_refused(changes, message):
    with pytest.raises(ValueError, match=message):
        pf32(**changes).pixels((3, 4))


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"gain_rms": -0.1}, "gain_rms must be finite and >= 0"),
        ({"crosstalk_probability": 1.5}, "crosstalk_probability must lie between 0 and 1"),
        ({"psf_std_px": 0.0}, "psf_std_px must lie between"),
        ({"active_width_px": 1.2}, "active_width_px must lie above 0"),
        ({"bin_width_ps": 0.0}, "bin_width_ps must be positive"),
        ({"n_codes": 0}, "n_codes must lie between"),
        ({"phase_pattern": ()}, "phase_pattern must hold"),
        ({"phase_pattern": (1.0, -1.0)}, "phase_pattern must hold positive"),
        ({"first_live_code": 2000}, "first_live_code must be one of"),
        ({"laser_period_ps": None, "reversed_codes": True}, "reversed_codes=True needs"),
        ({"no_photon_code": 0}, "no_photon_code must lie below"),
        ({"dark_rate_hz": 10.0}, "dark_rate_hz needs frames"),
        ({"screaming_occupancy": (0.9, 0.6)}, "screaming_occupancy must be"),
        ({"drift_ps": float("nan")}, "drift_ps must be finite"),
        ({"seed": -1}, "seed must be >= 0"),
    ],
)
def test_impossible_detectors_are_refused(changes, message):
    with pytest.raises(ValueError, match=message):
        Detector(**changes)


def test_seed_must_be_whole():
    with pytest.raises(TypeError, match="whole number"):
        Detector(seed=1.5)  # type: ignore[arg-type]


def test_dead_code_choice_is_closed():
    with pytest.raises(ValueError, match="absorbed"):
        pf32(dead_codes="gone")  # type: ignore[arg-type]
