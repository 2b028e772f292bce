"""Units of work that cost nothing, and results as the real ones give them."""

import numpy as np

from studies.zheng2020.angles import COUNTS_OF_TIMES
from tests.path_fakes import make_path

CALLS: list[object] = []


def squared(*, value, seed):
    CALLS.append(value)
    return {"square": value**2, "seed": seed}


def measure_angle(*, angle_deg, recordings, seed):
    CALLS.append(angle_deg)
    return angle_result(angle_deg, recordings=recordings)


def failing(*, seed):
    raise RuntimeError(f"fails on purpose, seed {seed}")


def interrupted(*, seed):
    CALLS.append("interrupted")
    raise KeyboardInterrupt


def with_path(*, seed):
    CALLS.append("path")
    return {"paths": {"straight": make_path([(0.0, 0.0, 0.0), (100.0, 0.0, 10.0)])}}


def angle_result(angle_deg, *, recordings=2, error_deg=0.1):
    """What `measure_angle` gives, with a known error everywhere."""
    names = ("paper, delays", "paper, codes", "joint", "joint, emission fitted", "photon")
    signs = np.resize([1.0, -0.5], recordings)
    found = {
        name: [angle_deg + error_deg * sign / (k + 1) for sign in signs]
        for k, name in enumerate(names)
    }
    few = [[angle_deg + error_deg * sign * 10 / n for n in COUNTS_OF_TIMES] for sign in signs]
    widths = {
        "pixel_fwhm_ps": 170.0,
        "pixel_deconvolved_ps": 68.0,
        "frame_fwhm_ps": 180.0,
        "frame_deconvolved_ps": 70.0,
    }
    return {
        "angle_deg": angle_deg,
        "recordings": recordings,
        "found_deg": found,
        "few_deg": {"delays": few, "codes": few},
        "bound_deg": {"known": 0.01, "fitted": 0.02},
        "widths": [widths] * recordings,
        "clocks": {"arrival_ps": [2300.0, 2600.0, 3000.0], "event_time_ps": [300.0, 600.0, 950.0]},
    }
