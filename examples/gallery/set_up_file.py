"""
Is my set-up file right?
========================

Three set-up files for one recording: the right one; one whose field of view was read off with an
error of 3 %; one in which the source stands 20 mm too near the camera. A fit gives a path for
each of them. The verdict says which one to believe.
"""

import tempfile
import warnings
from pathlib import Path

import matplotlib.pyplot as plt

import lightflight as lf
from lightflight import view
from lightflight.lab import lab_from_toml
from lightflight.simulate import ideal, paper_scene

TOML = """
[camera]
distance_mm = 535.0
field_of_view_mm = [{width}, {width}]
center_mm = [187.5, 37.5]
[source]
position_mm = [0.0, 0.0, {depth}]
"""
labs = {
    "right": TOML.format(width=245.0, depth=0.0),
    "field of view 3 % too wide": TOML.format(width=252.4, depth=0.0),
    "source 20 mm too near": TOML.format(width=245.0, depth=20.0),
}
warnings.simplefilter("ignore")  # what they say stands in the verdict
hist = lf.simulate(paper_scene(ideal()), photons_per_pixel=10_000, seed=6)
timing = lf.TimingCalibration.nominal(hist)  # codes of this twin are equal
file = Path(tempfile.mkdtemp()) / "lab.toml"

with view.figure_style():
    figure, axes = plt.subplots(3, 1, figsize=(6.0, 5.4), layout="constrained", sharex=True)
    for ax, (name, text) in zip(axes, labs.items(), strict=True):
        file.write_text(text)
        lab = lab_from_toml(file)
        path = lf.reconstruct(hist, camera=lab.camera, source=lab.source, timing=timing)
        print(name, *path.verdict.lines[:3], sep="\n  ")
        ax.plot(path.residuals["event_time_ps"], path.residuals["residual_ps"], ".", ms=3)
        ax.set(title=f"{name}: {path.verdict.level}", ylabel="residual (ps)")
    axes[-1].set_xlabel("event time (ps)")

# %%
# **Answer:** ask `lightflight check lab.toml recording.h5` before the fit, and read the verdict
# after it: it names the likeliest cause first, with its size. What it cannot see is in
# `path.verdict.blind_to`.
#
# More: :doc:`check a set-up </how-to/check-setup>`, :doc:`what can go wrong
# </what-can-go-wrong>`.
