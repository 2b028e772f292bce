"""A calibrated clock seen through a window: some rows of the camera, some of its codes."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from lightflight.errors import CalibrationError

if TYPE_CHECKING:
    from lightflight.histogram import Histograms
    from lightflight.timing.calibration import TimingCalibration

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class TimingWindow:
    """Answers like a `TimingCalibration` of the pixels and codes in the window alone.

    Nothing is copied but pictures of the pixels; whatever is not cut is the calibration's own.
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
    ) -> Any:
        """Clock of rows start ... end - 1 and of the codes that are kept.

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

    def __getattr__(self, name: str) -> Any:
        """Whatever the window does not change; pictures of the pixels are cut to its rows."""
        if name.startswith("__") or name == "timing":
            raise AttributeError(name)
        value = getattr(self.timing, name)
        if isinstance(value, np.ndarray) and value.shape[:2] == self.timing.shape:
            return value[slice(*self.rows)]
        return value

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
    def first_edge_ps(self) -> float:
        """Start of the window's first code."""
        return self.timing.first_edge_ps + self.codes[0] * self.timing.bin_width_ps

    def check_matches(self, hist: Histograms) -> None:
        """Raise CalibrationError where the recording is of another window or clock."""
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
                raise CalibrationError(
                    f"the calibration has {name} = {known}, the recording {told}: "
                    "they are not of the same camera and clock setting"
                )

    def code_intervals_ps(self, rows: ArrayLike, cols: ArrayLike) -> tuple[Floats, Floats]:
        """See `TimingCalibration.code_intervals_ps`; (n, codes of the window) each."""
        lower, upper = self.timing.code_intervals_ps(np.asarray(rows) + self.rows[0], cols)
        kept = slice(*self.codes)
        return np.ascontiguousarray(lower[:, kept]), np.ascontiguousarray(upper[:, kept])

    def arrival_errors_ps(
        self, rows: NDArray[Any], cols: NDArray[Any], delay_ps: Floats
    ) -> tuple[Floats, Floats, tuple[str, ...]]:
        """See `TimingCalibration.arrival_errors_ps`."""
        return self.timing.arrival_errors_ps(rows + self.rows[0], cols, delay_ps)
