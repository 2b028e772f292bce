"""The [scene] of a set-up file as arguments of `Scene`: mirrors give a path, dust a brightness."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from lightflight.flight import Source
from lightflight.simulate.mirrors import Mirror, dust, vertices_from_mirrors

MIRROR_KEYS = ("source_direction", "mirrors", "exit_length_mm", "most_reflections")
"""Keys of [scene] that stand in place of `vertices_mm`."""

_DUST_KEYS = ("dust_contrast", "dust_correlation_mm", "dust_seed")


def scene_arguments(table: Mapping[str, Any], source: Source) -> dict[str, Any]:
    """Arguments of `Scene` from the keys of [scene]; `vertices_mm` only where there is a path.

    Parameters
    ----------
    table : keys of [scene] as read; those that are no argument of `Scene` are worked out here.
    source : where a path by way of mirrors starts.

    Raises
    ------
    ValueError
        Where the keys do not go together, or a path by way of mirrors lacks one.
    GeometryError
        Where the pulse meets none of the mirrors.
    """
    own = {*MIRROR_KEYS, *_DUST_KEYS, "photons_per_pixel"}
    arguments = {key: value for key, value in table.items() if key not in own}
    if any(key in table for key in MIRROR_KEYS):
        arguments["vertices_mm"] = _vertices(table, source)
    if any(key in table for key in _DUST_KEYS):
        if "brightness" in table:
            raise ValueError("give either brightness or dust_contrast, not both")
        if "dust_contrast" not in table:
            raise ValueError("dust needs dust_contrast: how much the brightness wanders")
        arguments["brightness"] = dust(
            table.get("dust_seed", 0),
            contrast=table["dust_contrast"],
            correlation_mm=table.get("dust_correlation_mm", 10.0),
        )
    return arguments


def _vertices(table: Mapping[str, Any], source: Source) -> Any:
    if "vertices_mm" in table:
        raise ValueError(
            "give either vertices_mm, or source_direction and mirrors: both are a path"
        )
    missing = [key for key in ("source_direction", "exit_length_mm") if key not in table]
    if missing:
        raise ValueError(f"a path by way of mirrors needs {' and '.join(missing)} as well")
    if source.position_mm is None:
        raise ValueError("a path by way of mirrors starts at [source] position_mm: give it")
    mirrors = [_mirror(row) for row in table.get("mirrors", ())]
    return vertices_from_mirrors(
        np.asarray(source.position_mm, dtype=float),
        direction=table["source_direction"],
        mirrors=mirrors,
        exit_length_mm=table["exit_length_mm"],
        most_reflections=table.get("most_reflections", 100),
    )


def _mirror(row: Any) -> Mirror:
    """A mirror from (x, y, z, nx, ny, nz, diameter); diameter 0: no rim."""
    return Mirror(row[:3], row[3:6], diameter_mm=row[6] or None)
