"""The one unit system: mm, ps, rad (deg by suffix), pixel, counts."""

import math

SPEED_OF_LIGHT_MM_PER_PS = 0.299792458
"""Speed of light in vacuum, mm/ps (exact, SI)."""

AIR_GROUP_INDEX = 1.00027
"""Group index of air at visible wavelengths, room conditions."""

FWHM_PER_STD = 2.0 * math.sqrt(2.0 * math.log(2.0))
"""Full width at half maximum of a Gaussian, in standard deviations."""


def std_from_fwhm(fwhm: float) -> float:
    """Standard deviation of a Gaussian from its full width at half maximum (same unit)."""
    return fwhm / FWHM_PER_STD


def fwhm_from_std(std: float) -> float:
    """Full width at half maximum of a Gaussian from its standard deviation (same unit)."""
    return std * FWHM_PER_STD
