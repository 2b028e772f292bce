"""Clocks that come as a table of code edges, from another program's calibration.

- a table per array: `edges_from_table` (LinoSPAD2: 256 pixels x 140 codes, CSV with labels)
- a clock from it: `clock_from_edges`, every code of every pixel with a width of its own
"""

from __future__ import annotations

import csv
import os
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from lightflight import flags
from lightflight.errors import FileFormatError
from lightflight.timing.clock.calibration import TimingCalibration

Floats = NDArray[np.float64]

_LARGEST_TABLE_BYTES = 64 << 20


def edges_from_table(path: str | os.PathLike[str]) -> Floats:
    """Code edges from a CSV table of pixels x codes, first row and column labels.

    A value is the time at which a code ends; the first code starts at zero.

    Returns
    -------
    (pixels, codes + 1), ascending, ps.

    Raises
    ------
    FileFormatError
        If the file is missing, empty, ragged, or its times do not ascend.
    """
    file = Path(path)
    if not file.is_file():
        raise FileFormatError("no such file: give a table of code edges", path=path)
    if file.stat().st_size > _LARGEST_TABLE_BYTES:
        raise FileFormatError("too large for a table of code edges", path=path)
    try:
        with file.open(newline="", encoding="utf-8") as stream:
            rows = [row for row in csv.reader(stream) if row]
        table = np.array([[float(cell) for cell in row[1:]] for row in rows[1:]])
    except (ValueError, UnicodeDecodeError) as error:
        raise FileFormatError(
            f"is not a table of code edges (labels, then numbers): {error}", path=path
        ) from error
    if table.ndim != 2 or table.size == 0:
        raise FileFormatError("holds no table of pixels x codes", path=path)
    if not np.isfinite(table).all() or (np.diff(table, axis=1, prepend=0.0) < 0).any():
        raise FileFormatError("code edges must be finite and ascend from zero", path=path)
    return np.concatenate([np.zeros((len(table), 1)), table], axis=1)


def clock_from_edges(
    edges_ps: ArrayLike,
    *,
    laser_period_ps: float,
    skew_ps: ArrayLike | None = None,
    reversed_codes: bool = False,
    no_photon_code: int | None = None,
) -> TimingCalibration:
    """Clock whose codes lie where a table says.

    A pixel with fewer than two codes of any width was not calibrated: it gets the array's mean
    edges and the flags `dead` and `uncalibrated`. The errors of a table are not known; they
    count as zero.

    Parameters
    ----------
    edges_ps : (rows, cols, codes + 1), ascending times on the clock's own axis (after the sync;
        for a reversed clock, before the next sync), ps.
    laser_period_ps : time after which the codes start again, ps.
    skew_ps : (rows, cols), delay of each pixel, ps; None: zero.
    reversed_codes, no_photon_code : as in `Histograms`.

    Raises
    ------
    ValueError
        For wrong shapes, edges that descend or reach beyond the period.
    """
    edges = np.array(edges_ps, dtype=np.float64)
    if edges.ndim != 3 or edges.shape[2] < 2:
        raise ValueError(f"edges_ps must have shape (rows, cols, codes + 1), got {edges.shape}")
    widths = np.diff(edges, axis=2)
    if not np.isfinite(edges).all() or (widths < 0).any():
        raise ValueError("edges_ps must be finite and must not descend")
    if edges.min() < 0 or edges.max() > laser_period_ps * (1.0 + 1e-9):
        raise ValueError(
            f"edges_ps must lie within one period of {laser_period_ps} ps, got "
            f"{edges.min()} .. {edges.max()}"
        )
    shape, n_codes = edges.shape[:2], widths.shape[2]
    blank = np.count_nonzero(widths > 0, axis=2) < 2
    if blank.all():
        raise ValueError("edges_ps holds no calibrated pixel: every one has one code or none")
    edges[blank] = edges[~blank].mean(axis=0)
    mean_width = laser_period_ps / n_codes
    image = np.zeros(shape)
    words = np.where(blank, flags.DEAD | flags.UNCALIBRATED, 0).astype(np.uint32)
    return TimingCalibration(
        shape=(shape[0], shape[1]), n_codes=n_codes, laser_period_ps=float(laser_period_ps),
        reversed_codes=reversed_codes, no_photon_code=no_photon_code, first_edge_ps=0.0,
        bin_width_ps=mean_width, gain=image + 1.0, phases=np.diff(edges, axis=2) / mean_width,
        # The end counts back from the period: codes that stop short of it leave a gap.
        end_code=n_codes + (laser_period_ps - edges[..., -1]) / mean_width,
        code_widths=np.ones(n_codes), first_live_code=0, first_live_width=image + np.nan,
        end_widths=np.zeros(0), gain_std=image, phase_std=np.zeros((*shape, n_codes)),
        misfit_std=image, skew_ps=image if skew_ps is None else np.asarray(skew_ps, dtype=float),
        skew_std_ps=image, anchor_delay_ps=image + np.nan, response_std_ps=image + np.nan,
        flags=words, period_end_seen=True,
        notes=(f"code edges from a table; {int(blank.sum())} pixels are blank in it",),
    )  # fmt: skip
