"""
How good can it get?
====================

No estimator can do better than the Cramér-Rao bound of the photons; how good that is depends on
what is known before. The paper's three legs, 40,000 photons in the brightest pixel, camera and
clock exact.
"""

import matplotlib.pyplot as plt

import lightflight as lf
from lightflight import view
from lightflight.simulate import paper_scene

scene = paper_scene()
start = (0.0, 0.0, 0.0)
known = {
    "source and emission time": {"source": lf.Source(start, emission_time_ps=2000.0)},
    "source": {"source": lf.Source(start)},
    "source to 1 mm": {"source": lf.Source(start, position_std_mm=1.0)},
    "first mirror to 0.5 mm": {
        "source": lf.Source(),
        "waypoints": ((1, (375.0, 25.0, 50.0), 0.5),),
    },
    "nothing": {"source": lf.Source()},
}
limits = {name: lf.bounds(scene, **told).position_rms_mm for name, told in known.items()}

with view.figure_style():
    figure, ax = plt.subplots(figsize=(6.0, 2.8), layout="constrained")
    bars = ax.barh(list(limits), list(limits.values()), height=0.6)
    ax.bar_label(bars, fmt=" %.2f mm")
    ax.set(xscale="log", xlabel="best position error in view, rms (mm)", title="What is known")
    ax.set_xlim(0.03, 10.0)
    ax.invert_yaxis()

# %%
# **Answer:** the bars say it. Where the source's place is known, not knowing the emission time
# costs next to nothing. With nothing known the limit is a class worse, and one corner measured
# with a ruler mends most of that.
#
# More: :doc:`the trigger delay is not known </how-to/trigger-delay>`.
