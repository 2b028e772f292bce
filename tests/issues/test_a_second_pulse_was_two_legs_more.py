"""Fault: beside legs that come towards the camera the light of a second pulse was legs.

Legs dimmer per pixel than a quarter of the brightest were tried without, all at once: a leg of the
path itself was among them. Beside a second pulse the path was measured once, not until it stood.
"""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import lightflight as lf
from benchmarks.misfit_labs import recording_of
from benchmarks.random_labs import pulls_of
from lightflight.errors import GeometryError
from lightflight.reconstruct.trials import revise

pytestmark = pytest.mark.filterwarnings("ignore::lightflight.errors.LightflightWarning")


def test_the_dimmest_go_alone_where_all_dim_legs_were_too_many(monkeypatch):
    """Light per pixel as in that recording: 838 of a second pulse, 7,869 of a leg of the path."""
    photons = np.array([7869.0, 36598.0, 33540.0, 17218.0, 838.0])
    legs = tuple(SimpleNamespace(members=[k], n_pixels=1, view=0) for k in range(5))
    sighting = SimpleNamespace(view=0, arrivals=SimpleNamespace(photons=photons))
    tried = []

    def fitted(_, chain, __, *, drop):
        assert not drop
        tried.append([leg.members[0] for leg in chain])
        if 0 not in tried[-1]:
            raise GeometryError("light would fly faster than it can")
        return "a path"

    monkeypatch.setattr(revise, "fit_from_legs", fitted)
    monkeypatch.setattr(revise, "revised", lambda _, fit, __: fit)
    fit: Any = revise.fit_without_dim_legs
    assert fit([sighting], legs, None) == "a path"
    assert tried == [[1, 2, 3], [0, 1, 2, 3]]


@pytest.mark.long
def test_a_second_pulse_was_two_legs_more():
    """3 % of 49,000 photons, on a camera with a tail: five legs for three, contradicted."""
    lab, hist, told = recording_of("second", 0.03, 933)
    path = lf.reconstruct(hist, **told)
    assert path.n_legs == 3
    assert path.verdict.level == "check", path.verdict
    assert path.verdict.findings[0].sentence.endswith("taken into the fit")
    assert (pulls_of(lab, path)[:, 1] < 5.0).all()
