"""Width of the laser by deconvolution, and how long its pulse looks."""

import numpy as np
import pytest

from lightflight.errors import NothingFoundError, SuspectDataWarning
from lightflight.flight import Medium
from lightflight.recording.histograms import Histograms
from lightflight.timing.laser_width import apparent_fwhm_ps, laser_width_from_pulses
from lightflight.timing.pulses.arrivals import arrivals_from_pulses
from lightflight.timing.pulses.pulses import fit_pulses
from lightflight.units import fwhm_from_std, std_from_fwhm
from tests.pulse_fakes import WIDTH, pulse_cube


@pytest.mark.parametrize(("laser", "transit"), [(68.0, 0.0), (68.0, 40.0), (20.0, 0.0)])
def test_the_laser_s_width_comes_back_within_its_error(rng, laser, transit):
    """400 pixels of 10,000 photons, response 150 ps: 68 ps are known to 0.14 ps."""
    std = np.sqrt(std_from_fwhm(laser) ** 2 + std_from_fwhm(150.0) ** 2 + transit**2)
    hist = pulse_cube(rng, 400, [(rng.uniform(0, 900 * WIDTH, 400), 10_000)], 0.5, std=std)
    pulses = fit_pulses(hist, max_pulses=1)
    found = laser_width_from_pulses(pulses, response_fwhm_ps=150.0, transit_std_ps=transit)
    assert abs(found.fwhm_ps - laser) < 4.0 * found.fwhm_std_ps
    # Of N photons a width w is known to w / sqrt(2 N); background and codes add a little.
    recorded = fwhm_from_std(std)
    if laser > 50:
        least = recorded**2 / laser / np.sqrt(2.0 * 400 * 10_000)
        assert found.fwhm_std_ps == pytest.approx(1.05 * least, rel=0.1)
    assert found.fwhm_std_ps < 2.0
    assert found.n_pulses == 400
    same = laser_width_from_pulses(
        arrivals_from_pulses(pulses, timing=None), response_fwhm_ps=150.0, transit_std_ps=transit
    )
    assert same == found
    vague = laser_width_from_pulses(
        pulses, response_fwhm_ps=150.0, response_fwhm_std_ps=3.0, transit_std_ps=transit
    )
    # d(laser) = response / laser * d(response)
    expected = np.hypot(150.0 / laser * 3.0, found.fwhm_std_ps) if laser > 50 else 20.0
    assert vague.fwhm_std_ps == pytest.approx(expected, rel=0.1 if laser > 50 else 0.6)


def test_a_pulse_narrower_than_the_response_has_no_width(rng):
    hist = pulse_cube(rng, 20, [(5000.0, 3000)], 0.5, std=50.0)
    with pytest.warns(SuspectDataWarning, match=r"narrower than the camera's response of 150 ps"):
        found = laser_width_from_pulses(fit_pulses(hist), response_fwhm_ps=150.0)
    assert found.fwhm_ps == 0.0
    assert np.isfinite(found.fwhm_std_ps)
    dark = fit_pulses(Histograms(rng.poisson(1.0, (1, 5, 64)), bin_width_ps=WIDTH))
    with pytest.raises(NothingFoundError, match="no usable pulse"):
        laser_width_from_pulses(dark, response_fwhm_ps=150.0)
    with pytest.raises(ValueError, match="response_fwhm_ps"):
        laser_width_from_pulses(dark, response_fwhm_ps=-1.0)


@pytest.mark.parametrize(("angle_deg", "fwhm_ps"), [(-10.0, 57.9), (0.0, 68.0), (10.0, 82.3)])
def test_apparent_length_of_the_paper_s_pulse(angle_deg, fwhm_ps):
    angle = np.deg2rad(angle_deg)
    direction = [np.cos(angle), 0.0, np.sin(angle)]
    air = apparent_fwhm_ps(68.0, direction, [0.0, 0.0, 1.0])
    assert air == pytest.approx(fwhm_ps, abs=0.1)
    # the light of head and tail, followed by hand: they arrive together
    late = fwhm_ps * (1.0 - np.sin(angle))
    assert late == pytest.approx(68.0, rel=2e-3)
    fibre = Medium(path_group_index=1.47, return_group_index=1.0)
    glass = apparent_fwhm_ps(68.0, direction, [0.0, 0.0, 1.0], medium=fibre)
    assert glass == pytest.approx(68.0 / (1.0 - np.sin(angle) / 1.47), rel=1e-9)
