"""
What do two cameras buy?
========================

The same flight, seen from the front alone and from a second place as well, with nothing known of
the source's place and time. Both clocks count from the same trigger.
"""

import matplotlib.pyplot as plt
import numpy as np

import lightflight as lf
from lightflight import view
from lightflight.simulate import ideal, paper_scene

front = paper_scene(ideal(), source=lf.Source(pulse_fwhm_ps=68.0))
second = view.camera_towards(front, (560.0, 260.0, 420.0))
side = paper_scene(ideal(), source=front.source, camera=second)
recordings = [lf.simulate(scene, photons_per_pixel=10_000, seed=3) for scene in (front, side)]
clock = lf.TimingCalibration.nominal(recordings[0])  # codes of this twin are equal

paths = {
    "one camera": lf.reconstruct(
        recordings[0], camera=front.camera, source=front.source, timing=clock
    ),
    "two cameras": lf.reconstruct(
        recordings, camera=[front.camera, second], source=front.source, timing=[clock, clock]
    ),
}
with view.figure_style():
    figure, ax = plt.subplots(figsize=(6.0, 3.2), layout="constrained")
    for name, path in paths.items():
        error = lf.path_error(path, recordings[0].truth, front.camera).position_rms_mm
        print(f"{name}: {error:.2f} mm off; {path.verdict.headline}")
        some = path.sample(200)
        std = np.sqrt(some["x_std_mm"] ** 2 + some["y_std_mm"] ** 2 + some["z_std_mm"] ** 2)
        ax.semilogy(some["event_time_ps"], std, label=f"{name}: {error:.2f} mm off")
    ax.set(xlabel="event time (ps)", ylabel="error bar of the place (mm)")
    ax.legend()

# %%
# **Answer:** depth. One camera alone, with nothing known of the source, infers it from the way
# the apparent speed changes along each leg; a second line of sight measures it.
#
# More: :doc:`plan an experiment </how-to/plan>` says beforehand which second place is worth the
# trouble.
