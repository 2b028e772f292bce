"""What the paper reports, as numbers, beside the two that the demo compares with."""

ARRIVAL_TIME_RMS_PS = 174.80
"""Difference between arrival time and propagation time before the correction (Fig. 6b)."""

MEAN_ANGLE_ERROR_DEG = 0.15
"""Mean error of the propagation angle from 32 arrival times, -10 to 10 degrees (Fig. 5a)."""

ANGLE_ERROR_TWO_TIMES_DEG = 3.03
"""The same from two arrival times (Fig. 5a)."""

BIN_WIDTH_PS = 55.0
"""Time per code of the camera."""

DECONVOLVED_FWHM_PS = 65.0
"""Width of the laser pulse measured on one leg, response taken off (Fig. 5c)."""

DECONVOLVED_FWHM_THREE_LEGS_PS = 70.0
"""The same on three legs, "approximately" (Fig. 6)."""

TRANSVERSE_RESOLUTION_MM = 8.0
"""Transverse resolution of the set-up, one pixel, which the path is better than (Section 5)."""

LONGITUDINAL_RESOLUTION_MM = 16.5
"""Length of 55 ps of light, which the path is better than (Section 5)."""
