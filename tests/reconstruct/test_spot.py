"""The spot of a pixel with a large active area: against the integral along a line, written out."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.special import ndtr

from lightflight.reconstruct.model.spot import SeenLine, seen_line

LENS_PX = 0.26
N = 40


@pytest.fixture
def lines(rng):
    """Distances, headings."""
    return rng.uniform(-1.8, 1.8, N), rng.uniform(-np.pi, np.pi, N)


def spot_of(active: float, lens: float = LENS_PX) -> np.ndarray:
    return np.full(N, np.hypot(lens, active / np.sqrt(12.0)))


def integrated(across: float, heading: float, active: float) -> tuple[float, float]:
    """Light along a line that passes a pixel whose active area lies square to u and v."""
    s, ahead, down = np.linspace(-5.0, 5.0, 8001), np.cos(heading), np.sin(heading)

    def caught(place: np.ndarray) -> np.ndarray:
        half = 0.5 * active
        return np.asarray(ndtr((place + half) / LENS_PX) - ndtr((place - half) / LENS_PX)) / active

    seen = caught(s * ahead + across * down) * caught(s * down - across * ahead)
    return float(seen.sum() * (s[1] - s[0])), float(s @ seen / seen.sum())


@pytest.mark.parametrize("active", [1.0, 0.61])
def test_against_the_integral(lines, active):
    across, heading = lines
    spot = spot_of(active)
    seen = seen_line(across, spot, heading, active_px=active)
    light, ahead = np.transpose(
        [integrated(y, angle, active) for y, angle in zip(across, heading, strict=True)]
    )
    assert seen.log_light == pytest.approx(np.log(light * np.sqrt(2 * np.pi) * spot), abs=1e-6)
    assert seen.ahead_px == pytest.approx(ahead, abs=1e-6)


@pytest.mark.parametrize(("active", "lens"), [(1.0, LENS_PX), (0.5, 0.4), (1.0, 0.01)])
def test_derivatives(lines, active, lens):
    """The last is sharper than is believed: the area shrinks with its spot."""
    (across, heading), spot = lines, spot_of(active, lens)
    seen, step = seen_line(across, spot, heading, active_px=active), 1e-5

    def slopes(up: SeenLine, down: SeenLine) -> tuple[np.ndarray, np.ndarray]:
        return (
            (up.log_light - down.log_light) / (2 * step),
            (up.ahead_px - down.ahead_px) / (2 * step),
        )

    def moved(side: float) -> SeenLine:
        return seen_line(across + side * step, spot, heading, active_px=active)

    def widened(side: float) -> SeenLine:
        return seen_line(across, spot * np.exp(side * step), heading, active_px=active)

    def larger(side: float) -> SeenLine:
        return seen_line(across, spot, heading, active_px=(active**4 + side * step) ** 0.25)

    for changed, of_light, of_place in (
        (moved, seen.by_across, seen.ahead_by_across),
        (widened, seen.by_log_spot, seen.ahead_by_log_spot),
        (larger, seen.by_area, seen.ahead_by_area),
    ):
        light, place = slopes(changed(1.0), changed(-1.0))
        assert light == pytest.approx(of_light, rel=1e-5, abs=1e-5)
        assert place == pytest.approx(of_place, rel=1e-5, abs=1e-5)


def test_a_small_area_is_a_gaussian_and_its_slopes_are_the_lowest_order(lines):
    across, heading = lines
    spot = np.full(N, 0.4)
    none = seen_line(across, spot, heading, active_px=0.0)
    small = seen_line(across, spot, heading, active_px=0.15)
    assert none.log_light == pytest.approx(-0.5 * (across / spot) ** 2)
    assert not none.ahead_px.any()
    # What is left is of the sixth power: a tenth of the fourth.
    for change, slope in (
        (small.log_light - none.log_light, none.by_area),
        (small.ahead_px, none.ahead_by_area),
    ):
        scale = np.abs(slope).max() * 0.15**4
        assert change == pytest.approx(slope * 0.15**4, abs=0.05 * scale)


def test_lines_along_rows_and_diagonals_are_seen_at_their_feet():
    across, heading = np.full(8, 0.4), np.arange(8) * np.pi / 4
    seen = seen_line(across, np.full(8, 0.39), heading, active_px=1.0)
    assert np.abs(seen.ahead_px).max() < 1e-12
    between = seen_line(across, np.full(8, 0.39), heading + np.pi / 8, active_px=1.0)
    assert np.abs(between.ahead_px).min() > 0.01
