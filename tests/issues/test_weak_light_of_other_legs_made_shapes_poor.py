"""Fault: "24 of 399 pulses do not have the shape of the laser's pulse", on a right path.

Short pulses, pixels as wide as their pitch: in bright pixels another leg's light, 0.4 % of the
pulse, is no pulse of its own and makes the fit of one poor. Flags were asked where the counts had
answered.
"""

from __future__ import annotations

import importlib
import warnings

import numpy as np

import lightflight as lf
from lightflight import flags
from lightflight.errors import SuspectDataWarning
from tests.oracles.worlds.border import record, what_the_user_tells
from tests.oracles.worlds.random_worlds import random_world


def test_counts_answer_for_flags(monkeypatch):
    """Every twelfth pulse is called poor; its counts are as the path says. Fixed seed."""
    sightings = importlib.import_module("lightflight.reconstruct.sightings")
    find = sightings.find_arrivals

    def doubted(*words, **more):
        arrivals = find(*words, **more)
        arrivals.flags[::12] |= np.uint32(flags.POOR_FIT)
        return arrivals

    monkeypatch.setattr(sightings, "find_arrivals", doubted)
    world = random_world(2, 3)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", SuspectDataWarning)
        path = lf.reconstruct(record(world, 2), **what_the_user_tells(world))
    assert (path.residuals["flags"] & flags.POOR_FIT).astype(bool).mean() > 0.05
    assert path.verdict.level == "trust", path.verdict
