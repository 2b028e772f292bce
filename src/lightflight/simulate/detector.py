"""The camera's detector, with every defect as a field that can be switched off.

A `Detector` is a description; it fits any number of pixels. What its random defects are in a
given array follows from its `seed` alone (`pixels`), so that one camera is the same camera in
every recording. Presets: `presets.py`. The numbers of a real camera: a PF32's code-density
recording (design notes, "The camera we model").
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike, NDArray

from lightflight.arguments import (
    POSITIVE,
    finite_number,
    finite_numbers,
    shown,
    whole_number,
    yes_or_no,
)
from lightflight.display import Shown
from lightflight.simulate.clock import TrueClock
from lightflight.simulate.optics import Catch
from lightflight.simulate.streams import Streams
from lightflight.units import std_from_fwhm

Floats = NDArray[np.float64]

_SMALLEST_PHASE = 0.3
"""No code of a drawn clock is narrower than this share of the mean."""

_FULLEST_OCCUPANCY = 1.0 - 1e-6

_NOT_NEGATIVE = (
    "efficiency_rms", "gain_rms", "phase_rms", "skew_range_ps", "response_fwhm_ps",
    "response_tail_ps", "trigger_jitter_fwhm_ps", "dark_rate_hz", "dark_rate_spread",
    "afterpulse_time_ps",
)  # fmt: skip
_SHARES = (
    "dead_pixel_fraction", "response_tail_fraction", "screaming_fraction",
    "crosstalk_probability", "afterpulse_probability",
)  # fmt: skip


@dataclass(frozen=True, eq=False, repr=False)
class PixelDefects(Shown):
    """What each pixel of one array is; every array (rows, cols).

    Attributes
    ----------
    gain : array of float
        Width of the pixel's plateau code over that of the camera.
    phases : array of float, shape (rows, cols, n_phases)
        Relative widths of the codes modulo n_phases; mean 1.
    skew_ps : array of float
        The pixel's own delay: what it adds to every arrival time, ps.
    efficiency : array of float
        Relative sensitivity; the best pixel has 1, a dead one 0.
    dark_rate_hz : array of float
        Dark counts per second, before any is lost; ps-uniform.
    screaming : array of bool
        True for pixels that fire in most frames, light or no light.
    """

    gain: Floats

    phases: Floats

    skew_ps: Floats

    efficiency: Floats

    dark_rate_hz: Floats

    screaming: NDArray[np.bool_]


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class Detector(Shown):
    """A SPAD array (or streak camera) with its lens blur and its clock.

    The defaults describe a clean clock of 55 ps codes; see `presets` for real cameras.

    Attributes
    ----------
    seed : int
        Which camera of its kind: decides all random defects of the pixels.
    psf_std_px : float
        Standard deviation of the lens blur (Gaussian), pixel.
    active_width_px : float
        Width of a pixel's square active area over the pitch (PF32: 6.1 of 50 um, 1.5 %).
    efficiency_rms : float
        Relative spread of the pixels' sensitivity. 0: all alike.
    dead_pixel_fraction : float
        Share of pixels that never see light.
    n_codes : int
        Number of TDC codes.
    bin_width_ps : float
        Nominal width of a code, as the data sheet says and recordings carry it; ps.
    code_width_ps : float or None
        True mean width of a plateau code, ps. None: nominal.
    laser_period_ps : float or None
        Period of the laser, ps. None: a single sweep (streak camera).
    reversed_codes : bool
        True: photon starts, sync stops; a larger code is an earlier photon.
    first_edge_ps : float
        Interval at which the clock's first code starts, ps (the gate of a gated camera).
    no_photon_code : int or None
        Code written for "no photon in this frame". None: only photons are written.
    first_live_code : int
        Codes below never occur.
    start_code_widths : tuple of float
        Relative widths of the first live codes (PF32: the first is 1.8 codes wide).
    dead_time_is_lost : bool
        True: photons in the time of the dead codes are lost. False: live codes absorb it.
    gain_rms : float
        Relative spread of the pixels' code width. 0: all alike.
    phase_pattern : tuple of float
        Differential non-linearity shared by all pixels: relative widths of the codes modulo the
        length of this tuple; scaled to mean 1.
    phase_rms : float
        Relative spread of a pixel's own widths about the pattern. 0: the pattern alone. A pattern
        of one width has no phases to spread.
    skew_range_ps : float
        Pixel delays are uniform in +- this, ps. 0: none.
    drift_ps : float
        Change of all delays from the start of a recording to its end (linear, mean 0), ps.
    response_fwhm_ps : float
        Full width at half maximum of the detector's jitter (Gaussian), ps.
    response_tail_fraction : float
        Share of photons that are late by an exponential time (diffusion tail).
    response_tail_ps : float
        Mean of that exponential, ps.
    trigger_jitter_fwhm_ps : float
        Jitter of the laser trigger against the light (Gaussian), ps.
    periods_per_frame : int or None
        Laser periods in one frame. None: the detector has no frames.
    first_photon_only : bool
        True: a pixel records only the first photon of each frame.
    dark_rate_hz : float
        Median dark count rate of a pixel, 1/s.
    dark_rate_spread : float
        Spread of ln(dark rate) between pixels (log-normal).
    screaming_fraction : float
        Share of pixels that scream; the number is rounded, the places random.
    screaming_occupancy : (float, float)
        Least and greatest share of frames in which a screaming pixel fires.
    crosstalk_probability : float
        Chance that a detected photon fires one of the four neighbours at the same moment.
    afterpulse_probability : float
        Chance that a detection is followed by another in the same pixel.
    afterpulse_time_ps : float
        Mean delay of an afterpulse (exponential), ps. With `first_photon_only` an afterpulse falls
        into its parent's frame and is never recorded.
    gain_map : ArrayLike or None
        (rows, cols), takes the place of `gain_rms`.
    phase_map : ArrayLike or None
        (rows, cols, n_phases), takes the place of `phase_pattern` and `phase_rms`.
    skew_map_ps : ArrayLike or None
        (rows, cols), ps, takes the place of `skew_range_ps`.
    screaming_map : ArrayLike or None
        (rows, cols) of bool, takes the place of `screaming_fraction`.
    efficiency_map : ArrayLike or None
        (rows, cols), relative sensitivities, in place of `efficiency_rms` and dead pixels.
    """

    seed: int = 0

    # --- catching light ---

    psf_std_px: float = 0.35

    active_width_px: float = 6.1 / 50.0

    efficiency_rms: float = 0.0

    dead_pixel_fraction: float = 0.0

    # --- the clock ---

    n_codes: int = 909

    bin_width_ps: float = 55.0

    code_width_ps: float | None = None

    laser_period_ps: float | None = 50_000.0

    reversed_codes: bool = False

    first_edge_ps: float = 0.0

    no_photon_code: int | None = None

    first_live_code: int = 0

    start_code_widths: tuple[float, ...] = ()

    dead_time_is_lost: bool = False

    gain_rms: float = 0.0

    phase_pattern: tuple[float, ...] = (1.0,)

    phase_rms: float = 0.0

    skew_range_ps: float = 0.0

    drift_ps: float = 0.0

    # --- response ---

    response_fwhm_ps: float = 150.0

    response_tail_fraction: float = 0.0

    response_tail_ps: float = 0.0

    trigger_jitter_fwhm_ps: float = 0.0

    # --- counts that are not signal, and lost counts ---

    periods_per_frame: int | None = None

    first_photon_only: bool = False

    dark_rate_hz: float = 0.0

    dark_rate_spread: float = 0.0

    screaming_fraction: float = 0.0

    screaming_occupancy: tuple[float, float] = (0.6, 1.0)

    crosstalk_probability: float = 0.0

    afterpulse_probability: float = 0.0

    afterpulse_time_ps: float = 30_000.0

    # --- measured maps in place of drawn ones ---

    gain_map: ArrayLike | None = field(default=None, repr=False)

    phase_map: ArrayLike | None = field(default=None, repr=False)

    skew_map_ps: ArrayLike | None = field(default=None, repr=False)

    screaming_map: ArrayLike | None = field(default=None, repr=False)

    efficiency_map: ArrayLike | None = field(default=None, repr=False)

    def __post_init__(self) -> None:
        Streams(self.seed)
        _check_numbers(self)
        _check_clock(self)
        _check_frames(self)

    # --- derived ---

    @property
    def catch(self) -> Catch:
        """Lens blur and active area together."""
        return Catch(self.psf_std_px, self.active_width_px)

    @property
    def true_code_width_ps(self) -> float:
        """Mean width of a plateau code, ps."""
        return self.bin_width_ps if self.code_width_ps is None else self.code_width_ps

    @property
    def frame_duration_s(self) -> float | None:
        """Length of one frame, s; None where there are no frames."""
        if self.periods_per_frame is None or self.laser_period_ps is None:
            return None
        return self.periods_per_frame * self.laser_period_ps * 1e-12

    @property
    def response_std_ps(self) -> float:
        """Standard deviation of the Gaussian part of the response, ps."""
        return std_from_fwhm(self.response_fwhm_ps)

    @property
    def response_mean_ps(self) -> float:
        """Mean lateness of the response (its exponential tail), ps."""
        return self.response_tail_fraction * self.response_tail_ps

    def pixels(self, shape: tuple[int, int]) -> PixelDefects:
        """The defects of every pixel of an array of this shape; the same at every call.

        Parameters
        ----------
        shape : (int, int)
            (rows, cols).

        Returns
        -------
        PixelDefects
            Drawn from `seed`, or as the maps say.

        Raises
        ------
        ValueError
            Where a map is of another shape, or holds what it must not.
        """
        streams = Streams(self.seed)
        dark_rate_hz, screaming = _dark(self, shape, streams)
        return PixelDefects(
            gain=_gain(self, shape, streams),
            phases=_phases(self, shape, streams),
            skew_ps=_skew(self, shape, streams),
            efficiency=_efficiency(self, shape, streams),
            dark_rate_hz=dark_rate_hz,
            screaming=screaming,
        )

    def clock(self, shape: tuple[int, int]) -> TrueClock:
        """The true clock of every pixel of an array of this shape.

        Parameters
        ----------
        shape : (int, int)
            (rows, cols).

        Returns
        -------
        TrueClock
            Its pixels are numbered row by row.
        """
        defects = self.pixels(shape)
        n_pixels = shape[0] * shape[1]
        return TrueClock(
            n_codes=self.n_codes,
            laser_period_ps=self.laser_period_ps,
            reversed_codes=self.reversed_codes,
            first_edge_ps=self.first_edge_ps,
            first_live_code=self.first_live_code,
            width_ps=self.true_code_width_ps * defects.gain.reshape(n_pixels),
            phases=defects.phases.reshape(n_pixels, -1),
            start_widths=np.asarray(self.start_code_widths, dtype=float),
            dead_time_is_lost=self.dead_time_is_lost,
        )

    def true_code_intervals_ps(self, shape: tuple[int, int]) -> tuple[Floats, Floats]:
        """True delay interval of every code.

        Parameters
        ----------
        shape : (int, int)
            (rows, cols).

        Returns
        -------
        lower, upper : array of float, shape (rows, cols, codes)
            Delay after the laser sync, the pixel's own delay in it, not folded, ps. Dead codes and
            codes beyond the end of the period have zero width.
        """
        lower, upper = self.clock(shape).intervals_ps(np.arange(shape[0] * shape[1]))
        return lower.reshape(*shape, -1), upper.reshape(*shape, -1)


# --- the defects of one array -----------------------------------------------------------


def _given_map(
    name: str, given: ArrayLike, shape: tuple[int, int], *, extra: int = 0, positive: bool = False
) -> Floats:
    """A map that the user gave, (rows, cols) and `extra` more axes."""
    values = np.array(given, dtype=float)
    if values.shape[:2] != shape or values.ndim != 2 + extra:
        raise ValueError(
            f"{name} has shape {values.shape} but the camera has {shape} pixels: give one value "
            + ("and all code widths per pixel" if extra else "per pixel")
        )
    if not np.isfinite(values).all():
        raise ValueError(f"{name} holds NaN or inf: give finite values")
    if positive and not (values > 0).all():
        raise ValueError(f"{name} must be positive: it holds widths")
    return values


def _gain(detector: Detector, shape: tuple[int, int], streams: Streams) -> Floats:
    if detector.gain_map is not None:
        return _given_map("gain_map", detector.gain_map, shape, positive=True)
    spread = streams.generator("gain").standard_normal(shape)
    return np.maximum(1.0 + detector.gain_rms * np.clip(spread, -5.0, 5.0), _SMALLEST_PHASE)


def _phases(detector: Detector, shape: tuple[int, int], streams: Streams) -> Floats:
    if detector.phase_map is not None:
        phases = _given_map("phase_map", detector.phase_map, shape, extra=1, positive=True)
        return np.asarray(phases / phases.mean(axis=-1, keepdims=True))
    pattern = np.asarray(detector.phase_pattern, dtype=float)
    own = streams.generator("phase").standard_normal((*shape, len(pattern)))
    # scaling to mean 1 takes one of n degrees of freedom: give it back beforehand
    spread = detector.phase_rms * np.sqrt(len(pattern) / max(len(pattern) - 1, 1))
    phases = np.maximum(pattern / pattern.mean() + spread * own, _SMALLEST_PHASE)
    return np.asarray(phases / phases.mean(axis=-1, keepdims=True))


def _skew(detector: Detector, shape: tuple[int, int], streams: Streams) -> Floats:
    if detector.skew_map_ps is not None:
        return _given_map("skew_map_ps", detector.skew_map_ps, shape)
    return detector.skew_range_ps * streams.generator("skew").uniform(-1.0, 1.0, shape)


def _efficiency(detector: Detector, shape: tuple[int, int], streams: Streams) -> Floats:
    if detector.efficiency_map is not None:
        efficiency = _given_map("efficiency_map", detector.efficiency_map, shape)
        if (efficiency < 0).any() or not (efficiency > 0).any():
            raise ValueError("efficiency_map must be >= 0, and above 0 somewhere")
        return np.asarray(efficiency / efficiency.max())
    spread = streams.generator("sensitivity").standard_normal(shape)
    # Never blind by chance: dead pixels are a defect of their own.
    efficiency = np.maximum(1.0 + detector.efficiency_rms * spread, 0.05)
    n_dead = round(detector.dead_pixel_fraction * efficiency.size)
    dead = streams.generator("dead").permutation(efficiency.size)[:n_dead]
    efficiency.ravel()[dead] = 0.0
    scaled: Floats = efficiency / efficiency.max()
    return scaled


def _dark(
    detector: Detector, shape: tuple[int, int], streams: Streams
) -> tuple[Floats, NDArray[np.bool_]]:
    """Dark count rates, (rows, cols), 1/s, and which pixels scream."""
    spread = streams.generator("dark_rate").standard_normal(shape)
    rate = detector.dark_rate_hz * np.exp(detector.dark_rate_spread * spread)
    rng = streams.generator("screaming")
    order = rng.permutation(rate.size)
    # most of a real camera's screaming pixels fire in nearly every frame
    quietness = (1.0 - rng.random(rate.size)) ** 2.5
    if detector.screaming_map is not None:
        screaming = _given_map("screaming_map", detector.screaming_map, shape).astype(bool)
    else:
        screaming = np.zeros(rate.size, dtype=bool)
        screaming[order[: round(detector.screaming_fraction * rate.size)]] = True
        screaming = screaming.reshape(shape)
    if screaming.any():
        low, high = detector.screaming_occupancy
        occupancy = np.minimum(high - (high - low) * quietness, _FULLEST_OCCUPANCY).reshape(shape)
        assert detector.frame_duration_s is not None
        # The rate of which this share of frames holds at least one count.
        rate[screaming] = -np.log1p(-occupancy[screaming]) / detector.frame_duration_s
    return rate, screaming


# --- checks -----------------------------------------------------------------------------


def _check_numbers(detector: Detector) -> None:
    for name in _NOT_NEGATIVE:
        finite_number(name, getattr(detector, name), "be finite and >= 0", low=0.0)
    for name in _SHARES:
        must = "lie between 0 and 1"
        finite_number(name, getattr(detector, name), must, low=0.0, high=1.0)
    for name in ("first_edge_ps", "drift_ps"):
        finite_number(name, getattr(detector, name))
    must = "lie between 0.05 and 20 pixels"
    finite_number("psf_std_px", detector.psf_std_px, must, low=0.05, high=20.0)
    must = "lie above 0 and not above 1"
    finite_number("active_width_px", detector.active_width_px, must, low=POSITIVE, high=1.0)
    name, must = "screaming_occupancy", "be two shares of frames, low then high"
    told = detector.screaming_occupancy
    low, high = finite_numbers(name, told, must, shapes=[(2,)], low=POSITIVE, high=1.0)
    if low > high:
        raise ValueError(f"{name} must {must}, got {told}")


def _check_positive(name: str, value: float | None) -> None:
    if value is not None:
        finite_number(name, value, "be positive and finite", low=POSITIVE)


def _checked_widths(name: str, widths: Sequence[float]) -> tuple[float, ...]:
    values = finite_numbers(name, widths, "hold positive widths", low=POSITIVE)
    if values.ndim != 1:
        raise ValueError(f"{name} must hold positive widths, got {shown(widths)}")
    return tuple(values.tolist())


def _check_clock(detector: Detector) -> None:
    _check_positive("bin_width_ps", detector.bin_width_ps)
    _check_positive("code_width_ps", detector.code_width_ps)
    _check_positive("laser_period_ps", detector.laser_period_ps)
    if not 1 <= whole_number("n_codes", detector.n_codes) <= 1 << 16:
        raise ValueError(f"n_codes must lie between 1 and 65536, got {detector.n_codes}")
    pattern = _checked_widths("phase_pattern", detector.phase_pattern)
    if not pattern:
        raise ValueError("phase_pattern must hold at least one width; (1.0,) is an even clock")
    object.__setattr__(detector, "phase_pattern", pattern)
    starts = _checked_widths("start_code_widths", detector.start_code_widths)
    object.__setattr__(detector, "start_code_widths", starts)
    if not 0 <= whole_number("first_live_code", detector.first_live_code) < detector.n_codes:
        raise ValueError(
            f"first_live_code must be one of the {detector.n_codes} codes, "
            f"got {detector.first_live_code}"
        )
    for name in ("reversed_codes", "first_photon_only"):
        yes_or_no(name, getattr(detector, name))
    if detector.reversed_codes and detector.laser_period_ps is None:
        raise ValueError(
            "reversed_codes=True needs laser_period_ps: the next pulse stops the clock"
        )
    code = detector.no_photon_code
    if (
        code is not None
        and not 0 <= whole_number("no_photon_code", code) < detector.first_live_code
    ):
        raise ValueError(
            f"no_photon_code must lie below first_live_code = {detector.first_live_code}, got "
            f"{code}: it cannot be a code that photons get"
        )


def _check_frames(detector: Detector) -> None:
    _check_positive("periods_per_frame", detector.periods_per_frame)
    if detector.frame_duration_s is not None:
        return
    needs = {
        "first_photon_only": detector.first_photon_only,
        "dark_rate_hz": detector.dark_rate_hz > 0,
        "screaming_fraction": detector.screaming_fraction > 0,
        "screaming_map": detector.screaming_map is not None,
        "no_photon_code": detector.no_photon_code is not None,
    }
    for name, needed in needs.items():
        if needed:
            raise ValueError(
                f"{name} needs frames: give periods_per_frame and laser_period_ps as well"
            )
