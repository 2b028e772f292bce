"""
How fast does the pulse seem to go?
===================================

A camera sees where the pulse was when the light left that is arriving now. What it sees moves at
c / (n - n d·u), with d the direction of flight and u the direction to the camera. Here a pulse
crosses the view at five elevations α, on straight lines that rise towards the camera or fall
away from it.
"""

import matplotlib.pyplot as plt
import numpy as np

from lightflight import view
from lightflight.flight import Medium, apparent_speed_from_direction
from lightflight.units import SPEED_OF_LIGHT_MM_PER_PS

camera_mm = np.array([0.0, 0.0, 535.0])
along_mm = np.linspace(-400.0, 400.0, 401)

with view.figure_style():
    figure, ax = plt.subplots(figsize=(6.0, 3.6), layout="constrained")
    for alpha_deg in (-10.0, -5.0, 0.0, 5.0, 10.0):
        alpha = np.deg2rad(alpha_deg)
        direction = np.array([np.cos(alpha), 0.0, np.sin(alpha)])
        points_mm = along_mm[:, np.newaxis] * direction
        to_camera = camera_mm - points_mm
        to_camera /= np.linalg.norm(to_camera, axis=1, keepdims=True)
        speed = apparent_speed_from_direction(direction, to_camera, medium=Medium(1.0, 1.0))
        in_c = speed / SPEED_OF_LIGHT_MM_PER_PS
        ax.plot(along_mm, in_c, label=f"α = {alpha_deg:+.0f}°")
        print(f"α = {alpha_deg:+3.0f}°: {in_c[0]:.2f} c, {in_c[200]:.2f} c, {in_c[-1]:.2f} c")
    ax.axhline(1.0, color="0.4", lw=0.8, ls="--")
    ax.annotate("the speed of light", (395, 1.03), ha="right", color="0.3")
    ax.set(xlabel="place along the line (mm), camera above 0", ylabel="apparent speed (c)")
    ax.legend(title="elevation")

# %%
# **Answer:** faster than light while it comes nearer, slower while it goes away; c only where
# the line of sight is square to the flight. The change along a line tells α: that is how one
# camera sees depth.
#
# More: :doc:`why the apparent speed is not c </explanation/apparent-speed>`, and the
# :doc:`observer studio </observer>` to try it by hand.
