"""Timing: from histograms to arrival times on one calibrated clock.

- `clock`: the calibrated clock as a record, with its code edges and response shapes
- `pulses`: where the light pulse stands in each pixel, and arrivals on the clock
- `calibrate`: what makes a clock, from code density and flats
- `flat_geometry`, `drift`, `laser_width`: flats seen from near by, clocks that age, the laser
"""
