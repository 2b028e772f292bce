"""The camera's clock: what turns TDC codes into times, with the errors that remain.

Takes a code-density recording (`code_density.py`) and a flat recording (`delays.py`), gives a
`TimingCalibration` that pulse fits and arrivals ask for code edges, delays and error bars.

A TDC code of pixel p covers `gain[p] * bin_width_ps * code_widths[k] * phases[p, k % n_phases]`
picoseconds. Edges are counted from the end of the laser period (`end_code`), where the delay of
a reversed clock is zero: that edge is visible in every code-density recording.
"""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from functools import cached_property, partial
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from lightflight.display import (
    Card,
    Drawn,
    Labelled,
    clock_facts,
    flag_facts,
    number,
    picture_from_image,
    size_facts,
)
from lightflight.flags import count_flags, is_usable
from lightflight.recording.histograms import Histograms
from lightflight.timing.clock.code_clock import check_same_clock
from lightflight.timing.clock.code_edges import (
    MOST_PHASES,
    edges_and_end,
    phase_lever,
    relative_widths,
    walk_variance,
    walked,
)
from lightflight.timing.clock.possible import (
    check_plain_values,
    check_texts,
    possible_array,
    possible_flags,
)

if TYPE_CHECKING:
    from lightflight.timing.clock.response import Response

Floats = NDArray[np.float64]
Pixels = NDArray[np.intp]

ASSUMED_GAIN_STD = 0.0065
"""Spread of the gain between pixels of a camera whose gain was never measured (a real PF32)."""

ASSUMED_PHASE_STD = 0.065
"""Relative spread of unmeasured code widths (a real PF32: 0.058 shared, 0.030 per pixel)."""

ASSUMED_SCALE_STD = 0.005
"""Relative error of a data sheet's code width (a real PF32: 54.7 or 55.1 ps for 55)."""

_BLOCK_CODES = 32_768
"""Codes whose edges are worked out at a time."""
_KEPT_CODES = 2_000_000
"""The edges of a camera with no more codes than this in all are kept (32 MB)."""

_ARRAY_FIELDS = {
    "gain": 0, "phases": 1, "end_code": 0, "first_live_width": 0, "gain_std": 0, "phase_std": 1,
    "misfit_std": 0, "skew_ps": 0, "skew_std_ps": 0, "anchor_delay_ps": 0, "response_std_ps": 0,
}  # fmt: skip
"""Per-pixel arrays of a calibration and how many axes they have beyond (rows, cols)."""


def _typical(std_ps: Floats) -> str:
    known = std_ps[np.isfinite(std_ps)]
    if not known.any():
        return "taken as exact" if known.size else "unknown"
    return f"{number(float(np.median(known)), 2)} ps in a typical pixel"


_WALKED_PS = np.array([600.0, 2500.0])
"""Ends of the stretches, ps from the flat, in each of which errors of code widths add up to one."""
_STRANGEST = 1000.0
"""Times the nominal width of a code: a pixel so far off has no clock. Real ones are within 2."""


@dataclass(frozen=True, eq=False, repr=False)
class TimingCalibration(Drawn, Labelled):
    """Code edges and delay of every pixel, nine numbers each, with their errors.

    Times are delays after the laser sync until a pixel's own delay (`skew_ps`) is taken off;
    then they are arrival times on the clock that the flat recording defines.

    Attributes
    ----------
    shape : (int, int)
        (rows, cols).
    n_codes : int
        Number of TDC codes.
    laser_period_ps : float or None
        Period P of the laser, ps. None: one sweep, nothing folds.
    reversed_codes : bool
        True where a larger code is an earlier photon.
    no_photon_code : int or None
        Code that means "no photon", or None; it has zero width.
    first_edge_ps : float
        Start of code 0 after the sync (reversed: before the next sync), ps.
    bin_width_ps : float
        Mean width of a plateau code over good pixels, ps (1 where times stay in codes).
    gain : array of float, shape (rows, cols)
        Width of a plateau code / `bin_width_ps`.
    phases : array of float, shape (rows, cols, n_phases)
        Relative widths of the codes k = 0 .. n_phases - 1 modulo n_phases, mean 1. n_phases =
        n_codes: every code has a width of its own.
    code_widths : array of float, shape (codes,)
        Relative widths all pixels share: 0 dead, 1 plateau, more for double codes.
    end_code : array of float, shape (rows, cols)
        The fractional code at which the laser period ends.
    first_live_code : int
        The first code that is not dead.
    first_live_width : array of float, shape (rows, cols)
        Relative width of that code in each pixel (it takes up the time of the dead ones and differs
        between pixels); the shared one where NaN.
    end_widths : array of float, shape (m,)
        Relative widths of the last codes before the period's end, by whole codes from it; empty
        where the sync does not disturb the clock.
    gain_std : array of float, shape (rows, cols)
        Standard error of `gain`.
    phase_std : array of float, shape (rows, cols, n_phases)
        Standard error of each of `phases`.
    misfit_std : array of float, shape (rows, cols)
        Root mean square of relative code widths that the structured model leaves out.
    skew_ps : array of float, shape (rows, cols)
        Delay of the pixel minus arrival time of the flat, ps.
    skew_std_ps : array of float, shape (rows, cols)
        Error of `skew_ps` from the photons of the flat, ps.
    anchor_delay_ps : array of float, shape (rows, cols)
        Delay at which the flat's pulse sat, ps; NaN where there was none. Gain and phase errors
        grow with the distance from there.
    response_std_ps : array of float, shape (rows, cols)
        Standard deviation of the flat's pulse, ps; NaN where unknown.
    flags : array of uint32, shape (rows, cols)
        See `lightflight.flags`.
    period_end_seen : bool
        True where the codes' own period ends at `end_code`, as measured or by the nominal code
        width: later codes then hold no time. False: unknown, nothing is cut.
    scale_std : float
        Relative error of `bin_width_ps`, shared by all pixels (dead codes absorbed or lost).
    code_length_std : float
        Relative error of the codes' length since the calibration (a warm camera), shared.
    code_width_std : float
        Relative error of one of `code_widths`, rms: what is left of codes that are unequal one by
        one. It adds up like a walk from the flat's delay to a pulse's, alike in all pixels.
    assumed_skew_std_ps : float
        Spread of delays assumed for pixels without a flat, ps.
    flat_modes_ps : array of float, shape (rows, cols, k)
        Errors of the flat's geometry that all pixels share, one sigma, ps.
    flat_mode_names : tuple of str
        (k), names of `flat_modes_ps`.
    response_curve : array of float, shape (2, m)
        Time (ps) and density of the shape that the flat's pulse was fitted with, and a recording's
        will be; no columns: a Gaussian.
    response_place_ps : float or None
        Time of `response_curve` that is the place of a pulse (`Response.anchored`), ps; None, and
        in files of earlier versions: its mean.
    notes : tuple of str
        What was measured, what is nominal, and what that costs, in sentences.
    provenance : mapping of str
        What made this calibration.
    """

    shape: tuple[int, int]

    n_codes: int

    laser_period_ps: float | None

    reversed_codes: bool

    no_photon_code: int | None

    first_edge_ps: float

    bin_width_ps: float

    gain: Floats

    phases: Floats

    code_widths: Floats

    end_code: Floats

    first_live_code: int

    first_live_width: Floats

    end_widths: Floats

    gain_std: Floats

    phase_std: Floats

    misfit_std: Floats

    skew_ps: Floats

    skew_std_ps: Floats

    anchor_delay_ps: Floats

    response_std_ps: Floats

    flags: NDArray[np.uint32]

    period_end_seen: bool = False

    scale_std: float = 0.0

    assumed_skew_std_ps: float = 0.0

    flat_modes_ps: Floats = field(default_factory=lambda: np.zeros((0, 0, 0)))

    flat_mode_names: tuple[str, ...] = ()

    response_curve: Floats = field(default_factory=lambda: np.zeros((2, 0)))

    notes: tuple[str, ...] = ()

    provenance: Mapping[str, Any] = field(default_factory=dict, repr=False)

    code_length_std: float = field(default=0.0, kw_only=True)

    code_width_std: float = field(default=0.0, kw_only=True)

    response_place_ps: float | None = field(default=None, kw_only=True)

    def __post_init__(self) -> None:
        values = {item.name: getattr(self, item.name) for item in fields(self)}
        check_plain_values(values)
        check_texts(values)
        rows_cols = tuple(self.shape)
        for name, extra in _ARRAY_FIELDS.items():
            array = possible_array(name, values[name])
            if array.shape[: len(rows_cols)] != rows_cols or array.ndim != 2 + extra:
                raise ValueError(
                    f"{name} must have shape {rows_cols} and {extra} more axes, got {array.shape}"
                )
            self._keep(name, array)
        flags = possible_flags(self.flags)
        if flags.shape != rows_cols:
            raise ValueError(f"flags must have shape {rows_cols}, got {flags.shape}")
        self._keep("flags", flags)
        widths = possible_array("code_widths", self.code_widths)
        if widths.shape != (self.n_codes,):
            raise ValueError(f"code_widths must have shape ({self.n_codes},), got {widths.shape}")
        self._keep("code_widths", widths)
        self._keep("end_widths", possible_array("end_widths", self.end_widths).reshape(-1))
        modes = possible_array("flat_modes_ps", self.flat_modes_ps)
        if not self.flat_mode_names:
            modes = np.zeros((*rows_cols, 0))
        elif modes.shape != (*rows_cols, len(self.flat_mode_names)):
            raise ValueError(f"flat_modes_ps has shape {modes.shape}, names {self.flat_mode_names}")
        self._keep("flat_modes_ps", modes)
        curve = possible_array("response_curve", self.response_curve)
        if curve.size % 2:
            raise ValueError(f"response_curve must have shape (2, m), got {curve.shape}")
        self._keep("response_curve", curve.reshape(2, -1))

    def _keep(self, name: str, array: NDArray[np.generic]) -> None:
        """Keep an array as a field that nobody can write into."""
        array.setflags(write=False)
        object.__setattr__(self, name, array)

    @property
    def response(self) -> Response | None:
        """Shape of the flat's pulse; None: a Gaussian."""
        from lightflight.timing.clock.response import Response

        if not self.response_curve.shape[1]:
            return None
        return Response(*self.response_curve, place_ps=self.response_place_ps)

    @property
    def n_phases(self) -> int:
        """Length of the pattern of code widths; 1: none, n_codes: every code by itself."""
        return int(self.phases.shape[2])

    @cached_property
    def has_flat(self) -> bool:
        """Whether a flat told the delays of pixels, and so what a pulse looks like."""
        return bool(np.isfinite(self.anchor_delay_ps).any())

    @cached_property
    def is_known(self) -> NDArray[np.bool_]:
        """(rows, cols), True where the codes of a pixel have times and it has a delay.

        A pixel that no flat or code-density recording saw has NaN there: its counts say nothing.
        """
        known: NDArray[np.bool_] = np.isfinite(self.skew_ps) & (self.end_code >= 1.0)
        # A code of the pattern may well have no width; all of them together have one.
        width = self.gain * self.phases.mean(axis=2)
        known &= (width > 1.0 / _STRANGEST) & (width < _STRANGEST)
        known &= np.isnan(self.first_live_width) | (np.abs(self.first_live_width) < _STRANGEST)
        known &= ~np.isinf(self.misfit_std) & ~np.isinf(self.phase_std).any(axis=2)
        return known

    @property
    def end_delay_ps(self) -> float:
        """Delay at the end of the laser period (without one: at code 0), ps; edges start here."""
        if self.reversed_codes:
            return -self.first_edge_ps
        return self.first_edge_ps + (self.laser_period_ps or 0.0)

    def code_intervals_ps(self, rows: ArrayLike, cols: ArrayLike) -> tuple[Floats, Floats]:
        """Delays that each code of the given pixels covers.

        Parameters
        ----------
        rows, cols : array-like, shape (n,)
            Pixel indices.

        Returns
        -------
        lower, upper : array of float, shape (n, codes)
            ps after the sync, before the pixel's own delay is taken off, not folded; `lower <=
            upper`, equal for codes that can hold no photon.
        """
        rows, cols = self._checked_pixels(rows, cols)
        if self.gain.size * len(self.code_widths) > _KEPT_CODES:
            return self._intervals_ps(rows, cols)
        lower, upper = self._all_intervals_ps
        pixel = rows * self.shape[1] + cols
        return lower[pixel], upper[pixel]

    @cached_property
    def _all_intervals_ps(self) -> tuple[Floats, Floats]:
        """Code intervals of every pixel of a small camera: each step of a fit asks for some."""
        rows, cols = (index.ravel() for index in np.indices(self.shape))
        return self._intervals_ps(rows, cols)

    def __getstate__(self) -> dict[str, object]:
        """What another process needs: not what can be worked out again."""
        return {item.name: getattr(self, item.name) for item in fields(self)}

    def _intervals_ps(self, rows: Pixels, cols: Pixels) -> tuple[Floats, Floats]:
        first, last = np.empty((2, len(rows), len(self.code_widths)))
        blind = self.code_widths == 0
        # Few pixels at a time: what is worked on stays in the cache.
        step = max(1, _BLOCK_CODES // len(self.code_widths))
        for start in range(0, len(rows), step):
            part = slice(start, start + step)
            edges = self._edges_ps(rows[part], cols[part])
            first[part], last[part] = edges[:, :-1], edges[:, 1:]
            # A blind code has no width, and leaves its neighbours where they are.
            moved, kept = (first, last) if self.reversed_codes else (last, first)
            moved[part, blind] = kept[part, blind]
        return (last, first) if self.reversed_codes else (first, last)

    def _edges_ps(self, rows: Pixels, cols: Pixels) -> Floats:
        """(n, codes + 1), delay of each edge of the codes, in their order."""
        edges, end = self._relative_edges(rows, cols)
        # From the period's end on: the one edge that every code-density recording shows.
        if self.laser_period_ps is not None:
            edges -= end[:, None]
        if self.period_end_seen:
            np.minimum(edges, 0.0, out=edges)
        # Of a reversed clock (photon starts, sync stops) delays fall as codes grow.
        towards = -1.0 if self.reversed_codes else 1.0
        edges *= towards * self._width_ps(rows, cols)[:, None]
        edges += self.end_delay_ps
        return edges

    def arrival_errors_ps(
        self, rows: ArrayLike, cols: ArrayLike, delay_ps: ArrayLike
    ) -> tuple[Floats, Floats, tuple[str, ...]]:
        """Errors that this calibration leaves on arrival times.

        The pixel class is independent between pixels: photons of the flat, gain times the
        distance from the flat's delay, and code widths between the two (they cancel where
        recording and flat sit at the same codes). Shared errors are modes.

        Parameters
        ----------
        rows, cols : array-like, shape (n,)
            Pixel indices.
        delay_ps : array-like, shape (n,)
            ps after the sync, before the pixel's own delay is taken off; NaN gives NaN.

        Returns
        -------
        pixel_std_ps : array of float, shape (n,)
            ps.
        shared_modes_ps : array of float, shape (n, k)
            ps, one column per shared error, one sigma each.
        names : tuple of str, (k)
            Name of each column.
        """
        rows, cols = self._checked_pixels(rows, cols)
        delay = self._folded(np.asarray(delay_ps, dtype=np.float64))
        anchor = self._folded(self.anchor_delay_ps[rows, cols])
        distance = self._from_anchor_ps(rows, cols, delay)
        gain = self.gain[rows, cols]
        gain_error = self.gain_std[rows, cols] / np.where(gain > 0.0, gain, np.nan)
        variance = self.skew_std_ps[rows, cols] ** 2 + (gain_error * distance) ** 2
        variance = variance + self._width_variance(rows, cols, delay, anchor)
        return np.sqrt(variance), *self._shared_errors_ps(rows, cols, delay, distance)

    def shared_errors_ps(
        self, rows: ArrayLike, cols: ArrayLike, delay_ps: ArrayLike
    ) -> tuple[Floats, tuple[str, ...]]:
        """The last two of `arrival_errors_ps`, alone: what all pixels share is soon told.

        Parameters
        ----------
        rows, cols : array-like, shape (n,)
            Pixel indices.
        delay_ps : array-like, shape (n,)
            As there.

        Returns
        -------
        shared_modes_ps : array of float, shape (n, k)
            ps, one column per shared error, one sigma each.
        names : tuple of str, (k)
            Name of each column.
        """
        rows, cols = self._checked_pixels(rows, cols)
        delay = self._folded(np.asarray(delay_ps, dtype=np.float64))
        return self._shared_errors_ps(rows, cols, delay, self._from_anchor_ps(rows, cols, delay))

    def _from_anchor_ps(self, rows: Pixels, cols: Pixels, folded_ps: Floats) -> Floats:
        """(n,), how far delays are from the flat's."""
        anchor = self._folded(self.anchor_delay_ps[rows, cols])
        # Without a flat nothing is anchored: errors grow with the delay after the sync.
        return folded_ps - np.where(np.isfinite(anchor), anchor, self._folded(np.zeros(1)))

    def _shared_errors_ps(
        self, rows: Pixels, cols: Pixels, delay: Floats, distance: Floats
    ) -> tuple[Floats, tuple[str, ...]]:
        modes = [self.flat_modes_ps[rows, cols]]
        names = list(self.flat_mode_names)
        if self.scale_std > 0:
            modes.append((self.scale_std * distance)[:, None])
            names.append("clock scale")
        if self.code_length_std > 0:
            # Not the flat's codes stretch but the recording's: counted from where counting starts.
            counted = self._folded_start() + (self.laser_period_ps or 0.0) * self.reversed_codes
            modes.append((self.code_length_std * np.abs(delay - counted))[:, None])
            names.append("code length")
        if self.code_width_std > 0:
            codes = distance / self._width_ps(rows, cols)
            steps = walked(codes, _WALKED_PS / self.bin_width_ps)
            modes.append(self.code_width_std * self.bin_width_ps * steps)
            names.extend(f"code widths {k + 1}" for k in range(steps.shape[1]))
        return np.concatenate(modes, axis=1), tuple(names)

    @classmethod
    def nominal(cls, hist: Histograms, *, assumed_skew_std_ps: float = 0.0) -> TimingCalibration:
        """The clock as the recording states it: equal codes, no delays, no errors of its own.

        Without `bin_width_ps` the unit of time is one code.

        Parameters
        ----------
        hist : Histograms
            Recording that states code width, period and direction.
        assumed_skew_std_ps : float, optional
            Spread of the pixels' delays, ps.

        Returns
        -------
        TimingCalibration
            Equal codes, with a note that says so.
        """
        width = 1.0 if hist.bin_width_ps is None else float(hist.bin_width_ps)
        period = hist.laser_period_ps if hist.bin_width_ps is not None else None
        image = np.zeros(hist.shape)
        widths = np.ones(hist.n_codes)
        if hist.no_photon_code is not None:
            widths[hist.no_photon_code] = 0.0
        end = float(hist.n_codes) if period is None else period / width
        notes = ["nominal clock: equal codes, no delay between pixels"]
        if hist.bin_width_ps is None:
            notes.append("the width of a code is unknown: times are in codes")
        return cls(
            shape=hist.shape, n_codes=hist.n_codes, laser_period_ps=period,
            reversed_codes=hist.reversed_codes, no_photon_code=hist.no_photon_code,
            first_edge_ps=hist.first_edge_ps, bin_width_ps=width, gain=image + 1.0,
            phases=image[..., None] + 1.0, code_widths=widths, end_code=image + end,
            first_live_code=0, first_live_width=image + np.nan, end_widths=np.zeros(0),
            gain_std=image, phase_std=image[..., None], misfit_std=image, skew_ps=image,
            skew_std_ps=image + assumed_skew_std_ps, anchor_delay_ps=image + np.nan,
            response_std_ps=image + np.nan, flags=image.astype(np.uint32),
            assumed_skew_std_ps=assumed_skew_std_ps, notes=tuple(notes),
            # Codes beyond one period would stand for the same delays once more.
            period_end_seen=period is not None,
        )  # fmt: skip

    def _card(self) -> Card:
        facts = [
            *size_facts(self.shape),
            *clock_facts(self),
            ("error of the time scale", f"{number(100 * self.scale_std, 2)} %"),
            ("error of a delay", _typical(self.skew_std_ps)),
            *flag_facts(self.flags),
            *(("" if k else "notes", note) for k, note in enumerate(self.notes)),
        ]
        known = self.skew_ps[np.isfinite(self.skew_ps)]
        has_delays = len(known) > 0 and np.ptp(known) > 0
        picture = partial(picture_from_image, self.skew_ps if has_delays else self.gain)
        caption = "delay by pixel" if has_delays else "gain by pixel"
        return Card("TimingCalibration", facts, picture, caption)

    def describe(self) -> str:
        """What this clock is, how well it is known and what is wrong, a sentence per line.

        Returns
        -------
        str
            Lines without indentation; the last counts the flags.
        """
        rows, cols = self.shape
        words = ", ".join(f"{n} {name}" for name, n in count_flags(self.flags).items())
        usable = int(np.count_nonzero(is_usable(self.flags)))
        first = (
            f"{rows} x {cols} pixels ({usable} usable) of {self.n_codes} codes, "
            f"{self.bin_width_ps:.2f} ps each"
        )
        return "\n".join([first, *self.notes, f"flagged: {words or 'none'}"])

    def check_matches(self, hist: Histograms) -> None:
        """Check that a recording is of this camera and clock setting.

        Parameters
        ----------
        hist : Histograms
            The recording.

        Raises
        ------
        CalibrationError
            Where shape, codes, direction, period, code width or first edge differ.
        """
        check_same_clock(self, hist)

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write everything to one HDF5 file; the file appears whole or not at all.

        Parameters
        ----------
        path : str or os.PathLike[str]
            Where to; a file that is there is replaced.
        """
        from lightflight.timing.clock.calibration_file import save_calibration

        save_calibration(self, path)

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> TimingCalibration:
        """Read what `save` wrote.

        Parameters
        ----------
        path : str or os.PathLike[str]
            An HDF5 file.

        Returns
        -------
        TimingCalibration
            What was saved; later fields that an old file lacks have their defaults.

        Raises
        ------
        FileFormatError
            For a file that is damaged, no calibration, or one of a later version.
        """
        from lightflight.timing.clock.calibration_file import load_calibration

        return load_calibration(path, make=cls)

    def _checked_pixels(self, rows: ArrayLike, cols: ArrayLike) -> tuple[Pixels, Pixels]:
        """Pixel indices as two equal one-dimensional arrays inside the camera."""
        row, col = np.broadcast_arrays(np.atleast_1d(rows), np.atleast_1d(cols))
        row, col = row.astype(np.intp), col.astype(np.intp)
        if row.ndim != 1:
            raise ValueError(f"rows and cols must have shape (n,), got {row.shape}")
        inside = (row >= 0) & (row < self.shape[0]) & (col >= 0) & (col < self.shape[1])
        if not inside.all():
            bad = int(np.flatnonzero(~inside)[0])
            raise ValueError(f"pixel ({row[bad]}, {col[bad]}) is not in a camera of {self.shape}")
        return row, col

    def _width_ps(self, rows: Pixels, cols: Pixels) -> Floats:
        """(n,), width of a plateau code of each pixel, ps."""
        return np.asarray(self.gain[rows, cols] * self.bin_width_ps)

    def _relative_edges(self, rows: Pixels, cols: Pixels) -> tuple[Floats, Floats]:
        """Code edges (n, codes + 1) and period end (n,) of pixels, plateau widths from code 0.

        The no-photon code takes up the time of a plateau code: nothing says that none passes.
        """
        shared = self.code_widths.copy()
        if self.no_photon_code is not None:
            shared[self.no_photon_code] = 1.0
        widths = relative_widths(
            self.phases[rows, cols],
            shared=shared,
            end_code=self.end_code[rows, cols],
            end_widths=self.end_widths,
            first_live_code=self.first_live_code,
            first_live_width=self.first_live_width[rows, cols],
        )
        return edges_and_end(widths, self.end_code[rows, cols])

    def _folded(self, delay_ps: Floats) -> Floats:
        """Delays moved by whole periods into the one that the codes cover."""
        if self.laser_period_ps is None:
            return delay_ps
        start = self._folded_start()
        return np.asarray(start + np.mod(delay_ps - start, self.laser_period_ps))

    def _folded_start(self) -> float:
        """Least delay that the codes cover, ps."""
        if self.laser_period_ps is None:
            return self.first_edge_ps
        return self.end_delay_ps - (0.0 if self.reversed_codes else self.laser_period_ps)

    def _width_variance(
        self,
        rows: Pixels,
        cols: Pixels,
        delay_ps: Floats,
        anchor_ps: Floats,
    ) -> Floats:
        """(n,), ps^2: error of the time between delay and anchor from errors of code widths."""
        width = self._width_ps(rows, cols)
        response = self.response_std_ps[rows, cols] / width
        # Half a code where no flat told the width: narrow pulses feel the pattern most.
        response = np.where(np.isfinite(response), response, 0.5)
        at_delay = self._code_coordinate(rows, cols, delay_ps)
        at_anchor = self._code_coordinate(rows, cols, anchor_ps)
        misfit = walk_variance(at_delay, at_anchor, self.end_code[rows, cols])
        variance = misfit * self.misfit_std[rows, cols] ** 2
        phase_std = self.phase_std[rows, cols]
        # So many widths have no pattern; their errors add up like a walk from anchor to delay.
        if self.n_phases > MOST_PHASES:
            mean_square = np.mean(phase_std**2, axis=1)
            variance = variance + misfit * mean_square
        elif self.n_phases > 1:
            lever = phase_lever(at_delay, response, self.n_phases)
            # The flat took off what the pattern does at its own place.
            lever = lever - np.nan_to_num(phase_lever(at_anchor, response, self.n_phases))
            variance = variance + np.sum((lever * phase_std) ** 2, axis=1)
        return np.asarray(variance * width**2)

    def _code_coordinate(self, rows: Pixels, cols: Pixels, delay_ps: Floats) -> Floats:
        """(n,), fractional code at a delay, by the widths that all pixels share."""
        shared = np.maximum(self.code_widths, 1e-9)
        edges = np.concatenate([[0.0], np.cumsum(shared)])
        codes = np.arange(self.n_codes + 1.0)
        before_end = np.abs(self.end_delay_ps - delay_ps) / self._width_ps(rows, cols)
        if self.laser_period_ps is None:
            return np.asarray(np.interp(before_end, edges, codes))
        end = np.interp(self.end_code[rows, cols], codes, edges)
        return np.asarray(np.interp(end - before_end, edges, codes))
