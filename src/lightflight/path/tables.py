"""What every path has, and what its tables and its goodness of fit hold."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike


class Polyline(Protocol):
    """A `LightPath`, or a truth: anything that says where a pulse was and when."""

    @property
    def vertices_mm(self) -> ArrayLike:
        """(m, 3), world, mm."""

    @property
    def vertex_times_ps(self) -> ArrayLike:
        """(m,), event times, ps."""


RESIDUAL_DTYPE = np.dtype(
    [
        ("row", np.int32),
        ("col", np.int32),
        ("leg", np.int32),
        ("arrival_ps", np.float64),
        ("model_ps", np.float64),
        ("residual_ps", np.float64),
        ("std_ps", np.float64),
        ("event_time_ps", np.float64),
        ("photons", np.float64),
        ("used", np.bool_),
        ("flags", np.uint32),
    ]
)
"""One row per pulse: what was measured, what the path says, and whether it took part."""

SAMPLE_DTYPE = np.dtype(
    [
        ("leg", np.int32),
        ("x_mm", np.float64),
        ("y_mm", np.float64),
        ("z_mm", np.float64),
        ("event_time_ps", np.float64),
        ("arrival_time_ps", np.float64),
        ("x_std_mm", np.float64),
        ("y_std_mm", np.float64),
        ("z_std_mm", np.float64),
        ("event_time_std_ps", np.float64),
        ("in_view", np.bool_),
    ]
)
"""One row per point along a path."""


@dataclass(frozen=True)
class Goodness:
    """How well the path explains the recording.

    Attributes
    ----------
    chi2 : float
        Sum of squared, weighted residuals of the pulses used.
    dof : int
        Degrees of freedom of `chi2`.
    n_pulses : int
        Pulses (or, for `photon`, pixels) that took part.
    n_rejected : int
        Pulses on the path that were left out as outliers.
    residual_rms_ps : float
        Root mean square of the arrival-time residuals used, ps.
    error_floor_ps : float
        Extra error per pulse, ps, that the residuals ask for beyond the stated ones (0: none).
    converged : bool
        False: the fit stopped before its tolerance; do not trust the errors.
    """

    chi2: float
    dof: int
    n_pulses: int
    n_rejected: int
    residual_rms_ps: float
    error_floor_ps: float
    converged: bool

    @property
    def reduced_chi2(self) -> float:
        """chi2 / dof; NaN without degrees of freedom."""
        return self.chi2 / self.dof if self.dof > 0 else float("nan")
