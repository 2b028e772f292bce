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

from lightflight.errors import FileFormatError
from lightflight.files.store import read_array, text_attribute
from lightflight.files.whole_file import atomic_path
from lightflight.formats.cubes import (
    axes_of,
    check_axes,
    check_is_there,
    record_from_array,
    several_arrays,
    stated_axes,
)
from lightflight.formats.hdf5_dataset import cube_of, datasets_in
from lightflight.formats.matlab5 import array_of, text_of, variables_in
from lightflight.formats.metadata import (
    DIGEST,
    TEXT,
    check_texts,
    fields_from_texts,
    texts_from_histograms,
)
from lightflight.formats.registry import Format
from lightflight.recording.clock_fields import clock_fields_of
from lightflight.recording.histograms import Histograms
from lightflight.recording.recording import Recording

USUAL_NAMES = ("counts", "series", "hist", "XYZimage", "data_cube")
"""What laboratories call their cube; decides where a file holds several."""

_LARGEST_V5 = (1 << 31) - 1
_Shapes = dict[str, tuple[int, ...]]
_Load = Callable[[str], Any]
"""Gives an array by its name, with the axes backwards."""
_TEXTS = ("axes", TEXT, DIGEST)


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
    """Read one variable, as a cube or as frames.

    Parameters
    ----------
    path : Path
        A MATLAB file, v5 or v7.3.
    clock : mapping of str
        Hints about the clock (`clock.CLOCK_HINTS`).
    variable : str, optional
        Its name; None: the one array of three axes, or the one of `USUAL_NAMES`.
    axes : str, optional
        Order of its axes as MATLAB's size() shows them; None: as the file states it.
    shape : (int, int), optional
        (rows, cols), where pixels are stored row by row.
    n_codes : int, optional
        TDC codes, for frames.
    poisson : bool, optional
        False for scaled intensities; None: as the file says, else counts.

    Returns
    -------
    Recording or Histograms
        Numbers of the record, whatever the variable was called.

    Raises
    ------
    FileFormatError
        Where the file is cut, or which variable or what order is not clear.
    ConfigError
        Where `variable` is not there, or a hint is none.
    """
    shapes, load, texts = _opened(path)
    name = _chosen(variable, shapes, path)
    fields, settings = fields_from_texts(texts, path)
    axes = axes_of(name, shapes[name], axes or stated_axes(texts.get("axes")), path=path)
    check_axes(axes, shapes[name], path)
    # MATLAB's axes are backwards in the file, and read so.
    values = load(name)
    record = record_from_array(
        np.asarray(values) if "f" in axes else values,
        axes[::-1],
        fields | dict(clock),
        path=path,
        shape=shape,
        n_codes=n_codes,
        poisson=poisson,
        settings={"variable": name, **settings},
    )
    check_texts(texts, record, lambda: np.asarray(values).T, path)
    return record


def array_from_file(path: Path, variable: str | None) -> NDArray[np.generic]:
    """One array of numbers from a MATLAB file.

    Parameters
    ----------
    path : Path
        A MATLAB file, v5 or v7.3.
    variable : str or None
        Its name, where there is more than one candidate.

    Returns
    -------
    array
        Axes in the order of MATLAB's size().

    Raises
    ------
    FileFormatError
        For what is no MATLAB file, or has no such array.
    """
    shapes, load, _ = _opened(path)
    return np.asarray(load(_chosen(variable, shapes, path))).T


def _opened(path: Path) -> tuple[_Shapes, _Load, dict[str, str]]:
    """Shapes, how to load an array, and texts, by name."""
    with path.open("rb") as file:
        is_v73 = file.read(10) == b"MATLAB 7.3"
    return _opened_v73(path) if is_v73 else _opened_v5(path)


def _opened_v5(path: Path) -> tuple[_Shapes, _Load, dict[str, str]]:
    """Shapes by name, what loads an array by its name, and texts by name, of a v5 file."""
    variables = {variable.name: variable for variable in variables_in(path)}
    shapes = {name: v.shape for name, v in variables.items() if name and not v.is_text}
    texts = {
        name: text_of(variables[name], path)
        for name in _TEXTS
        if name in variables and variables[name].is_text and variables[name].n_bytes
    }
    return shapes, lambda name: array_of(variables[name], path), texts


def _opened_v73(path: Path) -> tuple[_Shapes, _Load, dict[str, str]]:
    """The same of a v7.3 file, which is HDF5 with its axes backwards."""
    import h5py

    with h5py.File(path, "r", locking="best-effort") as file:
        nodes = datasets_in(file)
        is_text = {
            name: text_attribute(node, "MATLAB_class") == "char" for name, node in nodes.items()
        }
        shapes = {name: node.shape[::-1] for name, node in nodes.items() if not is_text[name]}
        texts = {
            name: "".join(map(chr, np.ravel(read_array(node, path=path, ours=False))))
            for name, node in nodes.items()
            if name in _TEXTS and is_text[name] and node.dtype == np.uint16 and node.size < 1 << 20
        }
    return shapes, lambda name: cube_of(path, name), texts


def _chosen(wanted: str | None, shapes: _Shapes, path: Path) -> str:
    """Name of the variable to read: three axes before two, a usual name before others."""
    if wanted is not None:
        check_is_there(wanted, shapes, option="variable", path=path)
        return wanted
    for n_dimensions in (3, 2):
        found = {name: s for name, s in shapes.items() if len(s) == n_dimensions and min(s) > 0}
        found = {name: s for name, s in found.items() if max(s) > 1}
        usual = [name for name in found if name in USUAL_NAMES]
        names = usual if len(usual) == 1 else list(found)
        if len(names) == 1:
            return names[0]
        if names:
            raise several_arrays(found, option="variable", path=path)
    raise FileFormatError(
        "holds no array of real numbers outside structures: save the cube as a variable", path=path
    )


# --- writing ----------------------------------------------------------------------------


def write(record: Recording | Histograms, path: Path) -> None:
    """Write histograms as v5: `counts`, `axes`, the clock as numbers, and all metadata as text.

    Parameters
    ----------
    record : Recording or Histograms
        Only histograms can be written.
    path : Path
        The file; it appears whole or not at all.

    Raises
    ------
    ValueError
        For a recording, and for a cube beyond the 2 GB of v5.
    """
    from scipy.io import savemat

    if not isinstance(record, Histograms):
        raise ValueError(
            "mat holds histograms: use histogram() first, or write .h5 to keep photons"
        )
    if record.counts.nbytes > _LARGEST_V5:
        raise ValueError(
            f"a cube of {record.counts.nbytes / 1e9:.3g} GB is too large for MATLAB v5: write .h5, "
            "which MATLAB reads with h5read"
        )
    known = clock_fields_of(record)
    clock = {name: float(value) for name, value in known.items() if value is not None}
    texts = texts_from_histograms(record)
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
