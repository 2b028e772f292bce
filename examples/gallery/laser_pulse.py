"""
How long was the laser's pulse?
===============================

A recorded pulse is wider than the laser's: the camera's response (150 ps here) and the flight
through what a pixel sees add to it. `laser_pulse` takes both off.
"""

import matplotlib.pyplot as plt

import lightflight as lf
from lightflight import view
from lightflight.simulate import angle_scene, ideal

start = (-65.0, 0.0, 0.0)
with view.figure_style():
    figure, ax = plt.subplots(figsize=(5.0, 3.6), layout="constrained")
    for seed, true_ps in enumerate((20.0, 40.0, 68.0, 110.0)):
        scene = angle_scene(5.0, ideal(), source=lf.Source(start, pulse_fwhm_ps=true_ps))
        hist = lf.simulate(scene, photons_per_pixel=20_000, seed=seed)
        timing = lf.TimingCalibration.nominal(hist)  # codes of this twin are equal
        path = lf.reconstruct(hist, camera=scene.camera, source=lf.Source(start), timing=timing)
        width = lf.laser_pulse(path, hist, timing=timing, response_fwhm_ps=150.0).width
        print(f"{true_ps:g} ps: {width.fwhm_ps:.2f} ± {width.fwhm_std_ps:.2f} ps")
        ax.errorbar(true_ps, width.fwhm_ps, width.fwhm_std_ps, fmt="o", color="k", ms=3)
        ax.plot(true_ps, width.recorded_fwhm_ps, "x", color="0.5", ms=4)
    ax.plot([0, 120], [0, 120], lw=0.8, ls="--", color="0.5")
    ax.set(xlabel="true width (ps)", ylabel="recorded (x), and the laser's own (dots), ps")

# %%
# **Answer:** `lf.laser_pulse`, given the width of the response alone. The shorter the pulse, the
# less is left of it after the response is taken off, and the larger its error.
#
# More: :doc:`choose an estimator </how-to/choose-estimator>`.
