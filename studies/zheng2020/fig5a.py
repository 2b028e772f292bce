"""Fig. 5(a): error of the angle against the number of arrival times it is taken from."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from studies.zheng2020.angles import (
    ANGLES_DEG,
    COUNTS_OF_TIMES,
    QUICK_ANGLES_DEG,
    QUICK_RECORDINGS,
    RECORDINGS,
    measure_angle,
)
from studies.zheng2020.laboratory import CLOCKS
from studies.zheng2020.work import Unit

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Fig5a:
    """Errors of the angle, mean of |error| over the angles, deg."""

    angles_deg: Floats
    """(a,), true angles."""
    recordings: int
    """Recordings at each angle."""
    counts: NDArray[np.int64]
    """(k,), numbers of arrival times, in the order of flight."""
    single_deg: Mapping[str, Floats]
    """By clock ("delays", "codes"): (k,), error of one recording by the paper's chain."""
    averaged_deg: Mapping[str, Floats]
    """The same after averaging the recordings, as the paper does."""
    estimators: tuple[str, ...]
    """Names of the estimators below, all with every arrival time."""
    estimator_single_deg: Floats
    """(e,), error of one recording."""
    estimator_averaged_deg: Floats
    """(e,), error after averaging."""
    bound_deg: Mapping[str, float]
    """Cramér-Rao bound of one recording as a mean |error|, "known" or "fitted" emission time."""


def units(quick: bool) -> tuple[Unit, ...]:
    """One unit per angle; figures 5(a), 5(b) and 5(c) share them."""
    angles = QUICK_ANGLES_DEG if quick else ANGLES_DEG
    recordings = QUICK_RECORDINGS if quick else RECORDINGS
    return tuple(
        Unit(
            f"angle{angle:+05.1f}x{recordings}",
            measure_angle,
            {"angle_deg": angle, "recordings": recordings},
        )
        for angle in angles
    )


def record_from_results(results: Sequence[Mapping[str, Any]]) -> Fig5a:
    """The figure from the results of `units`."""
    angles = np.array([one["angle_deg"] for one in results])
    names = tuple(results[0]["found_deg"])
    found = {name: np.array([one["found_deg"][name] for one in results]) for name in names}
    few = {kind: np.array([one["few_deg"][kind] for one in results]) for kind in CLOCKS}
    away = angles[:, np.newaxis]
    return Fig5a(
        angles_deg=angles,
        recordings=int(results[0]["recordings"]),
        counts=np.array(COUNTS_OF_TIMES),
        single_deg={k: _mean_size(v - away[..., np.newaxis], (0, 1)) for k, v in few.items()},
        averaged_deg={k: _mean_size(v.mean(axis=1) - away, 0) for k, v in few.items()},
        estimators=names,
        estimator_single_deg=np.array([np.mean(np.abs(found[n] - away)) for n in names]),
        estimator_averaged_deg=np.array(
            [np.mean(np.abs(found[n].mean(axis=1) - angles)) for n in names]
        ),
        bound_deg={
            # mean of |x| of a Gaussian: sqrt(2 / pi) of its standard deviation
            prior: float(np.sqrt(2 / np.pi) * np.mean([one["bound_deg"][prior] for one in results]))
            for prior in ("known", "fitted")
        },
    )


def _mean_size(errors: Floats, axis: int | tuple[int, ...]) -> Floats:
    return np.asarray(np.nanmean(np.abs(errors), axis=axis))
