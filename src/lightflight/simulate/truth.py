"""Truth: what made a simulated recording, carried along with it."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from lightflight.display import Shown
from lightflight.simulate.detector import Detector

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False, repr=False)
class Truth(Shown):
    """Everything a test may want to know of a simulated recording.

    Attributes
    ----------
    kind : str
        What was simulated: "histograms", "frames", "events", "code_density", "flat", "dark".
    seed : int
        Seed of the recording.
    vertices_mm : array of float, shape (m, 3)
        Source, mirrors, end; world, mm.
    vertex_times_ps : array of float, shape (m,)
        Event time at each vertex, ps.
    expected_counts : array of float, shape (rows, cols)
        Expected signal counts: caught directly (no crosstalk), before any is lost to an earlier
        photon of the frame. Zero where the recording holds no signal.
    expected_leg_counts : array of float, shape (legs, rows, cols)
        The same by leg.
    mean_arrival_ps : array of float, shape (legs, rows, cols)
        Signal-weighted mean arrival time at the entrance pupil, ps; without pixel delay and
        response; NaN where a leg sends no light.
    background_counts : array of float, shape (rows, cols)
        Expected counts that come at any time alike: background light, dark counts and their
        crosstalk, before any is lost.
    skew_ps : array of float, shape (rows, cols)
        The pixels' own delays, ps.
    gain : array of float, shape (rows, cols)
        Width of the pixel's plateau code over `detector.true_code_width_ps`.
    phases : array of float, shape (rows, cols, n_phases)
        Relative widths of the codes modulo n_phases.
    screaming : array of bool, shape (rows, cols)
        True for screaming pixels.
    pulse_std_ps : float
        Standard deviation of laser pulse, trigger jitter and Gaussian response together, ps.
    response_mean_ps : float
        Mean lateness by the response's tail, ps; the flat recording has it as well.
    detector : Detector
        The detector; its clock's true edges: `detector.true_code_intervals_ps(shape)`.
    flat_arrival_ps : array of float or None
        () or (rows, cols), when the flat pulse reached the pixels, ps; None for other kinds.
    forks : tuple of (int, int)
        Legs that begin at another vertex than the end of the leg before, each (leg, vertex).
    """

    kind: str

    seed: int

    vertices_mm: Floats

    vertex_times_ps: Floats

    expected_counts: Floats

    expected_leg_counts: Floats

    mean_arrival_ps: Floats

    background_counts: Floats

    skew_ps: Floats

    gain: Floats

    phases: Floats

    screaming: NDArray[np.bool_]

    pulse_std_ps: float

    response_mean_ps: float

    detector: Detector

    flat_arrival_ps: Floats | None = None

    forks: tuple[tuple[int, int], ...] = field(default=(), kw_only=True)

    @property
    def emission_time_ps(self) -> float:
        """True time at which the pulse left the first vertex, ps."""
        return float(self.vertex_times_ps[0])

    @property
    def shape(self) -> tuple[int, int]:
        """(rows, cols)."""
        return self.skew_ps.shape[0], self.skew_ps.shape[1]

    def code_intervals_ps(self) -> tuple[Floats, Floats]:
        """True delay interval of every code.

        Returns
        -------
        lower, upper : array of float, shape (rows, cols, codes)
            See `Detector.true_code_intervals_ps`; ps.
        """
        return self.detector.true_code_intervals_ps(self.shape)
