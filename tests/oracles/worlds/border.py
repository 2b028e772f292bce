"""Where the oracle hands recordings and what is told of them to the package: records only."""

from __future__ import annotations

import math
from functools import lru_cache
from typing import Any

import numpy as np

import lightflight as lf
from lightflight.timing.clock.calibration import TimingCalibration
from lightflight.timing.clock.shared_modes import with_shared_errors
from tests.oracles.worlds.clock import Clock
from tests.oracles.worlds.counts import drawn_counts, even_light, flat_light
from tests.oracles.worlds.view import View
from tests.oracles.worlds.world import World

FLAT_ARRIVAL_PS = 30_000.0


def histograms(counts: np.ndarray, clock: Clock, **metadata: Any) -> lf.Histograms:
    """Counts (rows, cols, codes) with what the camera's data sheet says of the codes."""
    return lf.Histograms(
        counts.astype(np.uint32, copy=False),
        bin_width_ps=clock.width_ps,
        laser_period_ps=clock.period_ps,
        reversed_codes=clock.reversed,
        no_photon_code=clock.no_photon_code,
        **metadata,
    )


def record(world: World, seed: int) -> lf.Histograms | list[lf.Histograms]:
    """One recording of the world, or the list of its repeats."""
    frames = {"n_frames": world.told.n_frames, "periods_per_frame": world.told.periods_per_frame}
    made = [histograms(counts, world.clock, **frames) for counts in drawn_counts(world, seed)]
    return made if world.repeats > 1 else made[0]


@lru_cache(maxsize=64)
def calibrated(
    clock: Clock, shape: tuple[int, int], seed: int = 0, std_ps: float = 70.0, tail: float = 0.0
) -> TimingCalibration:
    """The clock as its own recordings of even light (4 M counts a pixel) and a flat (1 M) tell it;
    a perfect clock is told as it is."""
    if clock.edges_ps is None and clock.skew_ps is None:
        empty = np.zeros((*shape, clock.n_codes), dtype=np.uint32)
        return TimingCalibration.nominal(histograms(empty, clock))
    rng = np.random.default_rng([seed, 5])
    dense = histograms(rng.poisson(even_light(clock, shape, 4e6)), clock)
    pulse = flat_light(clock, shape, 1e6, arrival_ps=FLAT_ARRIVAL_PS, std_ps=std_ps, tail=tail)
    return lf.calibrate_timing(
        dense,
        flat=histograms(rng.poisson(pulse), clock),
        flat_arrival_ps=FLAT_ARRIVAL_PS,
        dead_codes="absorbed",
    )


def camera_record(
    view: View,
    prior_mm: float = 0.0,
    prior_deg: float = 0.0,
    *,
    focal_share: float = 0.0,
    lens: float = 0.0,
) -> lf.Camera:
    """The package's record of a view; OpenCV's u is the column, v the row."""
    pose = np.eye(4)
    pose[:3, :3] = view.axes.T
    pose[:3, 3] = view.centre
    row0, col0 = view.axis()
    matrix = [[view.focal_px[1], 0.0, col0], [0.0, view.focal_px[0], row0], [0.0, 0.0, 1.0]]
    spread = np.repeat([math.radians(prior_deg), prior_mm], 3) ** 2
    covariance = np.diag(spread) if spread.any() else None
    # OpenCV's k1 and k2 are the stretch by r² and r⁴; p1 and p2 are none.
    radial = np.array([*view.lens, 0.0, 0.0]) if any(view.lens) else np.zeros(0)
    return lf.Camera(
        np.array(matrix), radial, pose, view.shape, covariance, focal_std_fraction=focal_share,
        distortion_std=lens,
    )  # fmt: skip


def what_the_user_tells(world: World) -> dict[str, Any]:
    """Keyword arguments of `lf.reconstruct`, from what is told and not from the truth."""
    told, prior = world.told, world.told.prior
    known = math.isfinite(prior.emission_ps)
    source = lf.Source(
        told.source_mm,
        position_std_mm=prior.source_mm,
        emission_time_ps=told.emission_ps if known else None,
        emission_time_std_ps=prior.emission_ps if known else 0.0,
        pulse_fwhm_ps=told.pulse_fwhm_ps,
    )
    return {
        "camera": camera_record(
            told.view,
            prior.position_mm,
            prior.rotation_deg,
            focal_share=prior.focal_share,
            lens=prior.lens,
        ),
        "source": source,
        "medium": lf.Medium(
            told.path_index,
            told.return_index,
            path_group_index_std=prior.index,
            return_group_index_std=prior.index,
        ),
        "timing": with_shared_errors(
            calibrated(told.clock, told.view.shape, std_ps=world.std_ps),
            offset_std_ps=prior.offset_ps,
            scale_std=prior.scale,
        ),
        "n_legs": told.n_legs,
    }
