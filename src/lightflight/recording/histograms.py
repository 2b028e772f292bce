"""Histograms: counts per pixel and TDC code, with what is needed to read the codes as times.

Takes recordings (`recording.py`), gives the cube that `timing` fits. This module holds the
record; building it from frames and events by streaming is `recording.histogram`.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from lightflight.arguments import refuse_masks, yes_or_no
from lightflight.display import (
    Card,
    Drawn,
    Labelled,
    clock_facts,
    count_facts,
    picture_from_image,
    size_facts,
)
from lightflight.errors import CalibrationError
from lightflight.recording.clock_fields import check_clock_fields, clock_fields_of

_SLAB_ELEMENTS = 1 << 20
_MOST_COUNT = 2.0**64


def _checked_counts(counts: ArrayLike, *, poisson: bool) -> NDArray[np.generic]:
    """Counts as a read-only array: unsigned integers, or float64 when not Poisson."""
    cube = np.asarray(counts)
    refuse_masks("counts", counts)
    if cube.ndim != 3:
        raise ValueError(
            f"counts must have shape (rows, cols, codes), got shape {cube.shape}: "
            "reorder or reshape the axes first"
        )
    if 0 in cube.shape:
        raise ValueError(f"counts is empty: shape {cube.shape}")
    if cube.dtype.kind not in "uifb":
        raise TypeError(f"counts must be numbers, got dtype {cube.dtype}")
    if cube.dtype.kind == "u" and poisson:
        # An array nobody else can write to is taken as it is: cubes may be large.
        out = cube if _is_nobody_elses(cube) else cube.copy()
    elif cube.dtype == np.float64 and not poisson and _is_nobody_elses(cube):
        _check_slab(cube, cube.shape, (0, 1, 2), 0, poisson=False)
        out = cube
    else:
        step = max(1, _SLAB_ELEMENTS // (cube.shape[1] * cube.shape[2]))
        slabs = (cube[first : first + step] for first in range(0, cube.shape[0], step))
        out = counts_from_slabs(slabs, cube.dtype, cube.shape, order=(0, 1, 2), poisson=poisson)
    out.setflags(write=False)
    return out


def _is_nobody_elses(cube: NDArray[np.generic]) -> bool:
    """Whether an array, or all of what it is a view of, is closed to writing."""
    whole = cube if cube.base is None else cube.base
    if not isinstance(whole, np.ndarray) or isinstance(whole, np.memmap):
        return False
    return not cube.flags.writeable and not whole.flags.writeable and whole.flags.owndata


def counts_dtype(dtype: np.dtype[np.generic], *, poisson: bool) -> np.dtype[np.generic]:
    """Type that counts stored as `dtype` are kept as, unless one is beyond 32 bits."""
    if not poisson:
        return np.dtype(np.float64)
    return dtype.newbyteorder("=") if dtype.kind == "u" else np.dtype(np.uint32)


def counts_from_slabs(
    slabs: Iterable[NDArray[np.generic]],
    dtype: np.dtype[np.generic],
    shape: tuple[int, int, int],
    *,
    order: tuple[int, ...],
    poisson: bool,
) -> NDArray[np.generic]:
    """Counts (rows, cols, codes), checked and filled in slab by slab: no second copy is made.

    Parameters
    ----------
    slabs : iterable of array
        Rows of the first axis of the source, one after another.
    dtype : np.dtype[np.generic]
        Type of their elements.
    shape : (int, int, int)
        Rows, columns and codes.
    order : tuple of int
        Which axis of the source each axis of the cube is; fewer than three where pixels are in one
        axis, or there is one pixel.
    poisson : bool
        False for scaled intensities.

    Returns
    -------
    array
        Read-only: as it is stored where that is unsigned, uint32 or uint64 else; float64 where not
        `poisson`.

    Raises
    ------
    ValueError
        For NaN, negative and fractional counts, and those beyond 64 bits (the text says where).
    """
    merged = {3: shape, 2: (shape[0] * shape[1], shape[2]), 1: (shape[2],)}[len(order)]
    out, first = np.empty(shape, counts_dtype(dtype, poisson=poisson)), 0
    for slab in slabs:
        _check_slab(slab, shape, order, first, poisson=poisson)
        if out.dtype == np.uint32 and slab.size and float(slab.max()) > np.iinfo(np.uint32).max:
            out = out.astype(np.uint64)
        turned = np.transpose(out.reshape(merged), np.argsort(order))
        turned[first : first + len(slab)] = slab
        first += len(slab)
    out.setflags(write=False)
    return out


def _check_slab(
    slab: NDArray[Any],
    shape: tuple[int, int, int],
    order: tuple[int, ...],
    first: int,
    *,
    poisson: bool,
) -> None:
    """Raise ValueError for what cannot be counts, with its place in the cube."""

    def said(bad: NDArray[np.bool_]) -> str:
        inside = np.argwhere(bad)[0]
        at = inside.copy()
        at[0] += first
        merged = {3: shape, 2: (shape[0] * shape[1], shape[2]), 1: (shape[2],)}[len(order)]
        flat = np.ravel_multi_index(tuple(at[list(order)]), merged)
        where = ", ".join(str(i) for i in np.unravel_index(flat, shape))
        value = slab[tuple(inside)]
        return f"counts[{where}]" + (f" = {value}" if np.isfinite(value) else "")

    kind = slab.dtype.kind
    if kind == "f" and not np.isfinite(slab).all():
        raise ValueError(
            f"{said(~np.isfinite(slab))} is not finite: replace NaN and inf before you go on"
        )
    if not poisson or kind not in "if" or not slab.size:
        return
    if slab.min() < 0:
        raise ValueError(
            f"{said(slab < 0)} is negative: photon counts cannot be; "
            "do not subtract a background (it is modelled), or pass poisson=False"
        )
    if kind == "f" and not np.array_equal(slab, np.rint(slab)):
        raise ValueError(
            f"{said(slab != np.rint(slab))} is fractional: photon counts are whole; "
            "pass poisson=False for scaled intensities"
        )
    # As a Python number: half precision has none so large.
    if kind == "f" and float(slab.max()) >= _MOST_COUNT:
        raise ValueError(
            f"{said(slab >= slab.dtype.type(_MOST_COUNT))} is beyond 64 bits: no camera counts so "
            "many; pass poisson=False for scaled intensities"
        )


def _check_sums(counts: NDArray[np.uint64]) -> None:
    """Raise ValueError where the counts of a pixel add up beyond 64 bits, and would wrap."""
    if counts.sum(axis=2, dtype=np.float64).max() >= _MOST_COUNT:
        raise ValueError("the counts of a pixel add up beyond 64 bits: no camera counts so many")


@dataclass(frozen=True, eq=False, repr=False)
class Histograms(Drawn, Labelled):
    """Counts per pixel and TDC code.

    Forward code `k` holds delays [f + k w, f + (k+1) w) after the laser sync; a reversed code
    (photon starts, sync stops) holds (P - f - (k+1) w, P - f - k w]; both modulo the period P.

    Raises ValueError for a wrong shape, NaN, negative or fractional counts.

    Attributes
    ----------
    counts : array, shape (rows, cols, codes)
        Counts; unsigned and read-only (float64 where not `poisson`).
    bin_width_ps : float or None
        Nominal width w of one code, ps. None: unknown, and times stay in codes.
    laser_period_ps : float or None
        Period P of the laser, ps. None: one sweep, nothing folds.
    n_frames : int or None
        Frames that were histogrammed; each gives at most one photon per pixel.
    periods_per_frame : int or None
        Laser periods in one frame (PF32 of the paper: 4,000).
    reversed_codes : bool
        True where a larger code is an earlier photon (reverse start-stop).
    first_edge_ps : float
        f: start of code 0 after the sync (reversed: before the next sync), ps.
    no_photon_code : int or None
        Code that means "no photon in this frame" (PF32: 0); it is excluded everywhere.
    poisson : bool
        False: scaled intensities (streak cubes); least squares with sandwich errors.
    truth : object
        What made the recording, where a simulator knows it.
    settings : mapping of str
        Unknown metadata carried along (temperature, exposure, file of origin ...).
    """

    counts: NDArray[Any]

    bin_width_ps: float | None = field(default=None, kw_only=True)

    laser_period_ps: float | None = field(default=None, kw_only=True)

    n_frames: int | None = field(default=None, kw_only=True)

    periods_per_frame: int | None = field(default=None, kw_only=True)

    reversed_codes: bool = field(default=False, kw_only=True)

    first_edge_ps: float = field(default=0.0, kw_only=True)

    no_photon_code: int | None = field(default=None, kw_only=True)

    poisson: bool = field(default=True, kw_only=True)

    truth: Any = field(default=None, kw_only=True, repr=False)

    settings: Mapping[str, Any] = field(default_factory=dict, kw_only=True, repr=False)

    def __post_init__(self) -> None:
        yes_or_no("poisson", self.poisson)
        object.__setattr__(self, "counts", _checked_counts(self.counts, poisson=self.poisson))
        check_clock_fields(clock_fields_of(self), n_codes=self.n_codes)

    def _card(self) -> Card:
        photons = np.asarray(self.photons, dtype=float)
        facts = size_facts(self.shape) + clock_facts(self)
        facts += count_facts(
            photons=photons.sum(), brightest_pixel=photons.max(), frames=self.n_frames
        )
        # A tenth of the pixels may scream; they must not hide the others.
        image = np.sqrt(np.maximum(photons, 0.0))
        picture = partial(picture_from_image, image, percent=90.0)
        return Card("Histograms", facts, picture, "photons by pixel (square root)")

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
        if self.counts.dtype == np.uint64:
            _check_sums(self.counts)
        total: NDArray[np.generic] = self.counts.sum(axis=2, dtype=kind)
        if self.no_photon_code is not None:
            # All codes less one: no copy of the cube without it is made.
            total = total - self.counts[..., self.no_photon_code].astype(kind)
        return total

    @property
    def occupancy(self) -> NDArray[np.float64] | None:
        """(rows, cols), photons per frame; None where the number of frames is unknown."""
        return None if self.n_frames is None else self.photons / float(self.n_frames)

    def code_intervals_ps(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Nominal delay interval of each code.

        The intervals are not folded: those of a reversed clock may be negative and stand for the
        same delay plus one period. The no-photon code has zero width.

        Returns
        -------
        lower, upper : array of float, shape (codes,)
            ps after the sync.

        Raises
        ------
        CalibrationError
            Where the width of a code is unknown.

        Examples
        --------
        >>> hist = Histograms(np.ones((1, 1, 3), np.uint16), bin_width_ps=50.0, first_edge_ps=10.0)
        >>> hist.code_intervals_ps()
        (array([ 10.,  60., 110.]), array([ 60., 110., 160.]))
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


def nominal_intervals(
    hist: Histograms,
) -> tuple[NDArray[np.float64], NDArray[np.float64], str]:
    """Lower and upper end of each code, (codes,), and their unit: ps, or codes in time's order.

    Parameters
    ----------
    hist : Histograms
        Whose codes; where their width is unknown, their numbers stand in for times.
    """
    if hist.bin_width_ps is not None:
        return *hist.code_intervals_ps(), "ps"
    code = np.arange(hist.n_codes, dtype=np.float64)
    # A reversed clock counts down to the sync: the last code comes first.
    lower, upper = (-code - 1.0, -code) if hist.reversed_codes else (code, code + 1.0)
    return lower, np.where(hist.photon_codes, upper, lower), "codes"
