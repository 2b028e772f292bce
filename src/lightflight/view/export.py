"""Results in files that other programs open: pictures, tables, scenes.

Takes a Figure or a LightPath, gives a file that appears whole or not at all: `write_figure`, and
`export_path`, which finds the writer by the suffix (`write_csv`, `write_parquet`, `write_mat`,
`write_vtu`, `write_glb`). For arrays in memory see `lightflight.view.arrays`.
"""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING, Any

from lightflight.store import atomic_path
from lightflight.view.export_gltf import write_glb
from lightflight.view.export_tables import SAMPLES, TABLES, write_csv, write_mat, write_parquet
from lightflight.view.export_vtk import write_vtu

__all__ = [
    "EXPORT_SUFFIXES",
    "FIGURE_SUFFIXES",
    "TABLES",
    "export_path",
    "write_csv",
    "write_figure",
    "write_glb",
    "write_mat",
    "write_parquet",
    "write_vtu",
]

if TYPE_CHECKING:
    from matplotlib.figure import Figure

FIGURE_SUFFIXES = (".png", ".pdf", ".svg", ".jpg", ".jpeg", ".tif", ".tiff", ".webp", ".eps")
"""Formats a figure can be written in; pdf, svg and eps are vectors."""

EXPORT_SUFFIXES = (".csv", ".parquet", ".mat", ".vtu", ".glb")
"""Formats a path can be exported to."""

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


def export_path(
    light_path: Any, path: str | os.PathLike[str], *, what: str = "samples", samples: int = SAMPLES
) -> None:
    """Write a path in the format of the file's suffix.

    Parameters
    ----------
    light_path : LightPath.
    what : table for .csv and .parquet: "samples", "pulses" or "vertices".
    samples : points along the path, for tables of samples and .mat.

    Raises
    ------
    ValueError
        For another suffix, table, or fewer than two samples.
    MissingExtraError
        For Parquet without pyarrow.
    """
    target = Path(path)
    match _check_suffix(target, EXPORT_SUFFIXES, "a path"):
        case ".csv":
            write_csv(light_path, target, what=what, samples=samples)
        case ".parquet":
            write_parquet(light_path, target, what=what, samples=samples)
        case ".mat":
            write_mat(light_path, target, samples=samples)
        case ".vtu":
            write_vtu(light_path, target)
        case _:
            write_glb(light_path, target)
