"""The scene that a set-up describes: mirrors give a path, dust a brightness.

What it does not say is as in the paper's experiment, so that it can be simulated in any case.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lightflight.errors import ConfigError, GeometryError
from lightflight.flight import Source
from lightflight.lab.lab import Lab
from lightflight.simulate.mirrors import Mirror, dust, vertices_from_mirrors
from lightflight.simulate.presets import paper_scene, pf32
from lightflight.simulate.scene import Scene

MIRROR_KEYS = ("source_direction", "mirrors", "exit_length_mm", "most_reflections")
"""Keys of [scene] that stand in place of `vertices_mm`."""

_DUST_KEYS = ("dust_contrast", "dust_correlation_mm", "dust_seed")


def scene_from_lab(lab: Lab) -> Scene:
    """Scene of a set-up; what it does not say is as in the paper's experiment.

    Parameters
    ----------
    lab : Lab
        The set-up.

    Returns
    -------
    Scene
        What `lightflight.simulate` takes.

    Raises
    ------
    ConfigError
        Where there is a path but no camera to see it, or keys that do not go together.
    GeometryError
        Where the pulse meets none of the mirrors.
    """
    try:
        options = scene_arguments(lab.scene, lab.source)
    except GeometryError:  # a ValueError too, but what is wrong is the geometry, not a key
        raise
    except ValueError as problem:
        raise ConfigError(f"[scene] {problem}") from problem
    detector = pf32() if lab.detector is None else lab.detector
    vertices = options.pop("vertices_mm", None)
    if vertices is None:
        if lab.camera is not None:
            options["camera"] = lab.camera
        return paper_scene(detector, medium=lab.medium, **options)
    if lab.camera is None:
        raise ConfigError(
            f"[scene] has a path but nobody to see it: [camera] lacks "
            f"{' and '.join(lab.camera_needs)}"
        )
    return Scene(
        vertices,
        camera=lab.camera,
        source=lab.source,
        medium=lab.medium,
        detector=detector,
        **options,
    )


def resolved_lab(lab: Lab, scene: Scene) -> Lab:
    """Set-up with everything that the scene filled in.

    Parameters
    ----------
    lab : Lab
        The set-up.
    scene : Scene
        What `scene_from_lab` made of it.

    Returns
    -------
    Lab
        Gives the same scene again, whatever the paper's experiment will be by then.
    """
    own = {key: value for key, value in lab.scene.items() if key not in MIRROR_KEYS}
    return replace(
        lab,
        camera=scene.camera,
        source=scene.source,
        medium=scene.medium,
        detector=scene.detector,
        scene={
            **own,
            "vertices_mm": scene.vertices_mm,
            "true_emission_time_ps": scene.emission_time_ps,
        },
        camera_needs=(),
    )


def scene_arguments(table: Mapping[str, Any], source: Source) -> dict[str, Any]:
    """Arguments of `Scene` from the keys of [scene]; `vertices_mm` only where there is a path.

    Parameters
    ----------
    table : mapping of str
        Keys of [scene] as read; those that are no argument of `Scene` are worked out here.
    source : Source
        Where a path by way of mirrors starts.

    Returns
    -------
    dict of str
        Arguments of `lightflight.Scene` by name.

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


def _vertices(table: Mapping[str, Any], source: Source) -> NDArray[np.float64]:
    """Vertices (n, 3), mm, of a path by way of mirrors."""
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


def _mirror(row: Sequence[float]) -> Mirror:
    """A mirror from (x, y, z, nx, ny, nz, diameter); diameter 0: no rim."""
    return Mirror(row[:3], row[3:6], diameter_mm=row[6] or None)
