"""One pixel's Poisson likelihood: the compiled kernel against counts * ln mean - mean."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.special import ndtr

from lightflight._kernels.photon_score import photon_score
from lightflight.reconstruct.model.pulse_shape import tables_for_counts
from lightflight.timing.clock.response import Response

PERIOD, CODES = 50_000.0, 64
ALL_OPEN, GAUSSIAN, NO_OTHER = np.ones((1, 1)), tables_for_counts(None), np.empty((0, 0))


def response_share(response, delay_ps):
    """Share of a response that has come, by its own table."""
    place, come, _ = response.table()
    return np.interp(delay_ps / response.std_ps, place, come)


class TestOnePixel:
    """One pixel's log-likelihood, score and information in its local variables."""

    @staticmethod
    def evaluated(counts, lower, upper, variables, *, period=PERIOD, outside=True, expected=False,
                  open_share=ALL_OPEN, shape=GAUSSIAN, other=NO_OTHER, third=0.0):  # fmt: skip
        n_legs = (len(variables) - 1) // 3
        log_photons, delay, log_std = (variables[k:-1:3][np.newaxis] for k in range(3))
        score, information = np.zeros((1, len(variables))), np.zeros((1, *(len(variables),) * 2))
        assert log_photons.shape == (1, n_legs)
        value = photon_score(
            counts[np.newaxis].astype(float),
            lower[np.newaxis],
            upper[np.newaxis],
            open_share,
            other,
            period,
            shape[0],
            shape[1],
            np.ascontiguousarray(log_photons),
            np.ascontiguousarray(delay),
            np.ascontiguousarray(np.exp(log_std)),
            np.full(delay.shape, third),
            variables[-1:].copy(),
            np.array([outside]),
            expected,
            score,
            information,
        )
        return value, score[0], information[0]

    @staticmethod
    def case(seed, n_legs):
        """Uneven codes, two of them dead, and pulses anywhere, one perhaps across the fold."""
        rng = np.random.default_rng(seed)
        width = rng.uniform(40.0, 70.0, CODES)
        width[[3, 40]] = 0.0
        lower = 1000.0 + np.concatenate(([0.0], np.cumsum(width)[:-1]))
        upper = lower + width
        variables = np.empty(3 * n_legs + 1)
        variables[0:-1:3] = np.log(rng.uniform(20.0, 800.0, n_legs))
        variables[1:-1:3] = rng.uniform(1500.0, 3500.0, n_legs)
        variables[2:-1:3] = np.log(rng.uniform(50.0, 120.0, n_legs))
        variables[-1] = np.log(0.01)
        return rng, lower, upper, variables

    @staticmethod
    def mean_of(lower, upper, variables, period=PERIOD):
        mean = np.exp(variables[-1]) * (upper - lower)
        for k in range((len(variables) - 1) // 3):
            photons, delay, std = (
                np.exp(variables[3 * k]),
                variables[3 * k + 1],
                np.exp(variables[3 * k + 2]),
            )
            for turn in (-1, 0, 1):
                center = delay + turn * period
                mean = mean + photons * (
                    ndtr((upper - center) / std) - ndtr((lower - center) / std)
                )
        return mean

    @pytest.mark.parametrize("n_legs", [1, 2, 3])
    @pytest.mark.parametrize("seed", range(3))
    def test_value_is_that_of_poisson_counts(self, seed, n_legs):
        """Differences of the log-likelihood between two points, against counts * ln mean - mean."""
        rng, lower, upper, variables = self.case(seed, n_legs)
        counts = rng.poisson(self.mean_of(lower, upper, variables))
        other = variables + rng.normal(0, 0.05, len(variables)) * np.where(
            np.arange(len(variables)) % 3 == 1, 100.0, 1.0
        )
        other[-1] = variables[-1]
        found = [self.evaluated(counts, lower, upper, v)[0] for v in (variables, other)]
        live = upper > lower
        expected = []
        for v in (variables, other):
            mean = self.mean_of(lower, upper, v)[live]
            expected.append(float(np.sum(counts[live] * np.log(mean) - mean)))
        assert found[1] - found[0] == pytest.approx(expected[1] - expected[0], abs=2e-6)

    @pytest.mark.parametrize("n_legs", [1, 2, 3])
    @pytest.mark.parametrize("outside", [True, False])
    def test_score_is_the_slope_of_the_value(self, n_legs, outside):
        rng, lower, upper, variables = self.case(7, n_legs)
        counts = rng.poisson(self.mean_of(lower, upper, variables)) + rng.poisson(0.5, CODES)
        variables[1] += 20.0
        _, score, _ = self.evaluated(counts, lower, upper, variables, outside=outside)
        for k in range(len(variables)):
            h = 1e-2 if k % 3 == 1 and k < len(variables) - 1 else 1e-5
            step = np.zeros(len(variables))
            step[k] = h
            up, down = (
                self.evaluated(counts, lower, upper, variables + s, outside=outside)[0]
                for s in (step, -step)
            )
            if k == len(variables) - 1 and not outside:
                continue  # the pseudo-count that stands for what is left out has no slope
            assert score[k] == pytest.approx((up - down) / (2 * h), rel=1e-4, abs=1e-4)

    def test_information_is_the_scores_covariance(self):
        """20,000 draws: an entry of the covariance scatters by at most sqrt(2 / N) = 1 % of the
        product of two errors; six of these is a chance below 1e-7 for all 28."""
        rng, lower, upper, variables = self.case(2, 2)
        mean = self.mean_of(lower, upper, variables)
        draws = 20_000
        scores = np.array(
            [self.evaluated(rng.poisson(mean), lower, upper, variables)[1] for _ in range(draws)]
        )
        _, _, information = self.evaluated(mean, lower, upper, variables)
        scale = np.sqrt(np.diag(information))
        difference = (np.cov(scores.T) - information) / np.outer(scale, scale)
        assert np.abs(difference).max() < 6 * np.sqrt(2 / draws)
        assert np.abs(scores.mean(axis=0)[:-1] / scale[:-1]).max() < 6 / np.sqrt(draws)

    def test_expected_information_needs_no_counts(self):
        rng, lower, upper, variables = self.case(4, 2)
        counts = rng.poisson(self.mean_of(lower, upper, variables))
        _, _, from_counts = self.evaluated(counts, lower, upper, variables)
        nothing = np.zeros(CODES)
        _, score, expected = self.evaluated(nothing, lower, upper, variables, expected=True)
        np.testing.assert_allclose(expected, from_counts, rtol=1e-12)
        np.testing.assert_allclose(score, 0.0, atol=1e-12)

    def test_a_pulse_on_the_fold_is_one_pulse(self):
        rng, lower, upper, variables = self.case(5, 1)
        period = float(upper[-1] - lower[0])
        counts = rng.poisson(self.mean_of(lower, upper, variables, period))
        whole = [self.evaluated(counts, lower, upper, variables, period=period)]
        variables[1] += 3 * period
        whole.append(self.evaluated(counts, lower, upper, variables, period=period))
        for a, b in zip(*whole, strict=True):
            np.testing.assert_allclose(a, b, rtol=1e-9)

    def test_an_absent_leg_is_no_leg(self):
        rng, lower, upper, variables = self.case(6, 2)
        counts = rng.poisson(self.mean_of(lower, upper, variables[[0, 1, 2, 6]]))
        variables[4] = np.nan
        value, score, information = self.evaluated(counts, lower, upper, variables)
        kept = [0, 1, 2, 6]
        alone = self.evaluated(counts, lower, upper, variables[kept])
        assert value == pytest.approx(alone[0], rel=1e-12)
        np.testing.assert_allclose(score[kept], alone[1], rtol=1e-12)
        np.testing.assert_allclose(information[np.ix_(kept, kept)], alone[2], rtol=1e-12)
        np.testing.assert_array_equal(score[3:6], 0.0)

    # Pulses of 50 to 120 ps, of a response of 85: narrower, wider, and wider than tables reach.
    @pytest.mark.parametrize("most_ps", [None, 150.0])
    @pytest.mark.parametrize("outside", [True, False])
    def test_score_of_a_tailed_pulse_behind_pile_up_is_the_slope_of_the_likelihood(
        self, outside, most_ps
    ):
        rng, lower, upper, variables = self.case(9, 2)
        given = {
            "shape": tables_for_counts(
                Response.with_tail(std_ps=60.0, tail_ps=90.0, tail_share=0.3), most_ps
            ),
            "open_share": np.linspace(1.0, 0.5, CODES)[np.newaxis],
            "outside": outside,
        }
        counts = rng.poisson(self.mean_of(lower, upper, variables))
        _, score, information = self.evaluated(counts, lower, upper, variables, **given)
        for i, step in enumerate(1e-4 / np.sqrt(np.diag(information))):
            value = []
            for sign in (1.0, -1.0):
                moved = variables.copy()
                moved[i] += sign * step
                value.append(self.evaluated(counts, lower, upper, moved, **given)[0])
            error = np.sqrt(information[i, i])
            assert (value[0] - value[1]) / (2.0 * step) == pytest.approx(
                score[i], abs=0.02 * error + 1e-3 * abs(score[i])
            )

    def test_a_tailed_pulse_cut_by_a_corner_is_skewed(self):
        """Half of a footprint: what comes is a half Gaussian of flight, spread by the response."""
        response = Response.with_tail(std_ps=60.0, tail_ps=200.0, tail_share=0.5)
        late = 50.0 * np.abs(np.random.default_rng(3).normal(size=4000))
        edges = np.arange(1500.0, 4000.0, 50.0)
        come = np.mean([response_share(response, edges - 2000.0 - flight) for flight in late], 0)
        true = 1e4 * np.diff(come)
        std = np.hypot(response.std_ps, late.std())
        variables = np.array([np.log(1e4), 2000.0 + late.mean(), np.log(std), np.log(1e-9)])
        off = late - late.mean()
        found = [
            [
                -self.evaluated(
                    np.zeros(1), edges[k : k + 1], edges[k + 1 : k + 2], variables,
                    shape=tables_for_counts(response, std), third=third,
                )[0]
                for k in range(len(true))
            ]
            for third in (0.0, float(np.mean(off**3)))
        ]  # fmt: skip
        plain, skewed = (np.abs(true - one).sum() for one in found)
        assert skewed < 0.4 * plain
        assert skewed < 0.002 * true.sum()

    def test_half_of_the_photons_counted_is_half_of_the_information(self):
        _, lower, upper, variables = self.case(9, 2)
        mean = self.mean_of(lower, upper, variables)
        whole, half = (
            self.evaluated(share * mean, lower, upper, variables, open_share=np.array([[share]]))
            for share in (1.0, 0.5)
        )
        scale = np.sqrt(np.diag(whole[2]))
        np.testing.assert_allclose(
            half[2] / np.outer(scale, scale), 0.5 * whole[2] / np.outer(scale, scale), atol=1e-6
        )
        # Expected counts have no slope but for the half count that stands for dark codes.
        assert np.abs(half[1] / scale).max() < 0.1

    def test_compiled_and_plain_agree(self):
        plain = getattr(photon_score, "py_func", None)
        if plain is None:
            pytest.skip("Numba runs without its compiler here")
        rng, lower, upper, variables = self.case(8, 2)
        counts = rng.poisson(self.mean_of(lower, upper, variables))
        tailed = Response.with_tail(std_ps=60.0, tail_ps=90.0, tail_share=0.3)
        for shape in (GAUSSIAN, tables_for_counts(tailed, 150.0)):
            compiled = self.evaluated(counts, lower, upper, variables, shape=shape)
            score, information = np.zeros((1, 7)), np.zeros((1, 7, 7))
            value = plain(
                counts[np.newaxis].astype(float), lower[np.newaxis], upper[np.newaxis], ALL_OPEN,
                NO_OTHER, PERIOD, shape[0], shape[1],
                variables[np.newaxis, 0:-1:3], variables[np.newaxis, 1:-1:3],
                np.exp(variables[np.newaxis, 2:-1:3]), np.zeros((1, 2)), variables[-1:],
                np.array([True]), False,
                score, information,
            )  # fmt: skip
            assert value == pytest.approx(compiled[0], rel=1e-12)
            np.testing.assert_allclose(score[0], compiled[1], rtol=1e-9, atol=1e-9)
            np.testing.assert_allclose(information[0], compiled[2], rtol=1e-9, atol=1e-9)
