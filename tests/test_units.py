"""Units: the constants are the ones of the SI and of a Gaussian."""

import math

import pytest
from scipy.special import ndtr

from lightflight import units


def test_speed_of_light_is_the_si_value():
    mm_per_s = 299_792_458 * 1000
    ps_per_s = 10**12
    assert units.SPEED_OF_LIGHT_MM_PER_PS * ps_per_s == pytest.approx(mm_per_s, rel=1e-15)


def test_full_width_is_where_a_gaussian_has_half_its_height():
    half = units.FWHM_PER_STD / 2
    assert math.exp(-0.5 * half**2) == pytest.approx(0.5, rel=1e-14)
    # The same number from the other side: 76.1 % of a Gaussian lies within its full width.
    assert ndtr(half) - ndtr(-half) == pytest.approx(0.7609681, abs=1e-7)


def test_widths_go_back_and_forth():
    assert units.std_from_fwhm(235.4820045) == pytest.approx(100.0, rel=1e-9)
    assert units.fwhm_from_std(units.std_from_fwhm(68.0)) == pytest.approx(68.0, rel=1e-15)
