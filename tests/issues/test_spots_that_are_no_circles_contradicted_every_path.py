"""A spot that is no circle made times lean to the sides of legs, and every path was contradicted.

Lenses make ellipses off their axis. Where a leg crosses one askew, a pixel on one side of its line
sees light from ahead of its foot, and on the other from behind: with axes as 4 to 5, by 0.2 px at a
pixel's distance. Of nine laboratories (`benchmarks/random_labs.py --spot-ratio 0.8`, 1160 to 1168)
eight were contradicted ("neighbouring pixels disagree", up to 37 sigma), with errors widened by
what the times scattered.
"""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from benchmarks.random_labs import drawn_lab, path_of, pulls_of, slants_of
from lightflight.reconstruct.fit import slanted_spots
from lightflight.reconstruct.model.thick_beam import BEAM_SHARES, OWN_SHARES
from lightflight.reconstruct.model.unknowns import pushed_over_edges


@pytest.mark.parametrize(
    ("by_leans", "by_delays", "asked"),
    [(60.0, 0.0, True), (20.0, 0.0, False), (60.0, 60.0, False)],
)
def test_spots_lean_where_times_do_by_more_than_chance(monkeypatch, by_leans, by_delays, asked):
    """And by more than delays askew explain; three legs, 300 pulses."""
    leans, askew = np.zeros((300, 3)), np.zeros((300, 2))
    monkeypatch.setattr(slanted_spots, "_leans", lambda *_: {})
    monkeypatch.setattr(slanted_spots, "stacked_by_leg", lambda *_: leans)
    monkeypatch.setattr(slanted_spots, "_delays_askew", lambda _: askew)
    monkeypatch.setattr(
        slanted_spots, "_gained", lambda _, columns: by_leans if columns is leans else by_delays
    )
    fit: Any = SimpleNamespace(slanted=False)
    setting: Any = None
    assert slanted_spots.asks_for_slanted_spots(fit, setting) == asked


@pytest.mark.parametrize("edge", [0, 1])
def test_a_share_at_its_edge_holds_no_climb_up(edge):
    """The least and the most that a fit may try, and slopes that lead over it or back."""
    over = (-1.0, 1.0)[edge]
    layout: Any = SimpleNamespace(beam=0, own_shares=(1, 3))
    shares = (OWN_SHARES[edge], 0.5), (OWN_SHARES[edge], OWN_SHARES[edge])
    light: Any = SimpleNamespace(beam_share=BEAM_SHARES[edge], own_shares=shares)
    score = over * np.array([1.0, 1.0, 1.0, 1.0, -1.0])
    assert pushed_over_edges(light, layout, score) == [0, 1, 3]


@pytest.mark.long
@pytest.mark.parametrize("method", ["joint", "photon"])
@pytest.mark.parametrize("seed", [1165, 1168])
def test_leaning_times_have_a_place(seed, method):
    """Three legs, 9,000 and 54,000 photons in the brightest pixel; farthest of six places below 4.5
    stated errors (false alarm 1e-4 for both); slants as spots have them, and as known as stated
    (chi-square of three, 5e-5 each; of 42 legs of 1160 to 1183 the rms pull is 1.00)."""
    lab = drawn_lab(seed, spot_ratio=0.8)
    path = path_of(lab, method)
    assert path.n_legs == 3
    assert path.verdict.level == "trust"
    assert pulls_of(lab, path)[:, 1].max() < 4.5
    true, found, std = slants_of(lab, path).T
    assert len(true) == 3
    assert ((found - true) ** 2 / std**2).sum() < 22.6
    assert std.max() < 0.02 < abs(true).min()


def test_times_lean_as_the_covariance_of_the_spot_says():
    """The mean place along a line of what a pixel beside it sees, summed for an ellipse askew."""
    from lightflight.reconstruct.fit.slanted_spots import _SLANT_STD, _one_sigma_ps

    turn, axes = np.radians(35.0), np.array([0.4, 0.5])
    turned = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
    covariance = turned @ np.diag(axes**2) @ turned.T
    along = np.linspace(-6.0, 6.0, 4001)
    aside = 0.7
    places = np.column_stack((-along, np.full_like(along, aside)))
    seen = np.exp(-0.5 * np.sum(places @ np.linalg.inv(covariance) * places, axis=1))
    ahead = float(np.sum(along * seen) / np.sum(seen))
    slant = -covariance[0, 1] / covariance[1, 1]
    of_one = _one_sigma_ps(np.array([15.0]), np.array([aside]), np.array([0.5]))
    assert 15.0 * ahead == pytest.approx(float(of_one[0]) * slant / _SLANT_STD, rel=1e-6)
