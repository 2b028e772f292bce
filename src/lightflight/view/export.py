"""Results in files that other programs open: pictures and tables.

Takes a Figure or a LightPath, gives a file that appears whole or not at all.
"""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING, Any

from lightflight.store import atomic_path

if TYPE_CHECKING:
    from matplotlib.figure import Figure

FIGURE_SUFFIXES = (".png", ".pdf", ".svg", ".jpg", ".jpeg", ".tif", ".tiff", ".webp", ".eps")
"""Formats a figure can be written in; pdf, svg and eps are vectors."""

SAMPLES = 1000
"""Points along a path in a table, unless asked otherwise."""

# Without dates the same figure gives the same bytes.
_METADATA: dict[str, dict[str, Any]] = {
    ".pdf": {"CreationDate": None},
    ".svg": {"Date": None},
}


def _check_suffix(path: Path, allowed: tuple[str, ...], what: str) -> str:
    suffix = path.suffix.lower()
    if suffix not in allowed:
        raise ValueError(
            f"cannot write {what} to {path.name}: its name must end in {', '.join(allowed)}"
        )
    return suffix


def write_figure(
    figure: Figure, path: str | os.PathLike[str], *, dots_per_inch: float | None = None
) -> None:
    """Write a figure; the format follows the suffix (png, pdf, svg ...).

    Parameters
    ----------
    dots_per_inch : of pixel formats; None: 200.

    Raises
    ------
    ValueError
        For a suffix that is no picture's.
    """
    from lightflight.view.style import figure_style

    target = Path(path)
    suffix = _check_suffix(target, FIGURE_SUFFIXES, "a figure")
    with figure_style(), atomic_path(target) as fresh:
        figure.savefig(
            fresh,
            format=suffix[1:],
            dpi="figure" if dots_per_inch is None and suffix == ".eps" else dots_per_inch or 200.0,
            metadata=_METADATA.get(suffix),
        )


def write_csv(light_path: Any, path: str | os.PathLike[str], *, samples: int = SAMPLES) -> None:
    """Write a path as a table: equal event times, one row per point, a header with units.

    Columns are those of `LightPath.sample`: leg (from 0), x_mm, y_mm, z_mm, event_time_ps,
    arrival_time_ps, their one-sigma errors, and whether the camera sees the point (0 or 1).

    Parameters
    ----------
    light_path : LightPath.
    samples : number of points, at least 2.

    Raises
    ------
    ValueError
        For fewer than two samples, or a name that does not end in .csv.
    """
    target = Path(path)
    _check_suffix(target, (".csv",), "a table")
    from lightflight.path_file import write_path_csv

    write_path_csv(light_path, target, n=samples)
