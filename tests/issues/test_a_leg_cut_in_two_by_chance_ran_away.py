"""A leg of few photons was cut into two that turn by 14 degrees, and one of them flew 900 km.

Corners that turn by more than 12 degrees were no error of the model, whatever they won: here a
chi-square of five for three numbers. What other light was fitted beside them led the last leg out
of the room, and the fit that had run away was kept: three legs for two, contradicted; from `photon`
an error (`benchmarks/random_labs.py`, laboratory 490).
"""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from benchmarks.random_labs import FAR_STDS, drawn_lab, path_of, pulls_of
from lightflight.errors import GeometryError
from lightflight.reconstruct.other_light import diffuse

pytestmark = pytest.mark.filterwarnings("ignore::lightflight.errors.LightflightWarning")


@pytest.mark.parametrize("method", ["joint", pytest.param("photon", marks=pytest.mark.long)])
def test_it_is_one_leg(method):
    lab = drawn_lab(490)
    path = path_of(lab, method)
    assert path.n_legs == 2
    assert path.verdict.level == "trust", path.verdict
    assert (pulls_of(lab, path)[:, 1] < FAR_STDS).all()


@pytest.mark.parametrize(("away_mm", "ends"), [(2e5, False), (4e5, True)])
def test_fits_that_run_away_are_refused(away_mm, ends):
    """Beyond 300 m no picture shows a flight."""
    state = SimpleNamespace(vertices_mm=np.array([[0.0, 0.0, 0.0], [away_mm, 10.0, 0.0]]))
    fit: Any = SimpleNamespace(solution=SimpleNamespace(state=state))
    if ends:
        with pytest.raises(GeometryError, match="runs away"):
            diffuse._refuse_endless(fit)
    else:
        diffuse._refuse_endless(fit)
