"""
What do my errors depend on?
============================

Every error bar says what it is made of: photons, the calibration of single pixels, and what all
share (camera, source, clock, air). Here the camera's place, direction and field of view are
known ever better.
"""

import matplotlib.pyplot as plt
import numpy as np

import lightflight as lf
from lightflight import view
from lightflight.simulate import ideal, paper_scene

scene = paper_scene(ideal())
hist = lf.simulate(scene, photons_per_pixel=3_000, seed=2)
timing = lf.TimingCalibration.nominal(hist)  # codes of this twin are equal
rulers = {
    "tape measure": (3.0, 1.0, 5.0),  # place (mm), direction (deg), field of view (mm)
    "ruler": (1.0, 0.1, 2.0),
    "calibration": (0.2, 0.02, 0.2),
}
with view.figure_style():
    figure, axes = plt.subplots(1, 3, figsize=(7.2, 3.0), layout="constrained", sharey=True)
    for ax, (name, (place, turn, field)) in zip(axes, rulers.items(), strict=True):
        camera = lf.Camera.facing_plane(
            center_mm=(187.5, 37.5),
            position_std_mm=place,
            rotation_std_deg=turn,
            field_of_view_std_mm=field,
        )
        path = lf.reconstruct(hist, camera=camera, source=scene.source, timing=timing)
        corners = np.arange(1, len(path.vertices_mm))
        for k, (part, covariance) in enumerate(path.covariance_parts.items()):
            xyz = covariance.diagonal().reshape(-1, 4)[1:, :3].sum(axis=1)
            ax.plot(corners + 0.1 * (k - 1), np.sqrt(xyz), "os^"[k], label=part)
        print(f"{name}: {'; '.join(path.prices)}")
        ax.set(title=name, xlabel="corner", yscale="log", xticks=corners)
    axes[0].set_ylabel("error of the place (mm)")
    axes[-1].legend()

# %%
# **Answer:** on the highest mark. Where "shared" is, no light helps: measure where the camera
# stands. Where "photon" is, record longer; where "pixel" is, calibrate brighter (the clock of
# this twin has no errors). The lines above say what was told as exact, and what each mm of it
# would move.
#
# More: :doc:`read the error bars </how-to/read-errors>`.
