"""A calibrated clock seen through a window: some rows of the camera, some of its codes."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from lightflight.errors import CalibrationError
from lightflight.timing.clock.code_clock import ClockView, mismatch

if TYPE_CHECKING:
    from lightflight.recording.histograms import Histograms
    from lightflight.timing.clock.calibration import TimingCalibration

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class TimingWindow(ClockView):
    """The clock of some rows and codes of a camera: a `CodeClock`, as its calibration is.

    Nothing is copied: pictures of the pixels are views of the calibration's rows. A calibration
    of the codes alone would not do, since its edges are counted from the end of the period, by
    codes that may lie outside the window.

    Attributes
    ----------
    timing : TimingCalibration
        The clock of the whole camera.
    rows : (int, int)
        First row of the window, and the one after its last.
    codes : (int, int)
        First code of the window, and the one after its last.
    """

    timing: TimingCalibration
    rows: tuple[int, int]
    codes: tuple[int, int]

    @classmethod
    def of(
        cls,
        timing: TimingCalibration,
        *,
        rows: tuple[int, int] | None = None,
        codes: tuple[int, int] | None = None,
    ) -> TimingWindow:
        """Clock of rows start ... end - 1 and of the codes that are kept.

        Parameters
        ----------
        timing : TimingCalibration
            The clock of the whole camera.
        rows, codes : (int, int), optional
            First, and the one after the last; all unless given.

        Returns
        -------
        TimingWindow
            A view of `timing`.

        Raises
        ------
        CalibrationError
            Where the window reaches beyond the calibration.
        """
        rows = (0, timing.shape[0]) if rows is None else rows
        codes = (0, timing.n_codes) if codes is None else codes
        if rows[1] > timing.shape[0] or codes[1] > timing.n_codes:
            raise CalibrationError(
                f"rows {rows} and codes {codes} reach beyond the calibration, which has "
                f"{timing.shape[0]} rows and {timing.n_codes} codes"
            )
        return cls(timing, rows, codes)

    @property
    def shape(self) -> tuple[int, int]:
        """(rows, cols) of the window."""
        return self.rows[1] - self.rows[0], self.timing.shape[1]

    @property
    def n_codes(self) -> int:
        """Codes in the window."""
        return self.codes[1] - self.codes[0]

    @property
    def no_photon_code(self) -> int | None:
        """Code that means no photon, counted from the start of the window."""
        absent = self.timing.no_photon_code
        kept = absent is not None and self.codes[0] <= absent < self.codes[1]
        return absent - self.codes[0] if absent is not None and kept else None

    @property
    def is_known(self) -> NDArray[np.bool_]:
        """(rows, cols), True where the codes of a pixel have times and it has a delay."""
        return self.timing.is_known[slice(*self.rows)]

    @property
    def phases(self) -> Floats:
        """(rows, cols, n_phases), relative widths of the camera's codes modulo n_phases."""
        return self.timing.phases[slice(*self.rows)]

    @property
    def phase_std(self) -> Floats:
        """(rows, cols, n_phases), standard error of `phases`."""
        return self.timing.phase_std[slice(*self.rows)]

    @property
    def misfit_std(self) -> Floats:
        """(rows, cols), spread of relative code widths that these leave out."""
        return self.timing.misfit_std[slice(*self.rows)]

    @property
    def skew_ps(self) -> Floats:
        """(rows, cols), delay of each pixel, ps."""
        return self.timing.skew_ps[slice(*self.rows)]

    @property
    def flags(self) -> NDArray[np.uint32]:
        """(rows, cols), see `lightflight.flags`."""
        return self.timing.flags[slice(*self.rows)]

    def check_matches(self, hist: Histograms) -> None:
        """Check that a recording is of this window of this clock.

        Raises
        ------
        CalibrationError
            Where the recording is of another window or clock.
        """
        start = hist.settings.get("window_start", [0, 0, 0])[2]
        ours = (self.shape, self.codes, self.timing.reversed_codes, self.no_photon_code)
        theirs = (
            hist.shape, (start, start + hist.n_codes), hist.reversed_codes, hist.no_photon_code
        )  # fmt: skip
        if ours != theirs:
            raise CalibrationError(
                f"the calibration has shape, codes, direction and no-photon code {ours} in this "
                f"window, the recording {theirs}: they are not of the same camera and clock setting"
            )
        for name, tolerance in (("laser_period_ps", 1e-4), ("bin_width_ps", 0.05)):
            known, told = getattr(self.timing, name), getattr(hist, name)
            if None not in (known, told) and abs(known / told - 1.0) > tolerance:
                raise CalibrationError(mismatch(name, known, told))

    def code_intervals_ps(self, rows: ArrayLike, cols: ArrayLike) -> tuple[Floats, Floats]:
        """See `TimingCalibration.code_intervals_ps`; (n, codes of the window) each."""
        lower, upper = self.timing.code_intervals_ps(np.asarray(rows) + self.rows[0], cols)
        kept = slice(*self.codes)
        return np.ascontiguousarray(lower[:, kept]), np.ascontiguousarray(upper[:, kept])

    def arrival_errors_ps(
        self, rows: ArrayLike, cols: ArrayLike, delay_ps: ArrayLike
    ) -> tuple[Floats, Floats, tuple[str, ...]]:
        """See `TimingCalibration.arrival_errors_ps`."""
        return self.timing.arrival_errors_ps(np.asarray(rows) + self.rows[0], cols, delay_ps)

    def shared_errors_ps(
        self, rows: ArrayLike, cols: ArrayLike, delay_ps: ArrayLike
    ) -> tuple[Floats, tuple[str, ...]]:
        """See `TimingCalibration.shared_errors_ps`."""
        return self.timing.shared_errors_ps(np.asarray(rows) + self.rows[0], cols, delay_ps)
