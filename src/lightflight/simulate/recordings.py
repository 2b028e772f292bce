"""`simulate`: from a scene to what the camera would have written."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any, Literal, overload

import numpy as np
from numpy.typing import ArrayLike, NDArray

from lightflight.arguments import POSITIVE, check_kinds, finite_number, one_of, shown, whole_number
from lightflight.recording.clock_fields import CLOCK_FIELDS
from lightflight.recording.histograms import Histograms
from lightflight.recording.recording import Recording
from lightflight.simulate.crosstalk import Photons, with_crosstalk, with_echoes
from lightflight.simulate.detector import Detector
from lightflight.simulate.light import ExpectedLight, expected_light, segments_from_scene
from lightflight.simulate.photons import Stage, signal_counts
from lightflight.simulate.raw import (
    Block,
    blocks_from_frames,
    check_can_write,
    events_of_block,
    fill_frames,
)
from lightflight.simulate.recorder import Exposure, recorded_counts, uniform_shares
from lightflight.simulate.response import flat_shares
from lightflight.simulate.scene import Scene
from lightflight.simulate.streams import Streams
from lightflight.simulate.truth import Truth
from lightflight.units import std_from_fwhm

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Progress = Callable[[int, int], None]

RECORDING_KINDS = ("histograms", "frames", "events", "code_density", "flat", "dark")

PAPER_PHOTONS_PER_PIXEL = 40_000.0
"""1e-5 photons per pulse and pixel, 20 MHz, 200 s."""

_MOST_PHOTONS = 1e12
"""Centuries of recording; beyond it, counts no longer fit their integers."""

_DEFAULT_PHOTONS = {"code_density": 4e6}
_DEFAULT_OCCUPANCY = {"code_density": 0.6}
_PAPER_OCCUPANCY = 0.04


@overload
def simulate(
    scene: Scene,
    *,
    photons_per_pixel: float | None = ...,
    seed: int = ...,
    kind: Literal["histograms", "code_density", "flat", "dark"] = ...,
    n_frames: int | None = ...,
    flat_arrival_ps: ArrayLike | None = ...,
    frames_out: NDArray[np.uint16] | None = ...,
    threads: int | None = ...,
    progress: Progress | None = ...,
) -> Histograms: ...


@overload
def simulate(
    scene: Scene,
    *,
    photons_per_pixel: float | None = ...,
    seed: int = ...,
    kind: Literal["frames", "events"],
    n_frames: int | None = ...,
    flat_arrival_ps: ArrayLike | None = ...,
    frames_out: NDArray[np.uint16] | None = ...,
    threads: int | None = ...,
    progress: Progress | None = ...,
) -> Recording: ...


@overload
def simulate(
    scene: Scene,
    *,
    photons_per_pixel: float | None = ...,
    seed: int = ...,
    kind: str,
    n_frames: int | None = ...,
    flat_arrival_ps: ArrayLike | None = ...,
    frames_out: NDArray[np.uint16] | None = ...,
    threads: int | None = ...,
    progress: Progress | None = ...,
) -> Histograms | Recording: ...


def simulate(
    scene: Scene,
    *,
    photons_per_pixel: float | None = None,
    seed: int = 0,
    kind: str = "histograms",
    n_frames: int | None = None,
    flat_arrival_ps: ArrayLike | None = None,
    frames_out: NDArray[np.uint16] | None = None,
    threads: int | None = None,
    progress: Progress | None = None,
) -> Histograms | Recording:
    """Draw what the camera of a scene would have written, photon by photon.

    Parameters
    ----------
    scene : Scene
        What is there, what looks on and what catches the light.
    photons_per_pixel : float, optional
        Expected signal counts in the brightest pixel, before any is lost to an earlier photon of
        its frame; 40,000 unless given. For "code_density": mean live counts per pixel (4 million
        unless given). For "flat": expected signal counts of every pixel.
    seed : int, optional
        Any integer >= 0; the same seed gives the same recording on any number of threads.
    kind : str, optional
        What to record:

        - "histograms": the pulse, as counts per pixel and TDC code;
        - "frames": the pulse, as dense frames of codes (2 bytes per pixel and frame);
        - "events": the pulse, as single photons;
        - "code_density": light that knows nothing of the laser (calibrates the codes' widths);
        - "flat": a collimated pulse that reaches all pixels at `flat_arrival_ps` (calibrates
          the pixels' delays);
        - "dark": the laser off: background and dark counts alone.
    n_frames : int, optional
        Frames recorded. None: as many as give 4 % occupancy in the brightest pixel (60 % for
        "code_density"), where the detector has frames.
    flat_arrival_ps : array-like, optional
        When the flat pulse reaches the pixels, on the clock that the recording's arrival times live
        on, ps; one number or (rows, cols). None: the mean arrival time of the scene's light, to 100
        ps; see `truth.flat_arrival_ps`.
    frames_out : array of uint16, optional
        For "frames": where to write them, (n_frames, rows, cols) uint16, e.g. a memory map. It must
        hold `no_photon_code` everywhere. None: new memory.
    threads : int, optional
        How many; the recording does not depend on it.
    progress : callable, optional
        Called now and then with (done, in all), in parts of the recording; for "frames" and
        "events".

    Returns
    -------
    Histograms or Recording
        With `truth`. The width of a code is the nominal one, as a camera would say.

    Raises
    ------
    GeometryError
        Where the camera sees no light of the path.
    ValueError
        For photons, frames or kinds that make no sense.
    """
    check_kinds("scene", scene=scene)
    one_of("kind", kind, RECORDING_KINDS)
    if threads is not None and whole_number("threads", threads) < 1:
        raise ValueError(f"threads must be at least 1, got {shown(threads)}")
    if frames_out is not None and kind != "frames":
        raise ValueError(f'frames_out is for kind="frames", not {kind!r}')
    photons = _checked_photons(photons_per_pixel, kind)
    check_can_write(scene.detector, kind)
    stage = _staged(scene, photons, seed, kind, n_frames)
    if kind == "code_density":
        return _code_density(stage, photons)
    if kind == "flat":
        return _flat(stage, photons, flat_arrival_ps)
    if kind == "frames":
        return _frames(stage, frames_out, threads, progress)
    if kind == "events":
        return _events(stage, threads, progress)
    return _pulse(stage, kind, threads)


# --- preparation ------------------------------------------------------------------------


def _checked_photons(photons_per_pixel: float | None, kind: str) -> float:
    if photons_per_pixel is None:
        return _DEFAULT_PHOTONS.get(kind, PAPER_PHOTONS_PER_PIXEL)
    must = "be positive and finite"
    finite_number("photons_per_pixel", photons_per_pixel, must, low=POSITIVE)
    if photons_per_pixel > _MOST_PHOTONS:
        raise ValueError(
            f"photons_per_pixel must be at most {_MOST_PHOTONS:g}, got {photons_per_pixel:g}"
        )
    return float(photons_per_pixel)


def _checked_frames(
    detector: Detector, photons: float, kind: str, n_frames: int | None
) -> int | None:
    if detector.frame_duration_s is None:
        if n_frames is not None:
            raise ValueError(
                "n_frames was given, but the detector has no frames: set its periods_per_frame"
            )
        return None
    if n_frames is None:
        return math.ceil(photons / _DEFAULT_OCCUPANCY.get(kind, _PAPER_OCCUPANCY))
    if n_frames < 1 or n_frames != int(n_frames):
        raise ValueError(f"n_frames must be a whole number >= 1, got {n_frames}")
    if kind == "code_density" and detector.first_photon_only and photons >= n_frames:
        raise ValueError(
            f"{photons:g} live counts per pixel do not fit into {n_frames} frames, one each: "
            "take more frames"
        )
    return int(n_frames)


def _staged(scene: Scene, photons: float, seed: int, kind: str, n_frames: int | None) -> Stage:
    detector = scene.detector
    streams = Streams(seed)
    frames = _checked_frames(detector, photons, kind, n_frames)
    defects = detector.pixels(scene.shape)
    segments = segments_from_scene(scene)
    relative = expected_light(scene, segments, defects.efficiency)
    scale = photons / float(relative.counts.sum(axis=0).max())
    expected = ExpectedLight(scale * relative.counts, relative.mean_arrival_ps)
    return Stage(
        scene=scene,
        segments=segments,
        expected=expected,
        scale=scale,
        defects=defects,
        streams=streams,
        n_frames=frames,
        clock=detector.clock(scene.shape),
        choice=detector.catch.choice_table(),
    )


def _dark_counts(stage: Stage) -> Floats:
    """(rows, cols), expected dark counts over the recording, with their crosstalk."""
    if stage.n_frames is None:
        return np.zeros(stage.scene.shape)
    assert stage.detector.frame_duration_s is not None
    duration = stage.n_frames * stage.detector.frame_duration_s
    return with_crosstalk(
        stage.defects.dark_rate_hz * duration, stage.detector.crosstalk_probability
    )


def _background_counts(stage: Stage) -> Floats:
    light = np.broadcast_to(np.asarray(stage.scene.background, dtype=float), stage.scene.shape)
    return with_crosstalk(light, stage.detector.crosstalk_probability) + _dark_counts(stage)


# --- kinds ------------------------------------------------------------------------------


def _whole(stage: Stage) -> Block:
    return Block(0, 0, stage.n_frames, 0.0, 1.0)


def _pulse(stage: Stage, kind: str, threads: int | None) -> Histograms:
    counts = _recorded(stage, _whole(stage), lit=kind != "dark", threads=threads)
    return _histograms(stage, counts, _truth(stage, kind, _background_counts(stage)))


def _recorded(stage: Stage, block: Block, *, lit: bool = True, threads: int | None) -> Ints:
    """Counts per pixel and code, (pixels, codes), that one part of the recording holds."""
    clock = stage.clock
    signal = np.zeros((len(clock.width_ps), clock.n_codes + 1), dtype=np.int64)
    if lit:
        signal = signal_counts(stage, block, threads=threads)
    background = block.share * _background_counts(stage).ravel()
    exposure = Exposure(block.n_frames, stage.detector.first_photon_only)
    rng = stage.streams.generator("occupancy", block.number)
    return recorded_counts(signal, background, clock, exposure, rng)


def _frames(
    stage: Stage,
    out: NDArray[np.uint16] | None,
    threads: int | None,
    progress: Progress | None,
) -> Recording:
    """The pulse as dense frames."""
    n_frames, empty = stage.n_frames, stage.detector.no_photon_code
    assert n_frames is not None
    assert empty is not None
    shape = (n_frames, *stage.scene.shape)
    if out is None:
        # zeros cost nothing until they are touched
        out = np.full(shape, empty, np.uint16) if empty else np.zeros(shape, np.uint16)
    elif out.shape != shape or out.dtype != np.uint16:
        raise ValueError(f"frames_out must be uint16 {shape}, got {out.dtype} {out.shape}")
    blocks = list(blocks_from_frames(n_frames, drifts=False))
    for block in blocks:
        assert block.n_frames is not None
        part = out[block.first_frame : block.first_frame + block.n_frames]
        if stage.detector.crosstalk_probability > 0:
            pixel, code, frame = _echoes_in_frames(stage, block, threads)
            row, col = np.divmod(pixel, stage.scene.shape[1])
            part[frame - block.first_frame, row, col] = code
        else:
            counts = _recorded(stage, block, threads=threads)
            fill_frames(part, counts, stage.streams.generator("frame", block.number))
        if progress is not None:
            progress(block.number + 1, len(blocks))
    return Recording(
        stage.scene.shape,
        n_codes=stage.detector.n_codes,
        frames=out,
        truth=_truth(stage, "frames", _background_counts(stage)),
        **clock_settings(stage.detector, n_frames),
    )


def _events(stage: Stage, threads: int | None, progress: Progress | None) -> Recording:
    """The pulse as single photons, frame by frame where there are frames."""
    detector = stage.detector
    blocks = list(blocks_from_frames(stage.n_frames, drifts=detector.drift_ps != 0.0))
    parts: list[tuple[Ints, Ints, Ints | None]] = []
    for block in blocks:
        if detector.crosstalk_probability > 0 and block.n_frames is not None:
            parts.append(_echoes_in_frames(stage, block, threads))
        else:
            parts.append(_photons(stage, block, threads))
        if progress is not None:
            progress(block.number + 1, len(blocks))
    pixel, code = (np.concatenate([part[k] for part in parts]) for k in (0, 1))
    frames = [part[2] for part in parts if part[2] is not None]
    rows, cols = stage.scene.shape
    return Recording.from_events(
        pixel // cols,
        pixel % cols,
        code,
        shape=(rows, cols),
        n_codes=detector.n_codes,
        frame=np.concatenate(frames) if frames else None,
        truth=_truth(stage, "events", _background_counts(stage)),
        **clock_settings(detector, stage.n_frames),
    )


def _photons(stage: Stage, block: Block, threads: int | None) -> tuple[Ints, Ints, Ints | None]:
    """(pixel, code, frame) of each photon that one part of a recording holds."""
    return events_of_block(
        _recorded(stage, block, threads=threads),
        block,
        one_per_frame=stage.detector.first_photon_only,
        rng=stage.streams.generator("frame", block.number),
    )


def _echoes_in_frames(stage: Stage, block: Block, threads: int | None) -> Photons:
    """Photons of one part of a recording, each echo of crosstalk in the frame of its cause."""
    detector = stage.detector
    silent = replace(stage.scene, detector=replace(detector, crosstalk_probability=0.0))
    pixel, code, frame = _photons(replace(stage, scene=silent), block, threads)
    assert frame is not None
    return with_echoes(
        (pixel, code, frame),
        probability=detector.crosstalk_probability,
        clock=stage.clock,
        skew_ps=stage.defects.skew_ps.ravel(),
        shape=stage.scene.shape,
        one_per_frame=detector.first_photon_only,
        rng=stage.streams.generator("crosstalk", block.number),
    )


def _code_density(stage: Stage, photons: float) -> Histograms:
    """Uncorrelated light: the counts of a code are as many as it is wide."""
    clock = stage.clock
    rng = stage.streams.generator("occupancy", 0)
    shares = uniform_shares(clock, np.arange(len(clock.width_ps)))
    live = 1.0 - shares[:, -1]
    dark = _dark_counts(stage).ravel()
    quiet = ~stage.defects.screaming.ravel()
    # With nothing but screaming pixels, those have to tell.
    quiet = quiet if quiet.any() else ~quiet
    wanted = photons / float(np.mean(live[quiet]))
    if stage.exposure.first_photon_only:
        assert stage.n_frames is not None
        # Live codes are a part of the period: all counts together may ask for more than
        # every frame.
        wanted = min(wanted, stage.n_frames * (1.0 - 1e-9))
        light = -stage.n_frames * math.log1p(-wanted / stage.n_frames)
        light = max(light - float(np.mean(dark[quiet])), 0.0)
        raw = light * stage.defects.efficiency.ravel() + dark
        fired = rng.binomial(stage.n_frames, -np.expm1(-raw / stage.n_frames))
    else:
        raw = max(wanted - float(np.mean(dark[quiet])), 0.0) * stage.defects.efficiency.ravel()
        fired = rng.poisson(raw + dark)
    counts = rng.multinomial(fired, shares)[:, :-1]
    nothing = np.zeros_like(stage.expected.counts)
    truth = _truth(stage, "code_density", raw.reshape(stage.scene.shape), signal=nothing)
    return _histograms(stage, counts, truth)


def _flat(stage: Stage, photons: float, flat_arrival_ps: ArrayLike | None) -> Histograms:
    """A pulse that reaches every pixel at a known time; counts drawn per code."""
    scene, detector, clock = stage.scene, stage.detector, stage.clock
    arrival = _flat_arrival(stage, flat_arrival_ps)
    expected = with_crosstalk(
        photons * stage.defects.efficiency, detector.crosstalk_probability
    ).ravel()
    delays = (np.broadcast_to(arrival, scene.shape) + stage.defects.skew_ps).ravel()
    shares = flat_shares(clock, delays, scene.pulse_fwhm_ps, detector)
    rng = stage.streams.generator("number", 0)
    signal = rng.multinomial(rng.poisson(expected), shares).astype(np.int64)
    dark = _dark_counts(stage)
    rng = stage.streams.generator("occupancy", 0)
    counts = recorded_counts(signal, dark.ravel(), clock, stage.exposure, rng)
    light = np.zeros_like(stage.expected.counts)
    light[0] = photons * stage.defects.efficiency
    return _histograms(stage, counts, _truth(stage, "flat", dark, signal=light, flat=arrival))


def _flat_arrival(stage: Stage, given: ArrayLike | None) -> Floats:
    if given is None:
        counts, mean = stage.expected.counts, np.nan_to_num(stage.expected.mean_arrival_ps)
        return np.asarray(100.0 * np.rint(np.average(mean, weights=counts) / 100.0))
    arrival = np.asarray(given, dtype=float)
    if arrival.shape not in ((), stage.scene.shape) or not np.isfinite(arrival).all():
        raise ValueError(
            f"flat_arrival_ps must be one finite time or one per pixel {stage.scene.shape}, "
            f"got shape {arrival.shape}"
        )
    return arrival


# --- results ----------------------------------------------------------------------------


def _truth(
    stage: Stage,
    kind: str,
    background: Floats,
    *,
    signal: Floats | None = None,
    flat: Floats | None = None,
) -> Truth:
    scene, detector = stage.scene, stage.detector
    leg_counts = stage.expected.counts if signal is None else signal
    if kind == "dark":
        leg_counts = np.zeros_like(leg_counts)
    widths = (scene.pulse_fwhm_ps, detector.trigger_jitter_fwhm_ps, detector.response_fwhm_ps)
    return Truth(
        kind=kind,
        seed=stage.streams.seed,
        vertices_mm=scene.flown_mm,
        vertex_times_ps=np.asarray(scene.flown.vertex_times_ps),
        expected_counts=leg_counts.sum(axis=0),
        expected_leg_counts=leg_counts,
        mean_arrival_ps=stage.expected.mean_arrival_ps,
        background_counts=background,
        skew_ps=stage.defects.skew_ps,
        gain=stage.defects.gain,
        phases=stage.defects.phases,
        screaming=stage.defects.screaming,
        pulse_std_ps=std_from_fwhm(math.hypot(*widths)),
        response_mean_ps=detector.response_mean_ps,
        detector=detector,
        flat_arrival_ps=flat,
        forks=scene.forks,
    )


def clock_settings(detector: Detector, n_frames: int | None) -> dict[str, Any]:
    """What a recording says of the clock that wrote it.

    Parameters
    ----------
    detector : Detector
        Its nominal clock.
    n_frames : int or None
        Frames of the recording; None: it has none.

    Returns
    -------
    mapping
        Fields of `Histograms` and `Recording` by name.
    """
    told = {name: getattr(detector, name) for name in CLOCK_FIELDS if name != "n_frames"}
    return {**told, "n_frames": n_frames}


def _histograms(stage: Stage, counts: Ints, truth: Truth) -> Histograms:
    detector = stage.detector
    if detector.no_photon_code is not None:
        assert stage.n_frames is not None
        counts[:, detector.no_photon_code] = stage.n_frames - counts.sum(axis=1)
    kind = np.uint32 if counts.max() <= np.iinfo(np.uint32).max else np.uint64
    return Histograms(
        counts.reshape(*stage.scene.shape, -1).astype(kind),
        truth=truth,
        **clock_settings(detector, stage.n_frames),
    )
