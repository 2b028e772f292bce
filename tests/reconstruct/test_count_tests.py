"""Tests of the counts: closed forms on small tables, and worlds of the tests' own forward model.

Tables have fixed seeds; where a bound is on a chance, the chance of a false alarm is 1e-4 or less.
"""

from __future__ import annotations

import warnings
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scipy.stats import gamma, kstest, norm

import lightflight as lf
from lightflight.path.verdict import FindingName
from lightflight.reconstruct.model import light, spread
from lightflight.reconstruct.model.cells import Cells, cells_about, lag_edges
from lightflight.reconstruct.model.counted import cumulated, dark_pixels, lit_pixels
from lightflight.reconstruct.model.expected_counts import Pulses
from lightflight.reconstruct.sightings import sighting_from_histograms
from lightflight.reconstruct.verdict.count_evidence import causes
from lightflight.reconstruct.verdict.count_tests import (
    Cause,
    Columns,
    evidence_from_sums,
    from_skewed,
    summed,
)
from lightflight.reconstruct.verdict.evidence import LIGHT, Evidence
from lightflight.reconstruct.verdict.judge import family_p_value, named
from tests.oracles.worlds.border import histograms, record, what_the_user_tells
from tests.oracles.worlds.clock import BACKWARDS, PERFECT, pf32_clock
from tests.oracles.worlds.defects import DEFECTS
from tests.oracles.worlds.mistakes import with_pf32
from tests.oracles.worlds.random_worlds import random_world

STD = 70.0
EDGES = lag_edges(STD, 56.0, 1.3, 50_000.0)


def table(rng, photons, *, n=40, tail=0.0, wait=500.0, background=0.02, width_error=0.0, told=None):
    """Cells of n pixels with a pulse off by up to 30 ps, a share of it late by `wait`."""
    late = rng.uniform(-30.0, 30.0, n)
    edges = np.tile(EDGES, (n, 1))
    std = np.full(n, STD)
    share = (1.0 - tail) * cumulated(edges, late, std, 0.0) + tail * cumulated(
        edges, late, std, wait
    )
    mean = photons * np.diff(share, axis=1) + background * np.diff(edges, axis=1)
    mean *= 1.0 + width_error * rng.normal(size=mean.shape)
    told = width_error if told is None else told
    everywhere = np.ones(mean.shape)
    counts = rng.poisson(np.maximum(mean, 0.0)).astype(float)
    return Cells(edges, counts, everywhere > 0.0, told * everywhere, everywhere)


def late_light_of(cells):
    """The test of late light on one table, and its sizes."""
    n = len(cells.counts)
    pixels = lit_pixels(cells, Pulses(np.zeros((n, 1)), np.full((n, 1), STD)))
    used = np.arange(3)
    sums = summed([(pixels, Columns(light.late_light(pixels), used, 3))])
    cause = Cause(
        FindingName.HAZE,
        (0, 1, 2),
        0.3,
        "{size:.3f} late by {each}",
        "",
        labels=("a", "b", "c"),
    )
    return evidence_from_sums(sums, [cause])[0]


class TestCells:
    @pytest.mark.parametrize("clock", [PERFECT, BACKWARDS, pf32_clock(3)])
    def test_photons_lie_in_the_cell_of_their_delay(self, clock):
        """One photon in each live code: what a cell counts is the number of its codes."""
        shape = (32, 32)
        near, far = clock.intervals()
        live = np.broadcast_to(far - near > 0, (1024, clock.n_codes)).reshape(*shape, -1)
        rows, cols = np.array([3, 17]), np.array([5, 30])
        counts = np.zeros(live.shape, np.uint32)
        counts[rows, cols] = live[rows, cols]
        hist = histograms(counts, clock)
        sighting = sighting_of(hist, clock)
        reference = np.array([20_000.0, 41_000.0])
        cells = cells_about(sighting, rows, cols, reference, EDGES, nominal=False)
        lower, upper = sighting.timing.code_intervals_ps(rows, cols)
        skew = sighting.timing.skew_ps[rows, cols]
        assert cells.live.sum() > 70
        for pixel in range(2):
            middle = 0.5 * (lower + upper)[pixel] - skew[pixel] - reference[pixel]
            counted = hist.counts[rows[pixel], cols[pixel]]
            edges = cells.edges_ps[pixel]
            lag = edges[0] + (middle - edges[0]) % 50_000.0
            of_pixel = edges, edges[1:], cells.counts[pixel], cells.live[pixel]
            for low, high, n, one in zip(*of_pixel, strict=False):
                here = (lag > low) & (lag < high) & (upper[pixel] > lower[pixel])
                assert not one or n == counted[here].sum()
        # Only the cells about the end of the codes' own range are no cells.
        assert (~cells.live).sum(axis=1).max() <= 4

    def test_edges_are_edges_of_codes(self):
        hist = histograms(np.ones((32, 32, PERFECT.n_codes), dtype=np.uint32), PERFECT)
        cells = cells_about(
            sighting_of(hist, PERFECT), np.array([4]), np.array([4]), np.array([26_000.0]), EDGES,
            nominal=False,
        )  # fmt: skip
        inner = (cells.edges_ps[:, :-1] + 26_000.0)[cells.live]
        assert np.allclose(inner % 55.0, 0.0, atol=1e-6)
        assert np.array_equal(cells.counts[cells.live], np.rint(cells.width_ps[cells.live] / 55.0))


def sighting_of(hist, clock):
    """A recording without pulses on the clock that was drawn."""
    from tests.oracles.worlds.border import calibrated

    view = random_world(0).view
    told = what_the_user_tells(random_world(0))
    assert view.shape == hist.shape
    from lightflight.reconstruct.model.setting import Setting

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return sighting_from_histograms(
            hist, Setting(told["camera"], told["source"], told["medium"]),
            timing=calibrated(clock, hist.shape), background=None, exclude_mask=None,
            least_squares=False,
        )  # fmt: skip


class TestPixels:
    def test_unknowns_are_recovered(self):
        """Photons to 4 of their errors, in 60 pixels: by chance once in 250 suites."""
        rng = np.random.default_rng(3)
        cells = table(rng, 5000.0, n=60)
        pixels = lit_pixels(cells, Pulses(np.zeros((60, 1)), np.full((60, 1), STD)))
        error = np.sqrt(pixels.inverse[:, 0, 0])
        assert np.all(np.abs(pixels.photons[:, 0] - 5000.0) < 4.0 * error)
        assert np.median(error) == pytest.approx(np.sqrt(5000.0), rel=0.1)
        assert np.allclose(pixels.background_per_ps, 0.02, rtol=0.2)

    def test_two_pulses_of_one_pixel(self):
        edges = np.tile(EDGES, (1, 1))
        std = np.full(1, STD)
        mean = 900.0 * np.diff(cumulated(edges, np.zeros(1), std, 0.0))
        mean = (
            mean
            + 500.0 * np.diff(cumulated(edges, np.full(1, 400.0), std, 0.0))
            + 1e-3 * np.diff(edges)
        )
        ones = np.ones(mean.shape)
        cells = Cells(edges, mean, ones > 0, 0.0 * ones, ones)
        pixels = lit_pixels(cells, Pulses(np.array([[20.0, 380.0]]), np.full((1, 2), STD)))
        assert pixels.photons[0] == pytest.approx([900.0, 500.0], rel=1e-2)
        assert pixels.late_ps[0] == pytest.approx([0.0, 400.0], abs=2.0)

    def test_late_light_is_its_own_convolution(self):
        """The share that came by t, of a Gaussian late by an exponential: by sums of many waits."""
        edges = np.array([[-200.0, 0.0, 100.0, 400.0, 3000.0]])
        quantile = (np.arange(20_000) + 0.5) / 20_000
        waits = -500.0 * np.log1p(-quantile)
        found = cumulated(edges, np.zeros(1), np.full(1, STD), 500.0)[0]
        assert np.allclose(
            found, norm.cdf((edges[0] - waits[:, None]) / STD).mean(axis=0), atol=2e-4
        )

    def test_a_second_pulse_that_starts_wrong_does_not_run_away(self):
        rng = np.random.default_rng(8)
        cells = table(rng, 300.0, n=30)
        pixels = lit_pixels(cells, Pulses(np.array([[0.0, 10.0]] * 30), np.full((30, 2), STD)))
        assert pixels.photons.sum(axis=1).max() < 2.0 * cells.counts.sum(axis=1).max()


class TestScore:
    @pytest.mark.parametrize(
        ("photons", "background"),
        [(4e4, 0.02), pytest.param(300.0, 2e-4, marks=pytest.mark.long), (30.0, 2e-4)],
    )
    def test_chi2_is_one_where_all_is_well(self, photons, background):
        """p-values of 300 tables are uniform: Kolmogorov-Smirnov at 1e-4."""
        rng = np.random.default_rng(11)
        found = [
            late_light_of(table(rng, photons, background=background))[0].p_value for _ in range(300)
        ]
        assert kstest(found, "uniform").pvalue > 1e-4

    @pytest.mark.parametrize("tail", [0.003, 0.01])
    def test_a_planted_tail_is_recovered(self, tail):
        """Of 500 ps: mean of 40 tables within four of its errors (6e-5), and 20 % of itself."""
        rng = np.random.default_rng(12)
        sizes = np.array([late_light_of(table(rng, 4e4, tail=tail))[1] for _ in range(40)])
        found, error = sizes.sum(axis=1), sizes.sum(axis=1).std() / np.sqrt(40)
        assert abs(found.mean() - tail) < 4.0 * error + 0.2 * tail
        assert np.argmax(sizes.mean(axis=0)) == 1
        one = late_light_of(table(rng, 4e4, tail=tail))[0]
        assert one.sigma > 5.0
        assert one.name == "haze"

    def test_errors_of_code_widths_belong_to_the_variance(self):
        """Widths off by 3 % in lamp light: told, p-values are uniform (1e-4); not told, not."""
        rng = np.random.default_rng(13)
        lamp = {"background": 50.0, "width_error": 0.03}
        told = [late_light_of(table(rng, 4e4, **lamp))[0].p_value for _ in range(200)]
        untold = [late_light_of(table(rng, 4e4, told=0.0, **lamp))[0].p_value for _ in range(50)]
        assert kstest(told, "uniform").pvalue > 1e-4
        assert np.median(untold) < 1e-4

    def test_less_than_no_light_is_no_cause(self):
        rng = np.random.default_rng(14)
        one, sizes = late_light_of(table(rng, 4e4, tail=-0.02))
        assert sizes.sum() < 0.0
        assert one.symptom
        assert one.name == "unexplained_light"

    @pytest.mark.parametrize("shape", [0.5, 2.0, 20.0, 2000.0])
    def test_deviates_of_skewed_sums(self, shape):
        """A gamma variable's deviate is that of its chance, to 0.1 out to five of them.

        Where one count is most of a sum, to a third: fewer false alarms, not more.
        """
        z = np.array([-1.0, 0.0, 1.0, 3.0, 5.0])
        chance = norm.cdf(z)
        values = (gamma.ppf(chance, shape) - shape) / np.sqrt(shape)
        found = from_skewed(values, np.full(5, 2.0 / np.sqrt(shape)))
        assert np.allclose(found, z, atol=0.35 if shape < 10.0 else 0.1)
        mirrored = from_skewed(-values, np.full(5, -2.0 / np.sqrt(shape)))
        assert np.allclose(mirrored, -found)

    def test_a_dark_pixel_says_nothing_of_its_own_level(self):
        """The score of even light is zero: each pixel takes its background up."""
        rng = np.random.default_rng(15)
        cells = table(rng, 0.0, background=1e-3)
        pixels = dark_pixels(cells)
        even = Columns(cells.width_ps[:, :, np.newaxis], np.arange(1), 1)
        left = summed([(pixels, even)]).groups[0].columns
        assert np.abs(left).max() < 0.2 * np.abs(cells.width_ps).max()


class TestCauses:
    def test_columns_have_their_places(self):
        lags = light.other_lags(EDGES, STD)
        asked = causes(lags)
        places = sorted({k for cause in asked for k in cause.columns})
        assert places == list(range(len(places)))
        assert {c.name for c in asked} == {
            "haze", "shape", "other_pulse", "pile_up", "halo", "glare", "unexplained_light",
        }  # fmt: skip
        assert all(cause.remedy for cause in asked)
        assert lags.min() > light.EARLIEST_PS
        assert lags.max() < light.LATEST_PS
        assert np.abs(lags).min() > STD

    def test_halo_spreads_the_light_of_one_pixel(self):
        """Photons within so many px of a bright pixel, at its own time."""
        beam = spread.Beam(
            np.array([[8, 8]]), np.zeros(1, dtype=int), np.array([100.0]), np.array([1e4]), STD
        )
        points = np.array([[8, 11], [8, 16]])
        ones = np.ones((2, len(EDGES) - 1))
        cells = Cells(np.tile(EDGES, (2, 1)), ones, ones > 0, 0.0 * ones, ones)
        found = spread.halo(cells, points, np.zeros(2), beam, (17, 17)).sum(axis=1)
        for k, reach in enumerate(spread.HALO_PX[1:], 1):
            expected = (
                1e4 * np.exp(-0.5 * (np.array([3.0, 8.0]) / reach) ** 2) / (2 * np.pi * reach**2)
            )
            assert np.allclose(found[:, k][expected > 1.0], expected[expected > 1.0], rtol=1e-3)

    def test_glare_is_the_same_everywhere(self):
        beam = spread.Beam(
            np.array([[8, 8], [2, 3]]), np.zeros(2, dtype=int), np.array([100.0, 900.0]),
            np.array([1e4, 2e4]), STD,
        )  # fmt: skip
        ones = np.ones((2, len(EDGES) - 1))
        cells = Cells(np.tile(EDGES, (2, 1)), ones, ones > 0, 0.0 * ones, ones)
        found = spread.glare(cells, np.array([0.0, 500.0]), beam, 1000).sum(axis=1)
        assert np.allclose(found, 30.0, rtol=5e-3)


class TestJudge:
    def test_times_and_light_are_independent(self):
        """p-values of a family of two kinds of data are uniform (1e-3, 200 draws)."""
        rng = np.random.default_rng(21)
        columns = np.linalg.qr(rng.normal(size=(6, 4)))[0]

        def one(data, k, kind):
            z = columns[:, k : k + 1].T @ data
            return Evidence(
                FindingName.HAZE, float(z @ z), 1, 0.0, "", "", columns[:, k : k + 1], z, data=kind
            )

        found = []
        for _ in range(200):
            times, counts = rng.normal(size=(2, 6))
            tests = [one(times, k, "pulses") for k in range(4)]
            tests += [one(counts, k, LIGHT) for k in range(4)]
            found.append(family_p_value(tests))
        assert kstest(found, "uniform").pvalue > 1e-3

    @pytest.mark.parametrize(
        "silent_below", [4.0, *(pytest.param(z, marks=pytest.mark.long) for z in (0.0, 100.0))]
    )
    def test_silent_tests_take_no_share_of_the_budget(self, silent_below):
        """4 tests of times beside 20 of light that speak from some size on: uniform (1e-3).

        What is beyond the size from which all speak is held against all 24. 200 draws.
        """
        rng = np.random.default_rng(22)

        def one(z, k):
            return Evidence(
                FindingName.HAZE, z**2, 1, 0.0, "", "", np.eye(24)[:, k : k + 1], np.array([z]),
                data="pulses" if k < 4 else LIGHT, silent_below=0.0 if k < 4 else silent_below,
            )  # fmt: skip

        found = [
            family_p_value([one(z, k) for k, z in enumerate(rng.normal(size=24))])
            for _ in range(200)
        ]
        assert kstest(found, "uniform").pvalue > 1e-3
        loud = [one(12.0 if k == 9 else 0.0, k) for k in range(24)]
        assert family_p_value(loud) == pytest.approx(24 * loud[9].p_value, rel=0.3)

    def test_light_that_times_do_not_explain_is_named_too(self):
        pose = Evidence(
            FindingName.POSE, 900.0, 1, 899.0, "", "", np.eye(4)[:, :1], np.array([30.0])
        )
        haze = Evidence(
            FindingName.HAZE, 100.0, 1, 99.0, "", "", np.eye(3)[:, :1], np.array([10.0]), data=LIGHT
        )
        assert [e.name for e in named([pose, haze])] == ["pose", "haze"]
        assert [e.name for e in named([pose, replace(haze, chi2=4.0, gain=3.0)])] == ["pose"]


@cache
def recording(seed, defect="", n_legs=3, photons=40_000.0, strength=1, pf32=False):
    world = random_world(seed, n_legs, photons)
    world = with_pf32(world, 0) if pf32 else world
    if defect:
        assert not DEFECTS[defect].held_out
        world = DEFECTS[defect].applied(world, DEFECTS[defect].strengths[strength])
    return record(world, seed), what_the_user_tells(world)


@cache
def verdict_of(*world, method="joint", **others):
    hist, told = recording(*world, **others)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return lf.reconstruct(hist, method=method, **told).verdict


@pytest.mark.parametrize(
    ("defect", "n_legs", "strength", "method", "name"),
    [
        ("haze_500ps", 1, 1, "joint", "haze"),
        pytest.param("haze_500ps", 1, 0, "photon", "haze", marks=pytest.mark.long),
        pytest.param("haze_150ps", 1, 0, "joint", "haze", marks=pytest.mark.long),
        ("response_long_tail", 1, 0, "joint", "shape"),
        pytest.param("prompt_halo_8px", 1, 1, "joint", "halo", marks=pytest.mark.long),
        ("veiling_glare", 1, 1, "photon", "glare"),
        pytest.param("pulse_echo_300ps", 1, 0, "joint", "other_pulse", marks=pytest.mark.long),
        pytest.param("glint", 3, 1, "joint", "unexplained_light", marks=pytest.mark.long),
        ("lens_ghost", 1, 0, "joint", "unexplained_light"),
        ("pile_up_of_ten_periods", 1, 2, "joint", "pile_up"),
    ],
)
def test_light_beside_the_flight_is_named(defect, n_legs, strength, method, name):
    # Pixels that only such light reaches take most of the time: they are fewer by less of it.
    light = 4_000.0 if name in ("halo", "glare") else 40_000.0
    verdict = verdict_of(0, defect, n_legs=n_legs, strength=strength, method=method, photons=light)
    # Other light has a place in the fit: no contradiction where that explains all counts.
    fitted = {"check"} if name == "haze" else {"contradicted"}
    fitted |= {"check"} if name in ("shape", "halo", "glare", "other_pulse") else set()
    assert verdict.level in fitted
    assert name in [finding.name for finding in verdict.findings][:2]


def test_a_calibrated_clock_is_trusted():
    """PF32: unequal codes, delays, dead codes; a recording at a fixed seed, of a hundred one is
    not trusted."""
    assert verdict_of(2, pf32=True).level == "trust"


@pytest.mark.long
def test_how_much_light_is_the_paths_is_said():
    verdict = verdict_of(0, "glint", n_legs=3, strength=1, method="joint", photons=40_000.0)
    said = next(f.sentence for f in verdict.findings if f.name == "unexplained_light")
    # Ten pulses lie in the wings of the spot, where the path gives a thousandth of its light.
    assert "258 of 291 pulses" in said
    assert "photons in pixel (3, 20)" in said


def test_scaled_intensities_are_not_examined():
    hist, told = recording(2, n_legs=1)
    scaled = replace(hist, counts=0.5 * hist.counts, poisson=False)
    # The quarter with most light holds the leg: pixels without a pulse take long to fit.
    light = hist.counts.sum(axis=2)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        verdict = lf.reconstruct(
            scaled, **told, exclude_mask=light < np.quantile(light, 0.75)
        ).verdict
    assert verdict.level != "trust"
    assert any("intensities are scaled" in finding.sentence for finding in verdict.findings)


@pytest.mark.parametrize("what", ["mask", "no period", "repeats", "few pulses", "known pile-up"])
def test_no_recording_raises(what):
    world = random_world(4, 1, 100.0 if what == "few pulses" else 4000.0)
    world = world.but(repeats=5) if what == "repeats" else world
    world = DEFECTS["pile_up_of_ten_periods"].applied(world, 0.5) if "known" in what else world
    world = world.told_but(periods_per_frame=world.periods_per_frame)
    hist, told = record(world, 4), what_the_user_tells(world)
    if what == "mask":
        told["exclude_mask"] = np.random.default_rng(1).uniform(size=world.view.shape) < 0.4
    if what == "no period":
        assert isinstance(hist, lf.Histograms)
        hist = replace(hist, laser_period_ps=None)
        told["timing"] = None
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        verdict = lf.reconstruct(hist, **told).verdict
    assert verdict.level in ("trust", "check")
    examined = "not_examined" not in {finding.name for finding in verdict.findings}
    assert examined == (verdict.n_tests > 20)


@pytest.mark.parametrize("haze", [pytest.param(0.0, marks=pytest.mark.long), 0.1])
def test_another_camera_may_see_light_beyond_the_path(haze):
    """A path ends where the first view does: what a second one sees of it there is no halo."""
    world = random_world(3, 1, 40_000.0).but(haze=haze)
    aside = world.view.moved(np.array([40.0, 15.0, 0.0]))
    worlds = [world, world.but(view=aside).told_but(view=aside)]
    told = [what_the_user_tells(one) for one in worlds]
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        pair = [record(one, 3 + k) for k, one in enumerate(worlds)]
        verdict = lf.reconstruct(
            [hist for hist in pair if isinstance(hist, lf.Histograms)],
            camera=[one["camera"] for one in told],
            timing=[one["timing"] for one in told],
            source=told[0]["source"],
            medium=told[0]["medium"],
        ).verdict
    found = {str(finding.name) for finding in verdict.findings}
    assert ("haze" in found) == (haze > 0.0)
    assert haze or not found & {"haze", "halo", "glare", "other_pulse", "unexplained_light"}
