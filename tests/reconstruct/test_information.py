"""The one climb that all fits share: it finds known tops, and says when it has not."""

from dataclasses import dataclass

import numpy as np
import pytest

from lightflight.reconstruct.model.information import ascend, covariance_from_information


@dataclass(frozen=True)
class _Slope:
    value: float
    score: np.ndarray
    information: np.ndarray


def _poisson(design, counts):
    """Counts of mean exp(design @ x): concave, so its top is known by its score alone."""

    def slope_at(x):
        mean = np.exp(design @ x)
        return _Slope(
            float(np.sum(counts * (design @ x) - mean)),
            design.T @ (counts - mean),
            (design.T * mean) @ design,
        )

    return slope_at


def _added(x, _, step):
    return x + step


def test_the_top_of_a_poisson_likelihood_is_found_from_afar(rng):
    design = np.column_stack((np.ones(400), rng.uniform(-1.0, 1.0, 400)))
    # In units that differ by six decades, and from where a full step would overflow.
    units = np.array([1.0, 1e6])
    truth = np.array([3.0, 1.0])
    counts = rng.poisson(np.exp(design @ truth)).astype(float)
    slope_at = _poisson(design * units, counts)
    x, slope, converged = ascend(np.array([-4.0, 4e-6]), slope_at, _added, most_steps=60)
    assert converged
    covariance = covariance_from_information(slope.information, rcond=1e-14)
    left = covariance @ slope.score / np.sqrt(np.diag(covariance))
    assert np.abs(left).max() < 0.05
    # Five of its own errors: by chance once in a million.
    assert (np.abs(x * units - truth) < 5.0 * np.sqrt(np.diag(covariance)) * units).all()


def test_a_gauge_is_left_where_it_was():
    information = np.diag([4.0, 0.0])

    def slope_at(x):
        return _Slope(-2.0 * (x[0] - 1.0) ** 2, np.array([4.0 * (1.0 - x[0]), 0.0]), information)

    x, _, converged = ascend(np.array([0.0, 7.0]), slope_at, _added, most_steps=20, gauge=1e-14)
    assert converged
    np.testing.assert_allclose(x, [1.0, 7.0], atol=0.01)


@pytest.mark.parametrize("most_steps", [0, 1])
def test_a_climb_that_was_cut_short_says_so(rng, most_steps):
    slope_at = _poisson(np.ones((50, 1)), rng.poisson(20.0, 50).astype(float))
    start = np.array([-3.0])
    _, slope, converged = ascend(start, slope_at, _added, most_steps=most_steps)
    assert not converged
    assert slope.value >= slope_at(start).value


@pytest.mark.parametrize(("away", "reached"), [(0.3, True), (3.0, False)])
def test_a_climb_held_back_by_sway_has_reached_a_top_that_is_near(away, reached):
    """Every other step seems to lead down: damped ever more, it creeps until no step is left."""
    calls = []

    def slope_at(x):
        calls.append(x)
        sway = -1.0 if len(calls) % 2 == 0 else 1e-3 * len(calls)
        return _Slope(-0.5 * float(x @ x) * 1e-6 + sway, -x, np.eye(1))

    _, _, converged = ascend(
        np.array([away]), slope_at, lambda x, _, step: x + 1e-4 * step, most_steps=12
    )
    assert converged == reached


def test_a_wrong_score_ends_where_it_began():
    def slope_at(x):
        return _Slope(float(-(x @ x)), 2.0 * x, np.eye(1))

    x, _, converged = ascend(np.array([3.0]), slope_at, _added, most_steps=200)
    assert not converged
    assert x[0] == 3.0


def test_a_climb_that_only_tiny_steps_lead_up_is_not_at_the_top():
    """Ten errors below it, where nothing further than 1e-3 of one can be evaluated."""

    def slope_at(x):
        value = -0.5 * float((x - 10.0) @ (x - 10.0))
        return _Slope(value if abs(x[0]) < 1e-3 else np.nan, 10.0 - x, np.eye(1))

    x, _, converged = ascend(np.array([0.0]), slope_at, _added, most_steps=200)
    assert 0.0 < x[0] < 1e-3
    assert not converged


def test_a_step_that_is_refused_costs_its_value_alone():
    """From where the first steps overshoot: derivatives are asked for where a climb stood."""
    asked, valued = [], []

    class Watched:
        def __init__(self, x):
            self.x = float(x[0])
            valued.append(self.x)

        @property
        def value(self):
            return -float(np.log(np.cosh(self.x)))

        @property
        def score(self):
            asked.append(self.x)
            return np.array([-np.tanh(self.x)])

        @property
        def information(self):
            return np.array([[np.cosh(self.x) ** -2]])

    x, _, converged = ascend(np.array([3.0]), Watched, _added, most_steps=60)
    assert converged
    assert abs(x[0]) < 0.05
    heights = [-np.log(np.cosh(at)) for at in asked]
    assert heights == sorted(heights)
    assert len(set(asked)) == len(asked) < len(valued)


def test_a_ridge_that_winds_is_followed_to_its_top():
    """Rosenbrock's, a thousand times as long as wide: a damped step along it is short at once."""

    def slope_at(x):
        rest = np.array([1e3 * (x[1] - x[0] ** 2), 1.0 - x[0]])
        by_x = np.array([[-2e3 * x[0], 1e3], [-1.0, 0.0]])
        return _Slope(-0.5 * float(rest @ rest), -by_x.T @ rest, by_x.T @ by_x)

    x, _, converged = ascend(np.array([-5.0, 25.0]), slope_at, _added, most_steps=10, winds=True)
    assert converged
    np.testing.assert_allclose(x, [1.0, 1.0], atol=0.01)


def test_a_slope_that_is_no_number_moves_nothing():
    """Light without bounds has one; what moves may refuse it, as a record of a medium does."""

    def slope_at(x):
        return _Slope(0.0, np.array([np.nan]), np.eye(1))

    def moved(x, _, step):
        raise ValueError("path_group_index must lie between 1 and 10, got nan")

    x, _, converged = ascend(np.array([1.5]), slope_at, moved, most_steps=20)
    assert x == 1.5
    assert not converged


def test_a_ridge_that_winds_takes_few_steps_without_leaps():
    """Rosenbrock's, thirty times as long as wide: by steps ten up, ten down more than 120."""

    def slope_at(x):
        rest = np.array([30.0 * (x[1] - x[0] ** 2), 1.0 - x[0]])
        by_x = np.array([[-60.0 * x[0], 30.0], [-1.0, 0.0]])
        return _Slope(-0.5 * float(rest @ rest), -by_x.T @ rest, by_x.T @ by_x)

    x, _, converged = ascend(np.array([-5.0, 25.0]), slope_at, _added, most_steps=95)
    assert converged
    np.testing.assert_allclose(x, [1.0, 1.0], atol=0.01)
