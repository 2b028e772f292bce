"""
How do I get from a recording to a path?
========================================

Six calls: three recordings, the clock, the camera, the path. The recordings come from the
digital twin here (the paper's experiment, with all the defects of a real camera); with files of
yours, `lf.read` takes the place of `lf.simulate`, and nothing else changes.
"""

import lightflight as lf
from lightflight.simulate import paper_scene

scene = paper_scene()
recording = lf.simulate(scene, photons_per_pixel=40_000, seed=4)
bright = lf.simulate(scene, photons_per_pixel=4e6, seed=2, kind="code_density")
flat = lf.simulate(scene, photons_per_pixel=4e5, seed=3, kind="flat")
print(recording)

# %%
# The clock: even light tells how wide each code is, the laser's own flash how late each pixel
# is.

timing = lf.calibrate_timing(
    bright, flat=flat, flat_arrival_ps=flat.truth.flat_arrival_ps, dead_codes="absorbed"
)

# %%
# The camera, with how well its place is known. The source's place is taken as exact; when the
# pulse left it is not told, so it is fitted.

camera = lf.Camera.facing_plane(
    distance_mm=535.0,
    field_of_view_mm=(245.0, 245.0),
    center_mm=(187.5, 37.5),
    position_std_mm=0.5,
    rotation_std_deg=0.05,
    field_of_view_std_mm=0.1,
)
path = lf.reconstruct(recording, camera=camera, source=scene.source, timing=timing)
print(path)

# %%
# **Answer:** the verdict first, then corner by corner with errors. The twin knows the truth, so
# here we can also see how far off the path is:

error = lf.path_error(path, recording.truth, scene.camera)
print(f"off by {error.position_rms_mm:.3f} mm and {error.event_time_rms_ps:.2f} ps, rms in view")
figure = path.plot()

# %%
# More: :doc:`the tutorial </tutorial/first-path>` does the same with commands and files.
