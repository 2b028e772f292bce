"""Histograms: counts per pixel and TDC code, with what is needed to read the codes as times.

Takes recordings (`recording.py`), gives the cube that `timing` fits. This module holds the
record; building it from frames and events by streaming is `recording.histogram`.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from lightflight.errors import CalibrationError


def _checked_counts(counts: ArrayLike, *, poisson: bool) -> NDArray[Any]:
    """Counts as a read-only array: unsigned integers, or float64 when not Poisson."""
    cube = np.asarray(counts)
    if cube.ndim != 3:
        raise ValueError(
            f"counts must have shape (rows, cols, codes), got shape {cube.shape}: "
            "reorder or reshape the axes first"
        )
    if 0 in cube.shape:
        raise ValueError(f"counts is empty: shape {cube.shape}")
    if cube.dtype.kind not in "uifb":
        raise TypeError(f"counts must be numbers, got dtype {cube.dtype}")
    if cube.dtype.kind == "f" and not np.isfinite(cube).all():
        bad = tuple(int(i) for i in np.argwhere(~np.isfinite(cube))[0])
        raise ValueError(f"counts[{bad}] is not finite: replace NaN and inf before you go on")
    if not poisson:
        out = np.array(cube, dtype=np.float64)
    else:
        if cube.dtype.kind in "if" and cube.min() < 0:
            bad = tuple(int(i) for i in np.argwhere(cube < 0)[0])
            raise ValueError(
                f"counts[{bad}] = {cube[bad]} is negative: photon counts cannot be; "
                "do not subtract a background (it is modelled), or pass poisson=False"
            )
        if cube.dtype.kind == "f" and not np.array_equal(cube, np.rint(cube)):
            bad = tuple(int(i) for i in np.argwhere(cube != np.rint(cube))[0])
            raise ValueError(
                f"counts[{bad}] = {cube[bad]} is fractional: photon counts are whole; "
                "pass poisson=False for scaled intensities"
            )
        if cube.dtype.kind == "u":
            # An array nobody else can write to is taken as it is: cubes may be large.
            out = cube.copy() if cube.flags.writeable or not cube.flags.owndata else cube
        else:
            out = cube.astype(np.uint64 if cube.max() > np.iinfo(np.uint32).max else np.uint32)
    out.setflags(write=False)
    return out


def _check_positive(name: str, value: float | None) -> None:
    if value is not None and not (np.isfinite(value) and value > 0):
        raise ValueError(f"{name} must be positive and finite, got {value}")


def _check_whole(name: str, value: float | None) -> None:
    if value is not None and value != int(value):
        raise ValueError(f"{name} must be a whole number, got {value}")


@dataclass(frozen=True, eq=False)
class Histograms:
    """Counts per pixel and TDC code.

    Forward code `k` holds delays [f + k w, f + (k+1) w) after the laser sync; a reversed code
    (photon starts, sync stops) holds (P - f - (k+1) w, P - f - k w]; both modulo the period P.

    Raises ValueError for a wrong shape, NaN, negative or fractional counts.
    """

    counts: NDArray[Any]
    """(rows, cols, codes), counts; unsigned and read-only (float64 where not `poisson`)."""

    bin_width_ps: float | None = field(default=None, kw_only=True)
    """Nominal width w of one code, ps. None: unknown, and times stay in codes."""

    laser_period_ps: float | None = field(default=None, kw_only=True)
    """Period P of the laser, ps. None: one sweep, nothing folds."""

    n_frames: int | None = field(default=None, kw_only=True)
    """Frames that were histogrammed; each gives at most one photon per pixel."""

    periods_per_frame: int | None = field(default=None, kw_only=True)
    """Laser periods in one frame (PF32 of the paper: 4,000)."""

    reversed_codes: bool = field(default=False, kw_only=True)
    """True where a larger code is an earlier photon (reverse start-stop)."""

    first_edge_ps: float = field(default=0.0, kw_only=True)
    """f: start of code 0 after the sync (reversed: before the next sync), ps."""

    no_photon_code: int | None = field(default=None, kw_only=True)
    """Code that means "no photon in this frame" (PF32: 0); it is excluded everywhere."""

    poisson: bool = field(default=True, kw_only=True)
    """False: scaled intensities (streak cubes); least squares with sandwich errors."""

    truth: Any = field(default=None, kw_only=True, repr=False)
    """What made the recording, where a simulator knows it."""

    settings: Mapping[str, Any] = field(default_factory=dict, kw_only=True, repr=False)
    """Unknown metadata carried along (temperature, exposure, file of origin ...)."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "counts", _checked_counts(self.counts, poisson=self.poisson))
        _check_positive("bin_width_ps", self.bin_width_ps)
        _check_positive("laser_period_ps", self.laser_period_ps)
        _check_positive("n_frames", self.n_frames)
        _check_positive("periods_per_frame", self.periods_per_frame)
        _check_whole("n_frames", self.n_frames)
        _check_whole("periods_per_frame", self.periods_per_frame)
        if not np.isfinite(self.first_edge_ps):
            raise ValueError(f"first_edge_ps must be finite, got {self.first_edge_ps}")
        if self.reversed_codes and self.laser_period_ps is None:
            raise ValueError(
                "reversed_codes=True needs laser_period_ps: reversed codes count back from the "
                "next laser pulse"
            )
        code = self.no_photon_code
        if code is not None and (code != int(code) or not 0 <= code < self.n_codes):
            raise ValueError(
                f"no_photon_code = {self.no_photon_code} is not one of the {self.n_codes} codes"
            )

    def _repr_html_(self) -> str:
        """What a notebook shows."""
        from lightflight.display import html_from_record

        return html_from_record(self)

    @property
    def shape(self) -> tuple[int, int]:
        """(rows, cols)."""
        return self.counts.shape[0], self.counts.shape[1]

    @property
    def n_codes(self) -> int:
        """Number of TDC codes."""
        return int(self.counts.shape[2])

    @property
    def photon_codes(self) -> NDArray[np.bool_]:
        """(codes,), True for every code that can mean a photon."""
        codes = np.ones(self.n_codes, dtype=bool)
        if self.no_photon_code is not None:
            codes[self.no_photon_code] = False
        return codes

    @property
    def photons(self) -> NDArray[Any]:
        """(rows, cols), counts in all codes that mean a photon."""
        kind = np.uint64 if self.poisson else np.float64
        total: NDArray[Any] = self.counts.sum(axis=2, dtype=kind)
        if self.no_photon_code is not None:
            total = total - self.counts[..., self.no_photon_code].astype(kind)
        return total

    @property
    def occupancy(self) -> NDArray[np.float64] | None:
        """(rows, cols), photons per frame; None where the number of frames is unknown."""
        return None if self.n_frames is None else self.photons / float(self.n_frames)

    def code_intervals_ps(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Nominal delay interval of each code: (lower, upper), each (codes,), ps after the sync.

        The intervals are not folded: those of a reversed clock may be negative and stand for
        the same delay plus one period. The no-photon code has zero width.

        Raises CalibrationError where the width of a code is unknown.
        """
        if self.bin_width_ps is None:
            raise CalibrationError(
                "the time per bin of this recording is unknown: give bin_width_ps for times in ps"
            )
        code = np.arange(self.n_codes + 1, dtype=np.float64)
        edges = self.first_edge_ps + code * self.bin_width_ps
        if self.reversed_codes:
            assert self.laser_period_ps is not None
            edges = self.laser_period_ps - edges
            lower, upper = edges[1:].copy(), edges[:-1].copy()
        else:
            lower, upper = edges[:-1].copy(), edges[1:].copy()
        if self.no_photon_code is not None:
            upper[self.no_photon_code] = lower[self.no_photon_code]
        return lower, upper
