"""What pulse fits and reconstructions ask of a clock, whoever answers."""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from lightflight.errors import CalibrationError

if TYPE_CHECKING:
    from lightflight.recording.histograms import Histograms
    from lightflight.timing.clock.calibration import TimingCalibration
    from lightflight.timing.clock.response import Response

Floats = NDArray[np.float64]

_PERIOD_TOLERANCE = 1e-4
"""Relative: a laser's period is known to a few ppm."""
_WIDTH_TOLERANCE = 0.05
"""Relative: a data sheet's width of a code is about right."""


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
    def is_known(self) -> NDArray[np.bool_]:
        """(rows, cols), True where the codes of a pixel have times and it has a delay."""

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

    def shared_errors_ps(
        self, rows: ArrayLike, cols: ArrayLike, delay_ps: ArrayLike
    ) -> tuple[Floats, tuple[str, ...]]:
        """The shared modes and their names, alone."""


def mismatch(name: str, ours: object, theirs: object) -> str:
    """The sentence of a CalibrationError where a clock is not that of a recording."""
    return (
        f"the calibration has {name} = {ours}, the recording {theirs}: "
        "they are not of the same camera and clock setting"
    )


def _agree(ours: float | None, theirs: float | None, tolerance: float) -> bool:
    """Whether two optional values agree within a relative tolerance."""
    if ours is None or theirs is None:
        return ours is theirs
    return abs(ours - theirs) <= tolerance * abs(theirs)


def check_same_clock(clock: TimingCalibration, hist: Histograms) -> None:
    """Raise CalibrationError where a recording is not of a calibration's camera and setting."""
    pairs: list[tuple[str, object, object]] = [
        ("shape", clock.shape, hist.shape),
        ("n_codes", clock.n_codes, hist.n_codes),
        ("reversed_codes", clock.reversed_codes, hist.reversed_codes),
        ("no_photon_code", clock.no_photon_code, hist.no_photon_code),
    ]
    for name, ours, theirs in pairs:
        if ours != theirs:
            raise CalibrationError(mismatch(name, ours, theirs))
    # A nominal clock of unknown code width counts in codes, and has no period in that unit.
    in_codes = clock.laser_period_ps is None and hist.bin_width_ps is None
    if not in_codes and not _agree(clock.laser_period_ps, hist.laser_period_ps, _PERIOD_TOLERANCE):
        raise CalibrationError(
            mismatch("laser_period_ps", clock.laser_period_ps, hist.laser_period_ps)
        )
    # A data sheet is only about right: widths just need to be of the same setting.
    if hist.bin_width_ps is not None and not _agree(
        clock.bin_width_ps, hist.bin_width_ps, _WIDTH_TOLERANCE
    ):
        raise CalibrationError(mismatch("bin_width_ps", clock.bin_width_ps, hist.bin_width_ps))
    if abs(clock.first_edge_ps - hist.first_edge_ps) > _WIDTH_TOLERANCE * clock.bin_width_ps:
        raise CalibrationError(mismatch("first_edge_ps", clock.first_edge_ps, hist.first_edge_ps))
