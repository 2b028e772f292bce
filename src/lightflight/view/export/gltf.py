"""A path for slides and game engines: glTF 2.0 binary (.glb), written by hand, with a flying pulse.

Takes a LightPath, gives one file: the path as a tube, its errors as a transparent one (enlarged;
the factor is in the node's name), truth, mirrors, the camera's field, and an animated pulse. glTF
counts in metres and seconds: 1 m stands for 1 m; a second of the animation for `ps_per_s`
picoseconds of event time.
"""

from __future__ import annotations

import json
import struct
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from lightflight._version import __version__
from lightflight.files.whole_file import atomic_path
from lightflight.path.on_bends import drawn, drawn_outline_mm, starts_of_pieces
from lightflight.path.trace import has_errors, trace_from_path
from lightflight.path.tree import corners_of, outline_mm, ways
from lightflight.view.export.tables import checked_suffix, description_of
from lightflight.view.solids import (
    error_tube,
    field_lines,
    magnification_of,
    mirror_square,
    sphere,
    tube_along,
)
from lightflight.view.types import FilePath, Floats, Json, Whole

if TYPE_CHECKING:
    from lightflight import LightPath


_FLOAT, _UINT = 5126, 5125
_ARRAY_BUFFER, _ELEMENT_BUFFER = 34962, 34963
_LINES, _TRIANGLES = 1, 4
_M_PER_MM = 1e-3
_PARTS = ("nodes", "meshes", "materials", "accessors", "bufferViews", "animations")


def write_glb(light_path: LightPath, path: FilePath, *, ps_per_s: float = 500.0) -> None:
    """Write a path as glTF binary, with an animation of the pulse in event time.

    Parameters
    ----------
    light_path : LightPath
        The path.
    path : path
        Where to write.
    ps_per_s : float, optional
        Picoseconds of flight in a second of the animation.

    Raises
    ------
    ValueError
        For a name that does not end in .glb, a path without legs, or a pace that is not positive.
    """
    target, _ = checked_suffix(path, (".glb",), "glTF ")
    if not (np.isfinite(ps_per_s) and ps_per_s > 0):
        raise ValueError(f"ps_per_s must be positive, got {ps_per_s}")
    blob = glb_bytes(light_path, ps_per_s=ps_per_s)
    with atomic_path(target) as fresh:
        fresh.write_bytes(blob)


def glb_bytes(light_path: LightPath, *, ps_per_s: float = 500.0) -> bytes:
    """The file's content."""
    vertices = np.asarray(light_path.vertices_mm, dtype=float).reshape(-1, 3)
    if len(vertices) < 2 or not np.isfinite(vertices).all():
        raise ValueError("the path has no finite legs: there is nothing to export")
    model = _Model()
    size = max(float(np.ptp(vertices, axis=0).max()), 1.0)
    thin = 0.0022 * size
    model.mesh("path", *tube_along(drawn_outline_mm(light_path), thin), (0.82, 0.28, 0.04, 1.0))
    # Errors of 0.1 mm in a scene of 0.4 m cannot be seen at their own size.
    if has_errors(light_path):
        trace = trace_from_path(light_path, per_leg=17)
        factor = magnification_of(trace, size)
        solid = error_tube(trace, factor)
        if solid is not None:
            model.mesh(f"errors, 1 sigma x {factor:g}", *solid, (0.82, 0.28, 0.04, 0.25))
    truth = getattr(light_path, "truth", None)
    if truth is not None:
        exact = outline_mm(truth)
        model.mesh("truth", *tube_along(exact, 0.5 * thin), (0.1, 0.13, 0.19, 1.0))
    for k, before, corner, after in corners_of(light_path):
        square = mirror_square(before, corner, after, 0.06 * size)
        model.mesh(f"mirror {k}", *square, (0.72, 0.78, 0.85, 1.0))
    camera = getattr(light_path, "camera", None)
    if camera is not None:
        model.lines("field of view", field_lines(camera, vertices.mean(axis=0)), (0.09, 0.25, 0.54))
    model.mesh("source", *sphere(vertices[0], 3.0 * thin), (0.1, 0.13, 0.19, 1.0))
    places, times, of_leg = drawn(light_path)
    flights = ways(starts_of_pieces(light_path, of_leg))
    for k, way in enumerate(flights, start=1):
        # Where the path forks, a pulse flies on each of its branches.
        name = "pulse" if len(flights) == 1 else f"pulse of branch {k}"
        pulse = model.mesh(name, *sphere(np.zeros(3), 4.0 * thin), (1.0, 0.45, 0.1, 1.0))
        corners = [0, *(piece + 1 for piece in way)]
        # Linear between the corners: straight legs at an even speed need no more keys.
        model.fly(pulse, places[corners], (times[corners] - times[0]) / ps_per_s)
    return model.packed(description_of(light_path))


class _Model:
    """A glTF document that grows."""

    def __init__(self) -> None:
        self.binary = bytearray()
        self.parts: dict[str, list[Json]] = {name: [] for name in _PARTS}

    def _add(self, part: str, **fields: object) -> int:
        """Append to one of the document's lists; its number there."""
        self.parts[part].append(fields)
        return len(self.parts[part]) - 1

    def _accessor(self, values: NDArray[np.generic], kind: str, target: int | None) -> int:
        component = _UINT if values.dtype.kind in "ui" else _FLOAT
        # glTF knows single precision only, little-endian.
        numbers = np.ascontiguousarray(values, dtype="<u4" if component == _UINT else "<f4")
        place = {"buffer": 0, "byteOffset": len(self.binary), "byteLength": numbers.nbytes}
        view = self._add("bufferViews", **place, **({} if target is None else {"target": target}))
        self.binary += numbers.tobytes()
        flat = numbers.reshape(len(numbers), -1)
        return self._add(
            "accessors", bufferView=view, componentType=component, count=len(numbers), type=kind,
            min=flat.min(axis=0).tolist(), max=flat.max(axis=0).tolist(),
        )  # fmt: skip

    def _node(self, name: str, primitive: Json) -> int:
        return self._add(
            "nodes", name=name, mesh=self._add("meshes", name=name, primitives=[primitive])
        )

    def _material(self, name: str, color: tuple[float, ...]) -> int:
        rgba = (*color, 1.0)[:4]
        surface = {"baseColorFactor": list(rgba), "metallicFactor": 0.0, "roughnessFactor": 0.7}
        return self._add(
            "materials",
            name=name,
            pbrMetallicRoughness=surface,
            emissiveFactor=[0.35 * c for c in rgba[:3]],
            doubleSided=True,
            **({"alphaMode": "BLEND"} if rgba[3] < 1 else {}),
        )

    def mesh(self, name: str, points_mm: Floats, triangles: Whole, color: tuple[float, ...]) -> int:
        """Add triangles; returns the number of their node."""
        points = points_mm * _M_PER_MM
        primitive = {
            "attributes": {"POSITION": self._accessor(points, "VEC3", _ARRAY_BUFFER)},
            "indices": self._accessor(
                triangles.ravel().astype(np.uint32), "SCALAR", _ELEMENT_BUFFER
            ),
            "material": self._material(name, color),
            "mode": _TRIANGLES,
        }
        return self._node(name, primitive)

    def lines(self, name: str, pairs_mm: Floats, color: tuple[float, ...]) -> int:
        """Add line segments (n, 2, 3)."""
        points = pairs_mm.reshape(-1, 3) * _M_PER_MM
        primitive = {
            "attributes": {"POSITION": self._accessor(points, "VEC3", _ARRAY_BUFFER)},
            "material": self._material(name, color),
            "mode": _LINES,
        }
        return self._node(name, primitive)

    def fly(self, node: int, places_mm: Floats, seconds: Floats) -> None:
        """Move a node from place to place; straight and even between them, like light."""
        when = self._accessor(seconds[:, np.newaxis], "SCALAR", None)
        where = self._accessor(places_mm * _M_PER_MM, "VEC3", None)
        self.parts["nodes"][node]["translation"] = (places_mm[0] * _M_PER_MM).tolist()
        self._add(
            "animations",
            name="flight (event time)",
            samplers=[{"input": when, "output": where, "interpolation": "LINEAR"}],
            channels=[{"sampler": 0, "target": {"node": node, "path": "translation"}}],
        )

    def packed(self, extras: Json) -> bytes:
        """The document as one .glb."""
        document = {
            "asset": {
                "version": "2.0",
                "generator": f"lightflight {__version__}",
                "extras": extras,
            },
            "scene": 0,
            "scenes": [{"nodes": list(range(len(self.parts["nodes"])))}],
            **self.parts,
            "buffers": [{"byteLength": len(self.binary)}],
        }
        # The order of the parts is that of the files of version 0.1.
        document["animations"] = document.pop("animations")
        text = json.dumps(document, separators=(",", ":"), allow_nan=False).encode("utf-8")
        # Chunks end on multiples of four bytes: text is padded by blanks, numbers by zeros (glTF
        # 2.0).
        text += b" " * (-len(text) % 4)
        binary = bytes(self.binary) + b"\0" * (-len(self.binary) % 4)
        body = struct.pack("<II", len(text), 0x4E4F534A) + text
        body += struct.pack("<II", len(binary), 0x004E4942) + binary
        return struct.pack("<III", 0x46546C67, 2, 12 + len(body)) + body
