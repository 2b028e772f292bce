"""
How many photons do I need?
===========================

`bounds` says how well any estimator could do with so much light, before anything is recorded;
here for a camera that is known exactly, and for one whose place is known to half a millimetre.
"""

import matplotlib.pyplot as plt
import numpy as np

import lightflight as lf
from lightflight import view
from lightflight.simulate import paper_scene

scene = paper_scene()
cameras = {
    "camera known exactly": scene.camera,
    "camera known to 0.5 mm, 0.05°": lf.Camera.facing_plane(
        center_mm=(187.5, 37.5), position_std_mm=0.5, rotation_std_deg=0.05
    ),
}
photons = np.geomspace(100.0, 1e6, 9)

with view.figure_style():
    figure, ax = plt.subplots(figsize=(6.0, 3.6), layout="constrained")
    for name, camera in cameras.items():
        error = [
            lf.bounds(scene, camera=camera, photons_per_pixel=n).position_rms_mm for n in photons
        ]
        ax.loglog(photons, error, "o-", ms=3, label=name)
        print(f"{name}: {error[0]:.2g} mm at 100 photons, {error[-1]:.2g} mm at a million")
    ax.set(xlabel="photons in the brightest pixel", ylabel="best position error, rms (mm)")
    ax.legend()

wanted = lf.plan(scene, position_rms_mm=0.2, rate_hz=200.0, array_shapes=((32, 32),))
best = wanted.placements[0]
print(f"0.2 mm takes {best.photons_per_pixel:.0f} photons, {best.seconds:.0f} s at 200 per second")

# %%
# **Answer:** four times the photons halve the error, until what the camera's place is known to
# takes over: then a better ruler helps and light does not.
#
# More: :doc:`plan an experiment </how-to/plan>`.
