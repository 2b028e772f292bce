"""
Where does light outrun light?
==============================

The same flight, four places of the camera. Where the pulse comes nearer to the camera, its
picture outruns light; where it goes away, its picture lags. The border lies where the line of
sight meets the path squarely, and moves with the camera.
"""

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.colors import TwoSlopeNorm

from lightflight import view
from lightflight.flight import apparent_speed_from_direction
from lightflight.units import SPEED_OF_LIGHT_MM_PER_PS

leg_mm = np.linspace((-250.0, 0.0), (250.0, 60.0), 600)  # x, z of the pulse
direction = (leg_mm[-1] - leg_mm[0]) / np.linalg.norm(leg_mm[-1] - leg_mm[0])
cameras_mm = {"left": (-350, 420), "middle": (0, 535), "right": (350, 420), "ahead": (700, 150)}

with view.figure_style():
    figure, axes = plt.subplots(2, 2, figsize=(7.0, 4.6), layout="constrained", sharex=True)
    for ax, (name, place) in zip(axes.flat, cameras_mm.items(), strict=True):
        to_camera = np.array(place) - leg_mm
        to_camera /= np.linalg.norm(to_camera, axis=1, keepdims=True)
        in_c = apparent_speed_from_direction(direction, to_camera) / SPEED_OF_LIGHT_MM_PER_PS
        drawn = ax.scatter(*leg_mm.T, c=in_c, s=9, cmap="RdBu_r", norm=TwoSlopeNorm(1.0, 0.4, 3.0))
        ax.plot(*place, "s", color="k", ms=6)
        faster = np.mean(in_c > 1.0)
        ax.set(title=f"camera {name}: faster on {faster:.0%}", aspect="equal", xlim=(-400, 750))
        ax.set(ylim=(-60, 600), ylabel="towards the camera (mm)")
        border = np.flatnonzero(np.diff(np.sign(in_c - 1.0)))
        for k in border:
            ax.plot(*np.stack((leg_mm[k], place)).T, color="k", lw=0.7, ls=":")
        print(f"{name}: from {in_c[0]:.2f} c to {in_c[-1]:.2f} c")
    figure.colorbar(drawn, ax=axes, label="apparent speed (c)", shrink=0.8)

# %%
# **Answer:** before the foot of the perpendicular from the camera (dotted). A camera ahead of
# the pulse sees all of it come nearer, and all of it outrun light.
#
# More: move the camera yourself in the :doc:`observer studio </observer>`.
