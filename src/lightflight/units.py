"""The one unit system: mm, ps, rad (deg by suffix), pixel, counts."""

import math

SPEED_OF_LIGHT_MM_PER_PS = 0.299792458
"""Speed of light in vacuum, mm/ps (exact, SI)."""

AIR_GROUP_INDEX = 1.00027
"""Group index of air at visible wavelengths, room conditions."""

FWHM_PER_STD = 2.0 * math.sqrt(2.0 * math.log(2.0))
"""Full width at half maximum of a Gaussian, in standard deviations."""


def std_from_fwhm(fwhm: float) -> float:
    """Standard deviation of a Gaussian from its full width at half maximum.

    Parameters
    ----------
    fwhm : float
        In any unit.

    Returns
    -------
    float
        In the same unit.

    Examples
    --------
    >>> round(std_from_fwhm(68.0), 3)
    28.877
    """
    return fwhm / FWHM_PER_STD


def fwhm_from_std(std: float) -> float:
    """Full width at half maximum of a Gaussian from its standard deviation.

    Parameters
    ----------
    std : float
        In any unit.

    Returns
    -------
    float
        In the same unit.
    """
    return std * FWHM_PER_STD


STD_PER_MAD = 1.4826
"""Standard deviation of a Gaussian, in median absolute deviations: 1 / 0.6745."""

MEDIAN_CHI2 = 0.4549
"""Median of the square of a unit Gaussian (chi-square of one degree of freedom)."""


def std_from_mad(median_deviation: float) -> float:
    """Standard deviation of a Gaussian from its median absolute deviation (same unit).

    The median is not moved by outliers, so this is the spread that the sound values have.
    """
    return STD_PER_MAD * median_deviation
