"""What every path has, and what its tables and its goodness of fit hold."""

from __future__ import annotations

from dataclasses import dataclass, field
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
        Sum of squared residuals of the pulses used, each over its stated error: misfit shows here.
    dof : int
        Degrees of freedom of `chi2`.
    n_pulses : int
        Pulses (or, for `photon`, pixels) that took part.
    n_rejected : int
        Pulses on the path that were left out as outliers.
    residual_rms_ps : float
        Root mean square of the arrival-time residuals used, ps.
    error_floor_ps : float
        Extra error per pulse, ps, that the residuals ask for beyond the stated ones (0: none):
        misfit, which the path's errors include and `chi2` does not.
    converged : bool
        False: the fit stopped before its tolerance; do not trust the errors.
    chi2_with_floor : float or None
        The same sum with the error floor among the errors, near `dof` whatever the misfit. None:
        of a file from before both were told; where there is a floor, `chi2` then includes it.
    """

    chi2: float
    dof: int
    n_pulses: int
    n_rejected: int
    residual_rms_ps: float
    error_floor_ps: float
    converged: bool
    chi2_with_floor: float | None = field(default=None, kw_only=True)

    @property
    def reduced_chi2(self) -> float:
        """chi2 / dof; NaN without degrees of freedom."""
        return self.chi2 / self.dof if self.dof > 0 else float("nan")

    @property
    def floor_share(self) -> float:
        """Share of `chi2` that the error floor takes, 0 to 1; NaN where an older file hides it."""
        if not self.error_floor_ps > 0:
            return 0.0
        if self.chi2_with_floor is None or not self.chi2 > 0:
            return float("nan")
        return 1.0 - self.chi2_with_floor / self.chi2

    @property
    def chi2_in_words(self) -> str:
        """chi2 and its degrees of freedom, and whether an older file hides misfit in it."""
        if not self.dof > 0:
            return "–"
        hidden = self.error_floor_ps > 0 and self.chi2_with_floor is None
        return f"{self.chi2:,.1f} / {self.dof:,}" + (", extra scatter included" if hidden else "")

    @property
    def floor_in_words(self) -> str:
        """What the error floor takes, as the misfit that it is; empty without one."""
        if not self.error_floor_ps > 0:
            return ""
        share = self.floor_share
        takes = f", it takes {100 * share:.0f} % of chi2" if share >= 0 else ""
        return f"{self.error_floor_ps:.2g} ps beyond the stated errors{takes}: misfit"


@dataclass(frozen=True)
class Explained:
    """How much of what was found in the recordings lies on the path.

    Attributes
    ----------
    n_pulses : int
        Pulses that the path explains.
    n_found : int
        Usable pulses in all recordings.
    photons : float
        Photons of the pulses that it explains.
    photons_found : float
        Photons of all usable pulses.
    """

    n_pulses: int
    n_found: int
    photons: float
    photons_found: float

    def __str__(self) -> str:
        if not self.n_found:
            return "no pulse was found"
        share = 100 * self.photons / self.photons_found if self.photons_found > 0 else 0.0
        return f"{self.n_pulses:,} of {self.n_found:,} pulses, {share:.0f} % of their photons"
