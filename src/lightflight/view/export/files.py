"""Results in files that other programs open: pictures, tables, scenes.

Takes a Figure or a LightPath, gives a file that appears whole or not at all: `write_figure`, and
`export_path`, which finds the writer by the suffix (`write_csv`, `write_parquet`, `write_mat`,
`write_vtu`, `write_glb`). For arrays in memory see `lightflight.view.arrays`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from lightflight.files.whole_file import atomic_path
from lightflight.view.export.gltf import write_glb
from lightflight.view.export.tables import (
    SAMPLES,
    checked_suffix,
    write_csv,
    write_mat,
    write_parquet,
)
from lightflight.view.export.vtk import write_vtu
from lightflight.view.suffixes import EXPORT_SUFFIXES
from lightflight.view.types import FilePath

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from lightflight import LightPath

FIGURE_SUFFIXES = (".png", ".pdf", ".svg", ".jpg", ".jpeg", ".tif", ".tiff", ".webp", ".eps")
"""Formats a figure can be written in; pdf, svg and eps are vectors."""

# Without dates the same figure gives the same bytes.
_METADATA: dict[str, dict[str, Any]] = {
    ".pdf": {"CreationDate": None},
    ".svg": {"Date": None},
}


def write_figure(figure: Figure, path: FilePath, *, dots_per_inch: float | None = None) -> None:
    """Write a figure; the format follows the suffix (png, pdf, svg ...).

    Parameters
    ----------
    figure : Figure
        What to write.
    path : path
        Where to write; the suffix says the format.
    dots_per_inch : float, optional
        Of pixel formats; None: 200.

    Raises
    ------
    ValueError
        For a suffix that is no picture's.
    """
    from lightflight.view.style import figure_style

    target, suffix = checked_suffix(path, FIGURE_SUFFIXES, "a figure ")
    with figure_style(), atomic_path(target) as fresh:
        figure.savefig(
            fresh,
            format=suffix[1:],
            # EPS is a vector format: its own resolution would only scale the page.
            dpi="figure" if dots_per_inch is None and suffix == ".eps" else dots_per_inch or 200.0,
            metadata=_METADATA.get(suffix),
        )


def export_path(
    light_path: LightPath,
    path: FilePath,
    *,
    what: str = "samples",
    samples: int = SAMPLES,
) -> None:
    """Write a path in the format of the file's suffix.

    Parameters
    ----------
    light_path : LightPath
        The path.
    path : path
        Where to write; the suffix says the format.
    what : str, optional
        Table for .csv and .parquet: "samples", "pulses" or "vertices".
    samples : int, optional
        Points along the path, for tables of samples and .mat.

    Raises
    ------
    ValueError
        For another suffix, table, or fewer than two samples.
    MissingExtraError
        For Parquet without pyarrow.
    """
    target, suffix = checked_suffix(path, EXPORT_SUFFIXES, "a path ")
    match suffix:
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
