"""Light about corners and ends in the picture was held to nothing.

No test of counts looks within two pixels of them, and pulses there take no part in the fit: where a
first leg lay there as a whole (two pixels long, steep, from a source in view) a path was trusted
37 mm and 80 stated errors off, with 7 % of the light at times when none of its legs is there. Nor
was it said in a room too large for these tests that half of the light is on no leg.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import lightflight as lf
from lightflight.path.verdict import NOT_EXAMINED, FindingName, Level, Verdict
from lightflight.reconstruct.verdict import examine
from lightflight.reconstruct.verdict.unclaimed_light import verdict_with_unclaimed_light
from tests.oracles.worlds.border import record, what_the_user_tells
from tests.oracles.worlds.random_worlds import random_world


def asked_about(monkeypatch):
    """Verdict, fit, sightings and setting as a recording of three legs is asked about."""
    seen = []

    def noting(*given):
        seen.append(given)
        return verdict_with_unclaimed_light(*given)

    monkeypatch.setattr(examine, "verdict_with_unclaimed_light", noting)
    world = random_world(0, 3)
    path = lf.reconstruct(record(world, 0), **what_the_user_tells(world))
    assert path.verdict.level is Level.TRUST
    return seen[-1]


@pytest.mark.parametrize("late_ps", [0.0, 400.0])
def test_pulses_at_corners_that_no_leg_explains_were_silent(late_ps, monkeypatch):
    """Those that took no part come late: as found the path is trusted, and late it is "check"."""
    verdict, fit, sightings, setting = asked_about(monkeypatch)
    (one,) = sightings
    arrivals = one.arrivals
    unused = np.setdiff1d(one.usable_pulses, fit.times.index[fit.times.weight > 0])
    bright = unused[np.argsort(-arrivals.photons[unused])]
    share = np.cumsum(arrivals.photons[bright]) / arrivals.photons[one.usable_pulses].sum()
    some = bright[: int(np.searchsorted(share, 0.04)) + 1]
    times = one.arrival_ps.copy()
    times[some] += late_ps
    late = replace(one, arrival_ps=times)
    told = verdict_with_unclaimed_light(verdict, fit, [late], setting)
    assert told.level is (Level.CHECK if late_ps else Level.TRUST)
    names = [finding.name for finding in told.findings]
    assert names == ([FindingName.UNEXPLAINED_LIGHT] if late_ps else [])
    # The same is said where counts were not examined; tests of counts that were have said it.
    told = verdict_with_unclaimed_light(NOT_EXAMINED, fit, [late], setting)
    assert len(told.findings) == 1 + bool(late_ps)
    doubt = replace(NOT_EXAMINED.findings[0], name=FindingName.CURVED_LEG)
    told = verdict_with_unclaimed_light(Verdict(Level.CHECK, (doubt,)), fit, [late], setting)
    assert told.findings == (doubt,)
