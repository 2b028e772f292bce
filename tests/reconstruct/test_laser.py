"""The laser's own width from the pulses of a path, and how long it looks leg by leg."""

import numpy as np
import pytest

import lightflight as lf
from lightflight.units import fwhm_from_std
from tests.labs import one_leg, three_legs

RESPONSE = 150.0
LASER = np.sqrt(fwhm_from_std(70.0) ** 2 - RESPONSE**2)
"""What the labs' 70 ps leave beside that response: 68.4 ps."""


@pytest.mark.parametrize(("lab", "photons"), [(one_leg, 4000.0), (three_legs, 40_000.0)])
def test_the_width_comes_back_within_its_error_whatever_the_legs_do(lab, photons):
    """Legs of the paper's scene cross a pixel in up to 40 ps: the path says how much."""
    lab = lab()
    hist = lab.recording(5, photons)
    setting = {"camera": lab.camera, "source": lab.known, "timing": lab.timing}
    path = lf.reconstruct(hist, **setting)
    pulse = lf.laser_pulse(path, hist, timing=lab.timing, response_fwhm_ps=RESPONSE)
    assert abs(pulse.width.fwhm_ps - LASER) < 4.0 * pulse.width.fwhm_std_ps + 0.5
    assert pulse.width.fwhm_std_ps < 2.0
    assert pulse.width.n_pulses > 15
    assert pulse.apparent_fwhm_ps.shape == (path.n_legs,)
    towards = np.sin(np.deg2rad([leg.angle_deg for leg in path.legs]))
    # A leg that comes at the camera looks longer: 1 / (1 - d.u), u nearly the axis here.
    assert pulse.apparent_fwhm_ps == pytest.approx(pulse.width.fwhm_ps / (1.0 - towards), rel=0.25)
