"""
What happens with haze, and does the verdict say so?
====================================================

Haze sends light on a detour: it arrives late. Here a tenth and then half of the light on the
path is made late by 600 ps on average; then the path is asked for, and the verdict.
"""

import warnings

import matplotlib.pyplot as plt
import numpy as np

import lightflight as lf
from lightflight import view
from lightflight.simulate import ideal, paper_scene

warnings.simplefilter("ignore")  # what they say stands in the verdict
scene = paper_scene(ideal())
clear = lf.simulate(scene, photons_per_pixel=20_000, seed=8)
timing = lf.TimingCalibration.nominal(clear)  # codes of this twin are equal
rng = np.random.default_rng(8)


def in_haze(hist: lf.Histograms, share: float, late_ps: float = 600.0) -> lf.Histograms:
    """The recording with a share of its photons late by an exponential time."""
    late = rng.binomial(hist.counts.astype(int), share)
    row, col, code = (np.repeat(index, late[late > 0]) for index in np.nonzero(late))
    code = code + np.rint(rng.exponential(late_ps / hist.bin_width_ps, code.size)).astype(int)
    counts = hist.counts.astype(int) - late
    np.add.at(counts, (row, col, code % hist.n_codes), 1)
    return lf.Histograms(
        counts, bin_width_ps=hist.bin_width_ps, laser_period_ps=hist.laser_period_ps
    )


with view.figure_style():
    figure, ax = plt.subplots(figsize=(6.0, 3.6), layout="constrained")
    for share in (0.0, 0.1, 0.5):
        hist = in_haze(clear, share)
        path = lf.reconstruct(hist, camera=scene.camera, source=scene.source, timing=timing)
        error = lf.path_error(path, clear.truth, scene.camera).position_rms_mm
        print(f"haze {share:.0%}: {error:.2f} mm off", *path.verdict.lines[:3], sep="\n  ")
        pulse = np.roll(hist.counts[16, 16], 20 - np.argmax(clear.counts[16, 16]))[:80]
        ax.semilogy(pulse + 0.5, drawstyle="steps-mid", label=f"{share:.0%}: {path.verdict.level}")
    ax.set(xlabel="code (55 ps)", ylabel="counts of the middle pixel")
    ax.legend(title="light in haze")

# %%
# **Answer:** pulses grow a tail. The verdict names the haze and its share; the fit takes it up,
# so that the path moves little, but its error bars are no longer promised. Thin out the haze and
# record again.
#
# More: :doc:`what can go wrong </what-can-go-wrong>`.
