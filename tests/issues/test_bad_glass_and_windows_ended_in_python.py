"""A water surface told behind the source, and more legs told than glass leaves: errors of NumPy.

"SVD did not converge" and "need at least one array to concatenate", each in place of a sentence.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import lightflight as lf
from lightflight.errors import GeometryError, NothingFoundError
from lightflight.simulate.presets import ideal, paper_scene

GLASS = lf.Material.named("BK7", wavelength_nm=532.0)
WATER = lf.Material.named("water", wavelength_nm=532.0)
ENDS = np.array([[0.0, 0.0, 0.0], [375.0, 40.0, 30.0]])


def call_of(medium=None, camera=None):
    """What a user says of a recording of one leg that the twin draws."""
    scene = paper_scene(ideal(psf_std_px=0.3, active_width_px=0.12))
    scene = replace(scene, vertices_mm=ENDS, **({} if medium is None else {"medium": medium}))
    hist = lf.simulate(scene, photons_per_pixel=2_000.0, seed=1)
    return {
        "hist": hist, "camera": scene.camera if camera is None else camera(scene.camera),
        "source": lf.Source(tuple(ENDS[0]), emission_time_ps=2000.0), "medium": medium,
        "timing": lf.TimingCalibration.nominal(hist),
    }  # fmt: skip


@pytest.mark.parametrize("surface_mm", [-5.0, -15.0, -25.0])
def test_a_beam_that_comes_through_the_interface_is_refused(surface_mm):
    """The source at z = 0 stands before water that begins behind it, seen from the camera."""

    def with_water(camera):
        surface = lf.Interface((0.0, 0.0, surface_mm), (0.0, 0.0, 1.0), WATER)
        return replace(camera, interfaces=(surface,))

    call = call_of(camera=with_water)
    with pytest.raises(GeometryError, match="before the last interface, on the camera's side"):
        lf.reconstruct(call.pop("hist"), **call)


def test_a_source_that_may_stand_behind_the_interface_is_not_refused():
    def with_water(camera):
        surface = lf.Interface((0.0, 0.0, -1.0), (0.0, 0.0, 1.0), WATER)
        return replace(camera, interfaces=(surface,))

    call = call_of(camera=with_water)
    call["source"] = replace(call["source"], position_std_mm=1.0)
    with pytest.raises(ValueError, match=r"^(?!.*before the last interface)"):
        lf.reconstruct(call.pop("hist"), **call)


def test_more_legs_than_glass_leaves_end_in_a_sentence():
    block = lf.Block(
        0.35 * ENDS[1], ENDS[1] - ENDS[0], thickness_mm=20.0, diameter_mm=25.0, glass=GLASS
    )
    call = call_of(medium=lf.Medium(blocks=[block]))
    with pytest.raises(NothingFoundError):
        lf.reconstruct(call.pop("hist"), **call, n_legs=9, method="photon")
