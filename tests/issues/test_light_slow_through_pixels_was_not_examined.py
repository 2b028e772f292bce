"""Where light took longer than half the response to cross a pixel, its counts were not tested,
though a Gaussian drawn out by a Gaussian spot is one: right paths were "check", or contradicted for
pulses without the shape of the response (`shape`), which light that is drawn out cannot have."""

from __future__ import annotations

import importlib

import pytest

import lightflight as lf
from lightflight.path.verdict import FindingName
from lightflight.reconstruct.other_light.around import DrawnOutError
from tests.oracles.worlds.border import record, what_the_user_tells
from tests.oracles.worlds.light import scaled_to
from tests.oracles.worlds.random_worlds import random_world


def reconstructed(seed, n_legs, spot_px):
    """Of a lens that blurs: light takes about as long to cross its spot as the response lasts."""
    world = random_world(seed, n_legs, 40_000.0, "known").but(spot_std_px=spot_px)
    world = scaled_to(world, 40_000.0)
    return lf.reconstruct(record(world, seed), **what_the_user_tells(world))


@pytest.mark.parametrize(
    ("seed", "n_legs"), [(603, 1), pytest.param(605, 3, marks=pytest.mark.long)]
)
def test_counts_are_tested_and_trusted(seed, n_legs):
    path = reconstructed(seed, n_legs, 1.3)
    assert path.verdict.level == "trust"
    assert path.n_legs == n_legs


def test_pulses_that_flight_draws_out_contradict_nothing(monkeypatch):
    # By its module: the package's name of it is the function.
    examine = importlib.import_module("lightflight.reconstruct.verdict.examine")

    def refused(*_args, **_kwargs):
        raise DrawnOutError("drawn out")

    monkeypatch.setattr(examine, "evidence_from_counts", refused)
    monkeypatch.setattr(examine, "evidence_from_flags", lambda *_: pytest.fail("flags were asked"))
    with pytest.warns(lf.errors.SuspectDataWarning):
        path = reconstructed(600, 1, 0.4)
    assert path.verdict.level == "check"
    assert FindingName.NOT_EXAMINED in {one.name for one in path.verdict.findings}
