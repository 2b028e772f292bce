"""Truth: what made a simulated recording, carried along with it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lightflight.simulate.detector import Detector

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Truth:
    """Everything a test may want to know of a simulated recording."""

    kind: str
    """What was simulated: "histograms", "frames", "events", "code_density", "flat", "dark"."""

    seed: int
    """Seed of the recording."""

    vertices_mm: Floats
    """(m, 3), source, mirrors, end; world, mm."""

    vertex_times_ps: Floats
    """(m,), event time at each vertex, ps."""

    expected_counts: Floats
    """(rows, cols), expected signal counts: caught directly (no crosstalk), before any is lost to
    an earlier photon of the frame. Zero where the recording holds no signal."""

    expected_leg_counts: Floats
    """(legs, rows, cols), the same by leg."""

    mean_arrival_ps: Floats
    """(legs, rows, cols), signal-weighted mean arrival time at the entrance pupil, ps; without
    pixel delay and response; NaN where a leg sends no light."""

    background_counts: Floats
    """(rows, cols), expected counts that come at any time alike: background light, dark counts
    and their crosstalk, before any is lost."""

    skew_ps: Floats
    """(rows, cols), the pixels' own delays, ps."""

    gain: Floats
    """(rows, cols), width of the pixel's plateau code over `detector.true_code_width_ps`."""

    phases: Floats
    """(rows, cols, n_phases), relative widths of the codes modulo n_phases."""

    screaming: NDArray[np.bool_]
    """(rows, cols), True for screaming pixels."""

    pulse_std_ps: float
    """Standard deviation of laser pulse, trigger jitter and Gaussian response together, ps."""

    response_mean_ps: float
    """Mean lateness by the response's tail, ps; the flat recording has it as well."""

    detector: Detector
    """The detector; its clock's true edges: `detector.true_code_intervals_ps(shape)`."""

    flat_arrival_ps: Floats | None = None
    """() or (rows, cols), when the flat pulse reached the pixels, ps; None for other kinds."""

    @property
    def emission_time_ps(self) -> float:
        """True time at which the pulse left the first vertex, ps."""
        return float(self.vertex_times_ps[0])

    @property
    def shape(self) -> tuple[int, int]:
        """(rows, cols)."""
        return self.skew_ps.shape[0], self.skew_ps.shape[1]

    def code_intervals_ps(self) -> tuple[Floats, Floats]:
        """True delay interval of every code: (lower, upper), each (rows, cols, codes), ps."""
        return self.detector.true_code_intervals_ps(self.shape)
