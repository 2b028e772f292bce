"""
How do I read a NumPy cube?
===========================

Any array of counts will do. Nothing about it is guessed: `axes` says which axis is which, and
the clock is told in picoseconds.
"""

import tempfile
from pathlib import Path

import numpy as np

import lightflight as lf
from lightflight.simulate import ideal, paper_scene

# A cube as a camera's own software may write it: time first.
cube = lf.simulate(paper_scene(ideal()), photons_per_pixel=5_000, seed=1).counts
file = Path(tempfile.mkdtemp()) / "mine.npy"
np.save(file, np.moveaxis(cube, -1, 0))

# %%
# `t` is the axis of codes, `y` that of rows (the first is the top one), `x` that of columns.

hist = lf.read(file, axes="tyx", bin_width_ps=55.0, laser_period_ps=50_000.0)
print(hist)

# %%
# **Answer:** `lf.read` with `axes`; in memory, `lf.Histograms(cube, bin_width_ps=55.0, ...)`
# with rows, columns, codes. Then look at it before anything is fitted: was there light, and at
# which codes?

figure = hist.plot()

# %%
# More: :doc:`from a NumPy cube to a path </how-to/from-numpy>`, :doc:`read my files
# </how-to/read-files>`.
