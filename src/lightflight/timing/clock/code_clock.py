"""What pulse fits and reconstructions ask of a clock, whoever answers."""

from __future__ import annotations

from dataclasses import dataclass, replace
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

    A `TimingCalibration` is one of a whole camera; a `TimingWindow` of `batch` is one of some rows
    and codes of it, a `ClockWithoutCodes` one of which some codes take no part. What each property
    is, `TimingCalibration` says.
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
    def phase_std(self) -> Floats:
        """(rows, cols, n_phases), standard error of `phases`."""

    @property
    def misfit_std(self) -> Floats:
        """(rows, cols), spread of relative code widths that these leave out."""

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
    def has_flat(self) -> bool:
        """Whether a flat told the delays of pixels, and so what a pulse looks like."""

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


@dataclass(frozen=True, eq=False)
class ClockView:
    """A clock seen through something: what its kind does not say anew is the clock's own.

    Attributes
    ----------
    timing : CodeClock
        The clock.
    """

    timing: CodeClock

    @property
    def shape(self) -> tuple[int, int]:
        """(rows, cols) of the pixels that the clock answers for."""
        return self.timing.shape

    @property
    def laser_period_ps(self) -> float | None:
        """Period of the laser, ps; None: one sweep."""
        return self.timing.laser_period_ps

    @property
    def bin_width_ps(self) -> float:
        """Mean width of a plateau code of the whole camera, ps."""
        return self.timing.bin_width_ps

    @property
    def phases(self) -> Floats:
        """(rows, cols, n_phases), relative widths of the codes modulo n_phases."""
        return self.timing.phases

    @property
    def phase_std(self) -> Floats:
        """(rows, cols, n_phases), standard error of `phases`."""
        return self.timing.phase_std

    @property
    def misfit_std(self) -> Floats:
        """(rows, cols), spread of relative code widths that these leave out."""
        return self.timing.misfit_std

    @property
    def skew_ps(self) -> Floats:
        """(rows, cols), delay of each pixel, ps."""
        return self.timing.skew_ps

    @property
    def is_known(self) -> NDArray[np.bool_]:
        """(rows, cols), True where the codes of a pixel have times and it has a delay."""
        return self.timing.is_known

    @property
    def flags(self) -> NDArray[np.uint32]:
        """(rows, cols), see `lightflight.flags`."""
        return self.timing.flags

    @property
    def has_flat(self) -> bool:
        """Whether a flat told the delays of pixels, and so what a pulse looks like."""
        return self.timing.has_flat

    @property
    def response(self) -> Response | None:
        """Shape that pulses on this clock are fitted with; None: a Gaussian."""
        return self.timing.response

    def check_matches(self, hist: Histograms) -> None:
        """Raise CalibrationError where the clock is not that of the recording."""
        self.timing.check_matches(hist)

    def code_intervals_ps(self, rows: ArrayLike, cols: ArrayLike) -> tuple[Floats, Floats]:
        """Delays that each code of the pixels covers: (lower, upper), each (n, codes), ps."""
        return self.timing.code_intervals_ps(rows, cols)

    def arrival_errors_ps(
        self, rows: ArrayLike, cols: ArrayLike, delay_ps: ArrayLike
    ) -> tuple[Floats, Floats, tuple[str, ...]]:
        """See `TimingCalibration.arrival_errors_ps`."""
        return self.timing.arrival_errors_ps(rows, cols, delay_ps)

    def shared_errors_ps(
        self, rows: ArrayLike, cols: ArrayLike, delay_ps: ArrayLike
    ) -> tuple[Floats, tuple[str, ...]]:
        """See `TimingCalibration.shared_errors_ps`."""
        return self.timing.shared_errors_ps(rows, cols, delay_ps)


@dataclass(frozen=True, eq=False)
class ClockWithoutCodes(ClockView):
    """A clock on which some codes of some pixels last no time, so that nothing is asked of them.

    Attributes
    ----------
    timing : CodeClock
        The clock.
    place : array of int, shape (rows, cols)
        Row of `cut` for each pixel; -1: all of its codes take part.
    cut : array of bool, shape (m, codes)
        True for codes that take no part.
    """

    place: NDArray[np.int64]

    cut: NDArray[np.bool_]

    @classmethod
    def of(
        cls, timing: CodeClock, pixel: NDArray[np.int64], code: NDArray[np.int64], n_codes: int
    ) -> ClockWithoutCodes:
        """Clock without some codes, each told by its pixel (row times columns and column).

        Parameters
        ----------
        timing : CodeClock
            The clock.
        pixel, code : array of int, shape (n,)
            Codes that take no part.
        n_codes : int
            Number of all codes of a pixel.

        Returns
        -------
        ClockWithoutCodes
            A view of `timing`.
        """
        pixels, row = np.unique(pixel, return_inverse=True)
        place = np.full(timing.shape, -1)
        place.ravel()[pixels] = np.arange(len(pixels))
        cut = np.zeros((len(pixels), n_codes), dtype=bool)
        cut[row, code] = True
        return cls(timing, place, cut)

    @property
    def codes(self) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Pixel and code of each that takes no part, (n,) each."""
        pixels = np.flatnonzero(self.place.ravel() >= 0)
        row, code = np.nonzero(self.cut[self.place.ravel()[pixels]])
        return pixels[row], code

    def emptied(self, hist: Histograms) -> Histograms:
        """A recording without counts in codes that take no part.

        Parameters
        ----------
        hist : Histograms
            Of the pixels and codes of this clock.

        Returns
        -------
        Histograms
            A copy.
        """
        counts = hist.counts.copy()
        counts.reshape(-1, hist.n_codes)[self.codes] = 0
        counts.setflags(write=False)
        return replace(hist, counts=counts)

    def cut_in(self, rows: ArrayLike, cols: ArrayLike) -> NDArray[np.bool_]:
        """(n, codes), True for codes of these pixels that take no part."""
        at = np.atleast_1d(self.place[np.asarray(rows), np.asarray(cols)])
        return np.asarray(self.cut[at] & (at >= 0)[:, np.newaxis])

    def code_intervals_ps(self, rows: ArrayLike, cols: ArrayLike) -> tuple[Floats, Floats]:
        """See `TimingCalibration.code_intervals_ps`; what takes no part ends where it begins."""
        lower, upper = self.timing.code_intervals_ps(rows, cols)
        return lower, np.where(self.cut_in(rows, cols), lower, upper)


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
