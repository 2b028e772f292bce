"""Light went out of the picture over a roof mirror and came back 33 mm beside its own way.

Legs were joined as if all of them were seen: the way between became legs within the picture, up to
six of them and 23 mm off, some told without a word. It is a leg that nobody saw.
"""

from __future__ import annotations

import warnings

import pytest

import lightflight as lf
from benchmarks.unseen_legs import error2_in_view, found_its_gap
from lightflight.errors import LightflightWarning
from tests.oracles.refracted_border import camera_told, histograms
from tests.oracles.unseen_ways import roof_or_cube


@pytest.mark.long
def test_a_roof_mirror_made_six_wrong_legs():
    way = roof_or_cube(4)
    scene, hist = way.scene, histograms(way.scene, 4)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", LightflightWarning)
        path = lf.reconstruct(
            hist,
            camera=camera_told(scene),
            source=lf.Source(tuple(scene.vertices_mm[0]), emission_time_ps=scene.emission_time_ps),
            timing=lf.TimingCalibration.nominal(hist),
        )
    assert [leg.seen for leg in path.legs] == [True, False, True, True]
    assert found_its_gap(path, way)
    assert path.verdict.level == "check"
    error2, stated2 = error2_in_view(path, way)
    # Nearly one number, the depth after the way: four of its errors, once in 10,000 times.
    assert error2 < 16.0 * stated2
