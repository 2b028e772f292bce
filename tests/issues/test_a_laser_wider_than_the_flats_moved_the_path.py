"""Fault: pulses a tenth wider than the flat's put a trusted path 6 stated errors off.

A camera with a tail: its response was stretched to the width of the recording's pulses, tail and
all, which come late then. A wider laser spreads a pulse; its tail stays as long as it is.
"""

from __future__ import annotations

import warnings
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import lightflight as lf
from benchmarks.misfit_labs import recording_of
from benchmarks.random_labs import pulls_of
from lightflight.errors import LightflightWarning
from lightflight.reconstruct.model import counted
from lightflight.reconstruct.model.cells import Cells, lag_edges
from lightflight.reconstruct.model.expected_counts import Pulses
from lightflight.reconstruct.model.pulse_shape import shape_of
from lightflight.timing.clock.response import Response


@pytest.mark.parametrize(("wider", "changed"), [(0.3, True), (0.02, True), (0.003, False)])
def test_all_pulses_are_spread_as_the_pixels_show_them(wider, changed):
    """Five pixels, each held to half of what it would say by itself."""
    expected, inverse = np.full((5, 1), 0.1), np.zeros((5, 4, 4))
    inverse[:, -3, -3] = 0.5
    pixels: Any = SimpleNamespace(
        shape=SimpleNamespace(flight=expected + 0.5 * wider), inverse=inverse
    )
    response = shape_of(Response.with_tail(std_ps=70.0, tail_ps=200.0, tail_share=0.3).anchored())
    pulses = Pulses(np.zeros((5, 1)), np.full((5, 1), 70.0), shape=response.drawn_out(expected))
    alike, is_changed = counted.as_wide_as_seen(pulses, pixels)
    assert is_changed == changed
    assert alike.shape.flight is not None
    np.testing.assert_allclose(alike.shape.flight, expected + (wider if changed else 0.0))


@pytest.mark.parametrize("tail", [0.0, 0.3])
def test_a_pulse_with_a_tail_is_spread_and_never_stretched(tail):
    edges = np.tile(lag_edges(70.0, 56.0, 1.3, 50_000.0), (2, 1))
    counts = np.ones((2, edges.shape[1] - 1))
    cells = Cells(edges, counts, counts > 0.0, 0.0 * counts, counts)
    response = Response.with_tail(std_ps=70.0, tail_ps=200.0, tail_share=tail).anchored()
    shape = shape_of(response if tail else None)
    if tail:
        shape = shape.drawn_out(np.zeros((2, 1)))
    own = counted._own_of(
        cells, Pulses(np.zeros((2, 1)), np.full((2, 1), 70.0), shape=shape), 0.0, False
    )
    held = own.prior[:, -2] > 1e6
    assert held.all() if tail else not held.any()


@pytest.mark.long
@pytest.mark.parametrize(("seed", "by", "level"), [(1000, 0.3, "trust"), (902, 0.1, "trust")])
def test_wider_pulses_leave_the_path_where_it_is(seed, by, level):
    """Were 34 and 6 stated errors; the chance of a pull above 5 is 1e-6 a number."""
    lab, hist, told = recording_of("wider", by, seed)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", LightflightWarning)
        path = lf.reconstruct(hist, **told)
    assert path.verdict.level == level, path.verdict
    assert (pulls_of(lab, path)[:, 1] < 5.0).all()
