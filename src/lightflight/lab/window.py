"""[window] and [medium] of a set-up: what the camera looks through, and what fills the scene."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from lightflight.camera.model import Camera
from lightflight.camera.refraction import Interface, scene_medium, window
from lightflight.camera.stored import interface_of_row, row_of_interface
from lightflight.flight import Medium
from lightflight.materials import AIR, Material

_BY_ROWS = {"interfaces", "front_indices"}


def camera_behind(camera: Camera, table: Mapping[str, Any]) -> Camera:
    """The camera with the window of a set-up before it.

    Parameters
    ----------
    camera : Camera
        Without it.
    table : mapping of str
        [window].

    Returns
    -------
    Camera
        Itself where the table is empty.

    Raises
    ------
    ValueError
        For keys that are missing or do not go together.
    """
    if not table:
        return camera
    front = Material(*table["front_indices"]) if "front_indices" in table else AIR
    if "interfaces" in table:
        stray = sorted(set(table) - _BY_ROWS)
        if stray:
            raise ValueError(f"give either interfaces or {', '.join(stray)}, not both")
        rows = np.asarray(table["interfaces"], dtype=float)
        return replace(camera, interfaces=tuple(map(interface_of_row, rows)), stands_in=front)
    if "distance_mm" not in table:
        raise ValueError("distance_mm is missing: how far the window stands from the camera, mm")
    normal = table.get("normal", camera.backward_axis)
    point = camera.center_mm - table["distance_mm"] * camera.backward_axis
    std = table.get("distance_std_mm", 0.0)
    behind = material_of(table, "behind") or AIR
    glass = material_of(table, "glass")
    if glass is None:
        if "thickness_mm" in table:
            raise ValueError("thickness_mm needs glass (or glass_indices): what the window is of")
        faces: tuple[Interface, ...] = (Interface(point, normal, behind, distance_std_mm=std),)
    elif "thickness_mm" not in table:
        raise ValueError("glass needs thickness_mm: how thick the window is")
    else:
        # Across the window towards the camera, whichever way it was told.
        towards = np.asarray(normal) * (1.0 if camera.backward_axis @ normal > 0 else -1.0)
        faces = window(
            point, towards, thickness_mm=table["thickness_mm"], glass=glass, beyond=behind,
            distance_std_mm=std,
        )  # fmt: skip
    return replace(camera, interfaces=faces, stands_in=front)


def material_of(table: Mapping[str, Any], key: str) -> Material | None:
    """A material by its name or by both of its indices; None: not told.

    Parameters
    ----------
    table : mapping of str
        A section with `key`, and the colour, or with `key`_indices.
    key : str
        What is of it.

    Returns
    -------
    Material or None

    Raises
    ------
    ValueError
        For both, or for a name without a colour.
    """
    indices = f"{key}_indices"
    if key in table and indices in table:
        raise ValueError(f"give either {key} or {indices}, not both")
    if indices in table:
        return Material(*table[indices])
    if key not in table:
        return None
    if "wavelength_nm" not in table:
        raise ValueError(f'{key} = "{table[key]}" needs wavelength_nm: an index goes with colour')
    return Material.named(table[key], wavelength_nm=table["wavelength_nm"])


def table_from_window(camera: Camera) -> dict[str, object]:
    """[window] of a camera that looks through interfaces; empty where it looks through none."""
    if not camera.interfaces:
        return {}
    table: dict[str, object] = {"interfaces": [row_of_interface(one) for one in camera.interfaces]}
    front = camera.stands_in
    if front != AIR:
        table["front_indices"] = [front.phase_index, front.group_index]
    return table


def medium_from_table(table: Mapping[str, Any], camera: Camera | None) -> Medium:
    """The medium of a set-up; where no index is told, that behind the camera's window.

    Parameters
    ----------
    table : mapping of str
        [medium].
    camera : Camera or None
        With its window.

    Returns
    -------
    Medium
        Of the scene, out and back.

    Raises
    ------
    ValueError
        For keys that do not go together.
    """
    given = dict(table)
    name, wavelength = given.pop("material", None), given.pop("wavelength_nm", None)
    told = [key for key in ("path_group_index", "return_group_index") if key in given]
    if name is not None:
        if told:
            raise ValueError(f"give either material or {', '.join(told)}, not both")
        if wavelength is None:
            raise ValueError(f'material = "{name}" needs wavelength_nm: an index goes with colour')
        index = Material.named(name, wavelength_nm=wavelength).group_index
        return Medium(index, index, **given)
    if wavelength is not None:
        raise ValueError("wavelength_nm stands beside material: group indices have their own")
    if not told and camera is not None:
        index = scene_medium(camera).return_group_index
        return Medium(index, index, **given)
    return Medium(**given)
