"""The paper's first experiment (Section 4A): one leg, -10 to 10 degrees, 20 recordings at each.

Figures 5(a), 5(b) and 5(c) are three readings of these recordings; `measure_angle` makes them for
one angle, and `fig5a`, `fig5b`, `fig5c` turn the results into what the figures show.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from lightflight.demo import known_source
from lightflight.path.light_path import LightPath
from lightflight.reconstruct.limits.bounds import bounds
from lightflight.simulate.presets import angle_scene
from studies.zheng2020.laboratory import (
    CLOCKS,
    angles_of_first_leg,
    calibrated_clock,
    chain_of_recording,
    path_of_recording,
    recorded,
)
from studies.zheng2020.pulse_width import widths_of_recording

Floats = NDArray[np.float64]

COUNTS_OF_TIMES = (2, 3, 4, 6, 8, 12, 16, 20, 24, 28, 32)
"""How many arrival times the angle is taken from (Fig. 5a)."""

ANGLES_DEG = tuple(float(a) for a in np.arange(-10.0, 10.25, 0.5))
"""The paper's 41 angles."""

RECORDINGS = 20
"""The paper's recordings per angle."""

QUICK_ANGLES_DEG = (-10.0, -4.0, 0.0, 4.0, 10.0)
QUICK_RECORDINGS = 2


def measure_angle(*, angle_deg: float, recordings: int, seed: int) -> dict[str, Any]:
    """Record one angle several times, and estimate it every way there is.

    Returns
    -------
    dict of plain numbers and lists: angles in deg by estimator and recording; alpha_i means by
    number of arrival times; bounds; pulse widths; and the two clocks of the first recording.
    """
    scene = angle_scene(angle_deg)
    clocks = {kind: calibrated_clock(kind, seed=seed) for kind in CLOCKS}
    found: dict[str, list[float]] = {}
    few: dict[str, list[list[float]]] = {}
    widths, clock_readings = [], {}
    for run in range(recordings):
        hist = recorded(scene, seed=recording_seed(seed, angle_deg, run))
        for kind in CLOCKS:
            chain = chain_of_recording(hist, scene, clocks[kind])
            found.setdefault(f"paper, {kind}", []).append(chain.path.legs[0].angle_deg)
            alphas = angles_of_first_leg(chain)
            few.setdefault(kind, []).append([_mean_of_first(alphas, n) for n in COUNTS_OF_TIMES])
        path = None
        for name, method, known in (
            ("joint", "joint", True),
            ("joint, emission fitted", "joint", False),
            ("photon", "photon", True),
        ):
            path = path_of_recording(
                hist, scene, clocks["codes"], method, emission_known=known, n_legs=1
            )
            found.setdefault(name, []).append(path.legs[0].angle_deg)
        assert path is not None
        widths.append(widths_of_recording(chain.sighting, path, scene))
        if run == 0:
            clock_readings = _clock_readings(chain.path)
    return {
        "angle_deg": angle_deg,
        "recordings": recordings,
        "found_deg": found,
        "few_deg": few,
        "bound_deg": {
            prior: float(
                bounds(
                    scene, source=known_source(scene, emission_known=prior == "known")
                ).angle_std_deg[0]
            )
            for prior in ("known", "fitted")
        },
        "widths": widths,
        "clocks": clock_readings,
    }


def recording_seed(seed: int, angle_deg: float, run: int) -> int:
    """Seed of one recording; each angle and run has photons of its own."""
    return 1_000_000 * (seed + 1) + 1000 * round(2 * angle_deg + 400) + run


def _mean_of_first(alphas: Floats, n: int) -> float:
    """Mean of the first n alpha_i in the order of flight, deg."""
    first = alphas[:n]
    return float(np.mean(first[np.isfinite(first)])) if np.isfinite(first).any() else float("nan")


def _clock_readings(path: LightPath) -> dict[str, list[float]]:
    """Arrival times and, by the paper's chain, event times along the leg, ps from the emission."""
    table = path.residuals
    start = float(path.vertex_times_ps[0])
    return {
        "arrival_ps": [float(v) - start for v in table["arrival_ps"]],
        "event_time_ps": [float(v) - start for v in table["event_time_ps"]],
    }
