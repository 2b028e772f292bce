"""MATLAB files: v5 (-v6, -v7) and v7.3, the cubes in them whatever they are called.

Shapes and `axes` are those that MATLAB's size() shows, for v7.3 too, whose HDF5 shows them
backwards. Structures are not looked into, except in v7.3 (`variable="struct/field"`).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lightflight.errors import ConfigError, FileFormatError
from lightflight.formats.cubes import (
    axes_needed,
    checked_shape,
    record_from_array,
    shapes_text,
    stated_axes,
)
from lightflight.formats.metadata import fields_from_text, text_from_histograms
from lightflight.formats.registry import Format
from lightflight.histogram import Histograms
from lightflight.recording import CLOCK_FIELDS, Recording

USUAL_NAMES = ("counts", "series", "hist", "XYZimage", "data_cube")
"""What laboratories call their cube; decides where a file holds several."""

_LARGEST_V5 = (1 << 31) - 1
_Shapes = dict[str, tuple[int, ...]]
_Load = Callable[[str], NDArray[Any]]


# --- reading ----------------------------------------------------------------------------


def read(
    path: Path,
    clock: Mapping[str, Any],
    *,
    variable: str | None = None,
    axes: str | None = None,
    shape: tuple[int, int] | None = None,
    n_codes: int | None = None,
    poisson: bool | None = None,
) -> Recording | Histograms:
    """Read one variable; `variable` names it where there is more than one candidate."""
    with path.open("rb") as file:
        opened = _opened_v73 if file.read(10) == b"MATLAB 7.3" else _opened_v5
    shapes, load, texts = opened(path)
    name = _chosen(variable, shapes, path)
    fields, settings = fields_from_text(texts.get("lightflight"), path)
    told_poisson = bool(fields.pop("poisson", True))
    axes = axes or stated_axes(texts.get("axes"))
    if axes is None:
        raise axes_needed({name: shapes[name]}, path)
    return record_from_array(
        load(name),
        axes,
        fields | dict(clock),
        path=path,
        shape=checked_shape(shape) if shape is not None else None,
        n_codes=n_codes,
        poisson=told_poisson if poisson is None else poisson,
        settings={"variable": name, **settings},
    )


def array_from_file(path: Path, variable: str | None) -> NDArray[Any]:
    """One array of numbers; `variable` names it where there is more than one candidate.

    Raises FileFormatError for what is no MATLAB file, or has no such array.
    """
    with path.open("rb") as file:
        opened = _opened_v73 if file.read(10) == b"MATLAB 7.3" else _opened_v5
    shapes, load, _ = opened(path)
    return np.asarray(load(_chosen(variable, shapes, path)))


def _opened_v5(path: Path) -> tuple[_Shapes, _Load, dict[str, str]]:
    from lightflight.formats.matlab5 import array_of, text_of, variables_in

    variables = {variable.name: variable for variable in variables_in(path)}
    shapes = {name: v.shape for name, v in variables.items() if name and not v.is_text}
    texts = {name: text_of(v, path) for name, v in variables.items() if v.is_text and v.n_bytes}
    return shapes, lambda name: array_of(variables[name], path), texts


def _opened_v73(path: Path) -> tuple[_Shapes, _Load, dict[str, str]]:
    import h5py

    from lightflight.formats.hdf5_dataset import cube_of, datasets_in
    from lightflight.store import text_attribute

    with h5py.File(path, "r", locking="best-effort") as file:
        nodes = datasets_in(file)
        is_text = {
            name: text_attribute(node, "MATLAB_class") == "char" for name, node in nodes.items()
        }
        shapes = {name: node.shape[::-1] for name, node in nodes.items() if not is_text[name]}
        texts = {
            name: "".join(map(chr, np.ravel(node[()])))
            for name, node in nodes.items()
            if is_text[name] and node.dtype == np.uint16 and node.size < 1 << 20
        }
    return shapes, lambda name: cube_of(path, name).T, texts


def _chosen(wanted: str | None, shapes: _Shapes, path: Path) -> str:
    if wanted is not None:
        if wanted not in shapes:
            raise ConfigError(
                f"variable={wanted!r} is no array of numbers in {path.name}: it holds "
                f"{shapes_text(shapes)}"
            )
        return wanted
    for n_dimensions in (3, 2):
        found = {name: s for name, s in shapes.items() if len(s) == n_dimensions and min(s) > 0}
        found = {name: s for name, s in found.items() if max(s) > 1}
        usual = [name for name in found if name in USUAL_NAMES]
        names = usual if len(usual) == 1 else list(found)
        if len(names) == 1:
            return names[0]
        if names:
            raise FileFormatError(
                f"holds several arrays ({shapes_text(found)}): name one with variable=", path=path
            )
    raise FileFormatError(
        "holds no array of real numbers outside structures: save the cube as a variable", path=path
    )


# --- writing ----------------------------------------------------------------------------


def write(record: Recording | Histograms, path: Path) -> None:
    """Write histograms as v5: `counts`, `axes`, the clock as numbers, and all metadata as text."""
    from scipy.io import savemat

    from lightflight.store import atomic_path

    if not isinstance(record, Histograms):
        raise ValueError(
            "mat holds histograms: use histogram() first, or write .h5 to keep photons"
        )
    if record.counts.nbytes > _LARGEST_V5:
        raise ValueError(
            f"a cube of {record.counts.nbytes / 1e9:.3g} GB is too large for MATLAB v5: write .h5, "
            "which MATLAB reads with h5read"
        )
    known = {name: getattr(record, name) for name in CLOCK_FIELDS}
    clock = {name: float(value) for name, value in known.items() if value is not None}
    texts = {"axes": "yxt", "lightflight": text_from_histograms(record)}
    with atomic_path(path) as fresh:
        variables = {"counts": record.counts, **clock, **texts}
        savemat(fresh, variables, appendmat=False, do_compression=True)


def _matches(path: Path, start: bytes) -> bool:
    return start.startswith((b"MATLAB 5.0 MAT-file", b"MATLAB 7.3 MAT-file"))


FORMATS = (
    Format(
        name="matlab",
        summary="MATLAB v5 and v7.3: any array, its axes by hint",
        suffixes=(".mat",),
        matches=_matches,
        read=read,
        write=write,
    ),
)
