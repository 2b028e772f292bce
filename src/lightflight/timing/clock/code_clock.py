"""What pulse fits and reconstructions ask of a clock, whoever answers."""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

if TYPE_CHECKING:
    from lightflight.recording.histograms import Histograms
    from lightflight.timing.clock.response import Response

Floats = NDArray[np.float64]


class CodeClock(Protocol):
    """A calibrated clock: the codes of some pixels in ps, their delays, and the errors of both.

    A `TimingCalibration` is one of a whole camera, a `TimingWindow` of `batch` one of some rows
    and codes of it. What each property is, `TimingCalibration` says.
    """

    @property
    def shape(self) -> tuple[int, int]:
        """(rows, cols) of the pixels that the clock answers for."""

    @property
    def laser_period_ps(self) -> float | None:
        """Period of the laser, ps; None: one sweep."""

    @property
    def bin_width_ps(self) -> float:
        """Mean width of a plateau code, ps."""

    @property
    def phases(self) -> Floats:
        """(rows, cols, n_phases), relative widths of the codes modulo n_phases."""

    @property
    def skew_ps(self) -> Floats:
        """(rows, cols), delay of each pixel, ps."""

    @property
    def flags(self) -> NDArray[np.uint32]:
        """(rows, cols), see `lightflight.flags`."""

    @property
    def response(self) -> Response | None:
        """Shape that pulses on this clock are fitted with; None: a Gaussian."""

    def check_matches(self, hist: Histograms) -> None:
        """Raise CalibrationError where the clock is not that of the recording."""

    def code_intervals_ps(self, rows: ArrayLike, cols: ArrayLike) -> tuple[Floats, Floats]:
        """Delays that each code of the pixels covers: (lower, upper), each (n, codes), ps."""

    def arrival_errors_ps(
        self, rows: ArrayLike, cols: ArrayLike, delay_ps: ArrayLike
    ) -> tuple[Floats, Floats, tuple[str, ...]]:
        """Errors left on arrival times: per pixel (n,), shared modes (n, k), ps; their names."""


def mismatch(name: str, ours: object, theirs: object) -> str:
    """The sentence of a CalibrationError where a clock is not that of a recording."""
    return (
        f"the calibration has {name} = {ours}, the recording {theirs}: "
        "they are not of the same camera and clock setting"
    )


def agree(ours: float | None, theirs: float | None, tolerance: float) -> bool:
    """Whether two optional values agree within a relative tolerance."""
    if ours is None or theirs is None:
        return ours is theirs
    return abs(ours - theirs) <= tolerance * abs(theirs)
