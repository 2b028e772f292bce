"""Where the strengths of diffuse light do not settle a fit goes on without them: nobody said so.

Since pixels take no step that leaves their counts less likely, strengths settle in light of 10
photons, where counts have a background: that of a camera without any is left to say so.
"""

from dataclasses import replace

import numpy as np
import pytest

import lightflight as lf
from lightflight.simulate.presets import ideal, paper_scene
from tests.oracles.worlds.border import record, what_the_user_tells
from tests.oracles.worlds.random_worlds import random_world


def of_fibre_without_background():
    """100 photons in glass fibre: no cell beside the light says what background there is."""
    camera = lf.Camera.facing_plane((32, 32), field_of_view_mm=(60.0, 60.0))
    rise = 66.0 * np.tan(np.deg2rad(30.0))
    source = lf.Source((-33.0, 2.0, 0.0), emission_time_ps=2000.0)
    scene = replace(
        paper_scene(ideal(psf_std_px=0.3, active_width_px=0.12)),
        vertices_mm=np.array([[-33.0, 2.0, 0.0], [33.0, 4.0, rise]]),
        camera=camera,
        medium=lf.Medium(1.47, 1.00027),
        source=source,
    )
    hist = lf.simulate(scene, photons_per_pixel=100.0, seed=7)
    return hist, {
        "camera": camera,
        "source": replace(source, emission_time_ps=None),
        "medium": scene.medium,
        "timing": lf.TimingCalibration.nominal(hist),
    }


@pytest.mark.filterwarnings("ignore::lightflight.errors.LightflightWarning")
@pytest.mark.parametrize("photons", [40_000.0, 40.0])
def test_haze_that_counts_tell_is_not_spoken_of(photons):
    world = random_world(71_000, 1, photons)
    path = lf.reconstruct(record(world, 0), **what_the_user_tells(world))
    assert not any("Haze" in said for said in path.statements)


@pytest.mark.filterwarnings("ignore::lightflight.errors.LightflightWarning")
def test_counts_that_do_not_tell_haze_and_the_path_says_so():
    hist, told = of_fibre_without_background()
    (said,) = (said for said in lf.reconstruct(hist, **told).statements if "Haze" in said)
    assert "could not be told" in said
