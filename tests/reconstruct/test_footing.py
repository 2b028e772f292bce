"""Moments of a cut footprint: derivatives against differences, the uncut one in closed form."""

import numpy as np
import pytest

from lightflight.reconstruct.model.footing import Corners, footing

SPOT_PX = 0.32
N = 12


def cut_at(before, after):
    return Corners(before, after, np.zeros((N, 1)), np.zeros((N, 1)))


@pytest.fixture
def case():
    rng = np.random.default_rng(0)
    return {
        "log_slope": 0.3 * rng.normal(size=N),
        "time_slope": 100.0 * rng.normal(size=N),
        "time_curvature": 2.0 * rng.normal(size=N),
        "before": np.where(rng.random(N) < 0.5, -np.inf, rng.uniform(-1.2, 0.2, N)),
        "after": np.where(rng.random(N) < 0.5, np.inf, rng.uniform(0.3, 1.2, N)),
        "spot_px": SPOT_PX,
    }


def moments(case):
    given = dict(case)
    corners = cut_at(given.pop("before"), given.pop("after"))
    return footing(
        given["log_slope"],
        given["time_slope"],
        given["time_curvature"],
        corners,
        spot_px=given["spot_px"],
    )


@pytest.mark.parametrize("moment", ["log_share", "offset_ps", "variance_ps2"])
@pytest.mark.parametrize(
    ("derivative", "moved"),
    [
        ("by_slope", "log_slope"),
        ("by_before", "before"),
        ("by_after", "after"),
        ("by_log_spot", "spot_px"),
    ],
)
def test_derivatives_are_differences(case, moment, derivative, moved):
    step = 1e-5
    if moved == "spot_px":
        up, down = (case | {moved: SPOT_PX * np.exp(sign * step)} for sign in (1, -1))
    else:
        up, down = (case | {moved: case[moved] + sign * step} for sign in (1, -1))
    rise = getattr(moments(up), moment).value - getattr(moments(down), moment).value
    given = getattr(getattr(moments(case), moment), derivative)
    # The spot is integrated to four of its widths, and its derivative as if to infinity.
    tolerance = 1e-2 if moved == "spot_px" else 1e-6
    scale = np.abs(rise / (2 * step)).max()
    np.testing.assert_allclose(given, rise / (2 * step), atol=tolerance * scale)


def test_uncut_footprint_in_closed_form(case):
    """A Gaussian spot times exp(k s) is a Gaussian about k v of variance v."""
    whole = case | {"before": np.full(N, -np.inf), "after": np.full(N, np.inf)}
    found, v = moments(whole), SPOT_PX**2
    mean_s = case["log_slope"] * v
    slope, bend = case["time_slope"], case["time_curvature"]
    mean = slope * mean_s + 0.5 * bend * (mean_s**2 + v)
    variance = (slope + bend * mean_s) ** 2 * v + 0.5 * bend**2 * v**2
    np.testing.assert_allclose(found.log_share.value, 0.0, atol=1e-3)
    np.testing.assert_allclose(found.offset_ps.value, mean, rtol=2e-3, atol=2e-3)
    np.testing.assert_allclose(found.variance_ps2.value, variance, rtol=3e-3)
