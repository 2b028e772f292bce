"""A leg tried as bent ran behind the camera, where pictures of its places are no numbers: the fit
stayed there, and the price of what is known beside it ended in an error of the linear algebra. So
did the test of a focal length, where another lens sees a place of such a leg behind itself (4014).

Laboratory 4016 of `benchmarks/piece_labs.py`, unseen legs. Where a fit may not end is asked in one
place: `refuse_run_away`.
"""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from benchmarks.piece_labs import drawn_scene, path_of
from lightflight.errors import NothingFoundError
from lightflight.reconstruct.fit.joint import refuse_run_away
from lightflight.reconstruct.model.offsets import line_offsets
from lightflight.reconstruct.verdict import candidates, geometry_tests
from tests.labs import fit_from_truth, one_leg


@pytest.mark.long
@pytest.mark.filterwarnings("ignore::lightflight.errors.LightflightWarning")
def test_a_path_comes_out():
    """Its legs are not those of the scene, and it says so."""
    path = path_of(drawn_scene("unseen", 4016))
    assert path.verdict.level != "trust"
    assert np.isfinite(path.covariance).all()


@pytest.mark.parametrize(
    ("away_mm", "rows", "why"),
    [
        (2e6, [0.1, 0.2], None),
        (2e7, [0.1, 0.2], "out of all bounds"),
        (np.nan, [0.1, 0.2], "out of all bounds"),
        (2e2, [0.1, np.nan], "behind the camera"),
    ],
)
def test_where_a_fit_may_not_end(away_mm, rows, why):
    state: Any = SimpleNamespace(vertices_mm=np.array([[0.0, 0.0, 0.0], [away_mm, 10.0, 0.0]]))
    if why is None:
        refuse_run_away(state, np.array(rows))
        return
    with pytest.raises(NothingFoundError, match=why):
        refuse_run_away(state, np.array(rows))


def test_places_that_another_lens_does_not_see_say_nothing_of_it(monkeypatch):
    lab = one_leg()
    fit, sighting, setting = fit_from_truth(lab, lab.recording(1))

    def behind(*given, camera, **told):
        offset, jacobian = line_offsets(*given, camera=camera, **told)
        # The cameras of the fit see all there is.
        lost = camera not in fit.solution.cameras
        return np.where(np.arange(len(offset)) < lost, np.nan, offset), jacobian

    monkeypatch.setattr(candidates, "line_offsets", behind)
    found = geometry_tests.evidence_from_geometry(fit, [sighting], setting)
    assert {one.name for one in found} >= {"focal_length", "distortion", "pose", "index"}
    assert np.isfinite([one.chi2 for one in found]).all()
