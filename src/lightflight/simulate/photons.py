"""Photons: each drawn with its own place, moment, pixel and delay, then read by the clock.

Takes the segments of `light.py`, gives counts per pixel and code. Photons come in chunks whose
random streams depend on the seed and the chunk's number only.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lightflight.simulate.clock import LOST, TrueClock
from lightflight.simulate.crosstalk import neighbours_of
from lightflight.simulate.detector import Detector, PixelDefects
from lightflight.simulate.light import (
    ExpectedLight,
    Segments,
    arrival_at,
    beam_std_mm,
    caught_strength,
    leg_frames,
    points_on_path,
)
from lightflight.simulate.raw import Block
from lightflight.simulate.recorder import Exposure
from lightflight.simulate.scene import Scene
from lightflight.simulate.streams import Streams
from lightflight.units import std_from_fwhm

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

_CHUNK_PHOTONS = 1 << 17
_MOST_THREADS = 8


@dataclass(frozen=True, eq=False)
class Stage:
    """A scene worked out: what every kind of recording is made from.

    Attributes
    ----------
    scene : Scene
        What is there, what looks on and what catches the light.
    segments : Segments
        The path in short pieces.
    expected : ExpectedLight
        Scaled: counts.
    scale : float
        Expected counts per unit of relative light.
    defects : PixelDefects
        What each pixel of the scene's camera is.
    streams : Streams
        Random streams of the recording.
    n_frames : int or None
        Frames of the recording; None: the detector has none.
    clock : TrueClock
        Reads photons; its pixels are numbered row by row.
    choice : array of float
        Table from `Catch.choice_table`.
    """

    scene: Scene
    segments: Segments
    expected: ExpectedLight
    scale: float
    defects: PixelDefects
    streams: Streams
    n_frames: int | None
    clock: TrueClock
    choice: Floats

    @property
    def detector(self) -> Detector:
        """The scene's detector."""
        return self.scene.detector

    @property
    def exposure(self) -> Exposure:
        """Frames, and what they lose."""
        return Exposure(self.n_frames, self.detector.first_photon_only)


def signal_counts(stage: Stage, block: Block, *, threads: int | None = None) -> Ints:
    """Signal per pixel and code.

    Parameters
    ----------
    stage : Stage
        What photons are drawn from.
    block : Block
        The part of the recording.
    threads : int, optional
        How many; the result does not depend on it. None: as many as there are processors.

    Returns
    -------
    array of int, shape (pixels, codes + 1)
        The last column holds photons with no code.
    """
    n_slots = stage.clock.n_codes + 1
    counts = np.zeros(stage.defects.skew_ps.size * n_slots, dtype=np.int64)
    light = caught_strength(stage.scene, stage.segments, stage.detector.catch)
    expected = stage.scale * block.share * light
    numbers = stage.streams.generator("number", block.number).poisson(expected)
    workers = min(threads or os.cpu_count() or 1, _MOST_THREADS)
    with ThreadPoolExecutor(max_workers=max(1, workers)) as pool:
        for places in pool.map(lambda part: _draw_chunk(stage, block, *part), _chunks(numbers)):
            np.add.at(counts, places, 1)
    return counts.reshape(-1, n_slots)


def _chunks(numbers: Ints) -> Iterator[tuple[int, Ints]]:
    """(number of the chunk, segment of each of its photons), `_CHUNK_PHOTONS` at a time."""
    ends = np.cumsum(numbers)
    total = int(ends[-1]) if len(ends) else 0
    for chunk, first in enumerate(range(0, total, _CHUNK_PHOTONS)):
        last = min(first + _CHUNK_PHOTONS, total)
        low = int(np.searchsorted(ends, first, side="right"))
        high = int(np.searchsorted(ends, last, side="left")) + 1
        inside = np.minimum(ends[low:high], last) - np.maximum(
            ends[low:high] - numbers[low:high], first
        )
        yield chunk, np.repeat(np.arange(low, high), inside)


def _draw_chunk(stage: Stage, block: Block, chunk: int, segment: Ints) -> Ints:
    """Place in the flat (pixel, code) table of each photon of a chunk."""
    # Streams are named by the chunk, not by who draws first: any number of threads draws the same.
    key = (block.number, chunk)
    row, col, arrival, segment = _emitted(stage, key, segment)
    pixel = _caught(stage, key, row, col)
    if (stage.defects.efficiency < 1.0).any():
        sensitivity = stage.defects.efficiency.ravel()[pixel]
        draw = stage.streams.generator("efficiency", *key).random(len(pixel))
        felt = draw < sensitivity
        pixel, arrival = pixel[felt], arrival[felt]
    arrival = arrival + delay_noise(
        stage.detector, stage.scene.pulse_fwhm_ps, stage.streams, key, len(pixel)
    )
    pixel, arrival = _with_echoes(stage, key, pixel, arrival)
    delay = arrival + stage.defects.skew_ps.ravel()[pixel]
    if stage.detector.drift_ps:
        generator = stage.streams.generator("drift", *key)
        moment = generator.uniform(block.start, block.end, len(pixel))
        delay += stage.detector.drift_ps * (moment - 0.5)
    code = stage.clock.codes_from_delays(pixel, delay)
    code[code == LOST] = stage.clock.n_codes
    return pixel * (stage.clock.n_codes + 1) + code


def _emitted(
    stage: Stage, key: tuple[int, int], segment: Ints
) -> tuple[Floats, Floats, Floats, Ints]:
    """(row, col, arrival time, segment) of each photon: where it comes from, seen by the camera."""
    parts = stage.segments
    place = stage.streams.generator("position", *key).random(len(segment))
    std = beam_std_mm(stage.scene)
    if std == 0.0:
        return (
            parts.row[segment] + place * parts.row_step[segment],
            parts.col[segment] + place * parts.col_step[segment],
            parts.arrival_ps[segment] + place * parts.arrival_step_ps[segment],
            segment,
        )
    return _emitted_from_beam(stage, key, segment, place)


def _emitted_from_beam(
    stage: Stage, key: tuple[int, int], segment: Ints, place: Floats
) -> tuple[Floats, Floats, Floats, Ints]:
    """As `_emitted`, for a beam with a diameter: off axis, and only the share that is caught."""
    scene, parts = stage.scene, stage.segments
    rng = stage.streams.generator("beam", *key)
    length = parts.length_mm[segment] + (place - 0.5) * parts.size_mm[segment]
    points = points_on_path(scene, parts.leg[segment], length)
    for frame in leg_frames(scene):
        offset = beam_std_mm(scene) * rng.standard_normal(len(segment))
        points += offset[:, np.newaxis] * frame[parts.leg[segment]]
    row, col = scene.camera.pixels_from_points(points)
    caught = stage.detector.catch.caught_fraction(row, scene.shape[0])
    caught *= stage.detector.catch.caught_fraction(col, scene.shape[1])
    # Drawn from an upper bound: this share of them was caught indeed.
    kept = rng.random(len(segment)) * stage.detector.catch.most_caught**2 < caught
    arrival = arrival_at(scene, points[kept], length[kept])
    return row[kept], col[kept], arrival, segment[kept]


def _caught(stage: Stage, key: tuple[int, int], row: Floats, col: Floats) -> Ints:
    """The pixel that caught each photon; (n,), numbered row by row."""
    rows, cols = stage.scene.shape
    uniform = stage.streams.generator("row", *key).random(len(row))
    pixel = stage.detector.catch.draw_pixels(row, rows, table=stage.choice, uniform=uniform) * cols
    uniform = stage.streams.generator("col", *key).random(len(col))
    pixel += stage.detector.catch.draw_pixels(col, cols, table=stage.choice, uniform=uniform)
    return pixel


def delay_noise(
    detector: Detector, pulse_fwhm_ps: float, streams: Streams, key: tuple[int, int], n: int
) -> Floats:
    """What pulse, trigger and response add to each photon's arrival time.

    Parameters
    ----------
    detector : Detector
        Trigger jitter, response and its tail.
    pulse_fwhm_ps : float
        Full width at half maximum of the laser pulse, ps.
    streams : Streams
        Random streams of the recording.
    key : (int, int)
        Number of the part of the recording, and of the chunk.
    n : int
        Photons.

    Returns
    -------
    array of float, shape (n,)
        ps; its mean is `detector.response_mean_ps`.
    """
    noise = np.zeros(n)
    widths = {
        "pulse": pulse_fwhm_ps,
        "trigger": detector.trigger_jitter_fwhm_ps,
        "response": detector.response_fwhm_ps,
    }
    for component, fwhm in widths.items():
        if fwhm > 0:
            draw = streams.generator(component, *key).standard_normal(n)
            draw *= std_from_fwhm(fwhm)
            noise += draw
    if detector.response_mean_ps > 0:
        rng = streams.generator("tail", *key)
        late = rng.random(n) < detector.response_tail_fraction
        noise[late] += rng.exponential(detector.response_tail_ps, int(late.sum()))
    return noise


def _with_echoes(
    stage: Stage, key: tuple[int, int], pixel: Ints, arrival: Floats
) -> tuple[Ints, Floats]:
    """The photons, followed by the crosstalk and the afterpulses they cause."""
    detector = stage.detector
    if detector.crosstalk_probability > 0:
        rng = stage.streams.generator("crosstalk", *key)
        causes = np.flatnonzero(rng.random(len(pixel)) < detector.crosstalk_probability)
        # The echo takes its cause's moment, and its own pixel's delay and clock.
        neighbour, inside = neighbours_of(
            pixel[causes], rng.integers(0, 4, len(causes)), stage.scene.shape
        )
        pixel = np.concatenate((pixel, neighbour[inside]))
        arrival = np.concatenate((arrival, arrival[causes][inside]))
    # An afterpulse falls into its parent's frame, whose first photon is its parent.
    if detector.afterpulse_probability > 0 and not detector.first_photon_only:
        rng = stage.streams.generator("afterpulse", *key)
        causes = np.flatnonzero(rng.random(len(pixel)) < detector.afterpulse_probability)
        late = rng.exponential(detector.afterpulse_time_ps, len(causes))
        pixel = np.concatenate((pixel, pixel[causes]))
        arrival = np.concatenate((arrival, arrival[causes] + late))
    return pixel, arrival
