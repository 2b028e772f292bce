"""
Which estimator?
================

`joint` (the default), `photon` and the paper's own, from starved to bright light: two
recordings at each level by a camera without defects, against the limit that the photons set.
"""

import warnings

import matplotlib.pyplot as plt
import numpy as np

import lightflight as lf
from lightflight import view
from lightflight.errors import NothingFoundError
from lightflight.simulate import angle_scene, ideal

warnings.simplefilter("ignore")  # what they say stands in the verdict
scene = angle_scene(5.0, ideal())
levels, repeats = (6, 60, 600, 6_000), 2
methods = ("paper", "joint", "photon")
squares = {method: np.full((len(levels), repeats), np.nan) for method in methods}
for i, k in np.ndindex(len(levels), repeats):
    hist = lf.simulate(scene, photons_per_pixel=levels[i], seed=k)
    told = {"camera": scene.camera, "source": scene.source, "n_legs": 1}
    told["timing"] = lf.TimingCalibration.nominal(hist)  # codes of this twin are equal
    for method, square in squares.items():
        try:
            path = lf.reconstruct(hist, method=method, **told)
        except NothingFoundError as nothing:
            print(f"{method}, {levels[i]} photons, recording {k}: {str(nothing).partition(':')[0]}")
            continue
        square[i, k] = lf.path_error(path, hist.truth, scene.camera).position_rms_mm ** 2

with view.figure_style():
    figure, ax = plt.subplots(figsize=(6.0, 3.6), layout="constrained")
    limit = [lf.bounds(scene, photons_per_pixel=n).position_rms_mm for n in levels]
    ax.loglog(levels, limit, "k--", lw=0.9, label="limit of the photons")
    for mark, (method, square) in zip("s^o", squares.items(), strict=True):
        ax.loglog(levels, np.sqrt(square.mean(axis=1)), mark, ms=5, mfc="none", label=method)
    ax.set(xlabel="photons in the brightest pixel", ylabel="position in view, rms (mm)")
    ax.legend()

# %%
# **Answer:** `joint`: near the limit wherever it finds a line. `photon` goes on where there are
# too few photons for single pixels, and costs more time. `paper` is there to compare with.
#
# More: :doc:`choose an estimator </how-to/choose-estimator>`.
