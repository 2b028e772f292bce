"""Becker & Hickl `.sdt`: images and decays in its data blocks, by the package sdtfile.

The file knows the width of a time bin, not the laser period: the counted sync rate is kept as
a setting, and the period is for the user to state.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lightflight.errors import FileFormatError, optional_package
from lightflight.formats.cubes import record_from_array
from lightflight.formats.isolation import run_isolated
from lightflight.formats.registry import Format
from lightflight.recording.histograms import Histograms
from lightflight.recording.recording import Recording


def read(
    path: Path, clock: Mapping[str, object], *, block: int | None = None
) -> Recording | Histograms:
    """Read one data block.

    Parameters
    ----------
    path : Path
        A Becker & Hickl file.
    clock : mapping of str
        Hints about the clock; the laser period is not in the file.
    block : int, optional
        Number of the block (0, 1 ...), where there are several.

    Returns
    -------
    Recording or Histograms
        Histograms, one pixel for a single decay.

    Raises
    ------
    FileFormatError
        Where the file is damaged, or the block is not clear.
    MissingExtraError
        Without sdtfile.
    """
    arrays, values = run_isolated(f"{__name__}:load", path, {"block": block})
    told = {"bin_width_ps": values.pop("bin_width_ps")}
    return record_from_array(
        arrays["counts"], "yxt", told | dict(clock), path=path, settings=values
    )


def load(
    path: Path, *, block: int | None
) -> tuple[dict[str, NDArray[np.generic]], dict[str, object]]:
    """Counts (rows, cols, codes) and what the headers say; runs in a child process."""
    sdtfile = optional_package(
        "sdtfile", otherwise="reading .sdt needs sdtfile: pip install 'lightflight[readers]'"
    )
    with sdtfile.SdtFile(path) as sdt:
        shapes = [data.shape for data in sdt.data]
        index = _chosen_block(block, shapes)
        data, times = sdt.data[index], sdt.times[index]
        measured = sdt.measure_info[int(sdt.block_headers[index].meas_desc_block_no)]
        if data.ndim not in (1, 2, 3) or data.size == 0 or len(times) < 2:
            raise FileFormatError(f"block {index} has the shape {data.shape}, which is no cube")
        # A single decay is one pixel, a line of them one row.
        counts = data.reshape((1,) * (3 - data.ndim) + data.shape)
        values = {
            "bin_width_ps": float(times[1] - times[0]) * 1e12,
            "module": bytes(measured.mod_type).decode("ascii", "replace").strip("\0 "),
            "block": index,
            "sync_hz_counted": _sync_rate(measured),
        }
    return {"counts": np.ascontiguousarray(counts)}, values


def _chosen_block(block: int | None, shapes: list[tuple[int, ...]]) -> int:
    """Number of the block to read."""
    if not shapes:
        raise FileFormatError("holds no data block")
    if block is None and len(shapes) == 1:
        return 0
    if block is None or block not in range(len(shapes)):
        found = ", ".join(f"{i} {shape}" for i, shape in enumerate(shapes[:8]))
        raise FileFormatError(f"holds the blocks {found}: name one with block=")
    return block


def _sync_rate(measured: Any) -> float | None:
    """Counted rate of the sync, Hz; None where the header has none."""
    try:
        rate = float(measured.StopInfo.min_sync_rate)
    except AttributeError:
        return None
    return rate if rate > 0 else None


def _matches(path: Path, start: bytes) -> bool:
    # B&H set-up files start alike; only measurements say "Data File".
    return b"*IDENTIFICATION" in start[:256] and b"Data File" in start[:512]


FORMATS = (
    Format(
        name="sdt",
        summary="Becker & Hickl .sdt (needs sdtfile)",
        suffixes=(".sdt",),
        matches=_matches,
        read=read,
    ),
)
