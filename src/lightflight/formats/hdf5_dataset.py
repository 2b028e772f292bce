"""Any other HDF5 file: one dataset of it, as a cube or as frames.

Datasets labelled with their axes (HDF5 dimension labels, an attribute `axes`, or a name that
ends in the letters, like `cube_t_y_x`) state their order; all others need `axes`.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path

import h5py
import numpy as np

from lightflight.errors import FileFormatError
from lightflight.files.hdf5_tree import entries_of
from lightflight.formats.cubes import (
    axes_of,
    check_is_there,
    record_from_array,
    several_arrays,
    stated_axes,
)
from lightflight.formats.isolation import run_isolated
from lightflight.formats.registry import Format
from lightflight.formats.stored import StoredArray
from lightflight.recording.histograms import Histograms
from lightflight.recording.recording import Recording

_MOST_DATASETS = 10_000
_NAMED_AXES = re.compile(r"_([yxtf])_([yxtf])_([yxtf])$")


def read(
    path: Path,
    clock: Mapping[str, object],
    *,
    dataset: str | None = None,
    axes: str | None = None,
    shape: tuple[int, int] | None = None,
    n_codes: int | None = None,
    poisson: bool = True,
) -> Recording | Histograms:
    """Read one dataset, as a cube or as frames.

    Parameters
    ----------
    path : Path
        An HDF5 file.
    clock : mapping of str
        Hints about the clock (`clock.CLOCK_HINTS`).
    dataset : str, optional
        Path of the dataset in the file ("LinearFiber/cube_t_y_x"); None: the one of three axes.
    axes : str, optional
        Order of its axes; None: as the file states it.
    shape : (int, int), optional
        (rows, cols), where pixels are stored row by row.
    n_codes : int, optional
        TDC codes, for frames.
    poisson : bool
        False for scaled intensities.

    Returns
    -------
    Recording or Histograms
        Frames ("fyx") stay in the file; attributes of the dataset and its group are settings.

    Raises
    ------
    FileFormatError
        Where it is no HDF5 file, or which dataset or what order is not clear.
    ConfigError
        Where `dataset` is not there, or a hint is none.
    """
    if not h5py.is_hdf5(path):
        raise FileFormatError("is not an HDF5 file: check the name, or copy it again", path=path)
    with h5py.File(path, "r", locking="best-effort") as file:
        nodes = datasets_in(file)
        name = _chosen({key: node.shape for key, node in nodes.items()}, dataset, path)
        node = nodes[name]
        found, labels = _attributes_of(node)
        stored = StoredArray.of(node, path=path, ours=False)
        # Only attributes that are texts need a process of their own, which takes its time.
        if any(_has_texts(holder) for holder in (node, node.parent)):
            _, texts = run_isolated(f"{__name__}:load_attributes", path, {"name": name})
            found, labels = texts["attributes"], texts["labels"]
    stated = _stated_axes(name, len(stored.shape), found.get("axes"), labels)
    axes = axes_of(name, stored.shape, axes or stated, path=path)
    if "f" in axes:
        with h5py.File(path, "r", locking="best-effort") as file:
            StoredArray.streamed(file[name], path=path)
    return record_from_array(
        np.asarray(stored) if "f" in axes and axes != "fyx" else stored,
        axes,
        clock,
        path=path,
        shape=shape,
        n_codes=n_codes,
        poisson=poisson,
        settings={"dataset": name, **found},
    )


def datasets_in(file: h5py.File) -> dict[str, h5py.Dataset]:
    """All datasets of numbers, by their path in the file."""
    found: dict[str, h5py.Dataset] = {}
    for name, _, node in entries_of(file):
        if not isinstance(node, h5py.Dataset) or node.shape is None:
            continue
        if node.dtype.kind in "uifb":
            found[name] = node
        if len(found) > _MOST_DATASETS:
            break
    return found


def cube_of(path: Path, name: str) -> StoredArray:
    """A dataset of numbers, read in parts when it is asked for."""
    with h5py.File(path, "r", locking="best-effort") as file:
        return StoredArray.of(file[name], path=path, ours=False)


def _chosen(shapes: Mapping[str, tuple[int, ...]], wanted: str | None, path: Path) -> str:
    if wanted is not None:
        wanted = wanted.strip("/")
        check_is_there(wanted, shapes, option="dataset", path=path)
        return wanted
    cubes = {name: found for name, found in shapes.items() if len(found) == 3}
    if len(cubes or shapes) == 1:
        return next(iter(cubes or shapes))
    if not shapes:
        raise FileFormatError("holds no array of numbers", path=path)
    raise several_arrays(cubes or shapes, option="dataset", path=path)


def _stated_axes(name: str, n_axes: int, stated: object, labels: list[str]) -> str | None:
    """Order of the axes as the file states it; None where it does not."""
    named = _NAMED_AXES.search(name)
    for order in (labels, stated if isinstance(stated, str) else None, named and named.groups()):
        axes = stated_axes("".join(order or ()))
        if axes is not None and len(axes) == n_axes:
            return axes
    return None


def _has_texts(node: h5py.HLObject) -> bool:
    """Whether it has attributes of variable length, which are not safe to read here."""
    return any(node.attrs.get_id(name).dtype.hasobject for name in node.attrs)


def _attributes_of(
    node: h5py.HLObject, *, texts: bool = False
) -> tuple[dict[str, object], list[str]]:
    """Single numbers and texts among the attributes of a dataset and its group; axis labels."""
    kept: dict[str, object] = {}
    for holder in (node.parent, node):
        for name in holder.attrs:
            if texts or not holder.attrs.get_id(name).dtype.hasobject:
                value = holder.attrs[name]
                plain = value.item() if isinstance(value, np.generic) else value
                plain = plain.decode("utf-8", "replace") if isinstance(plain, bytes) else plain
                if isinstance(plain, bool | int | float | str):
                    kept[name] = plain
    return kept, [str(dimension.label) for dimension in node.dims] if texts else []


def load_attributes(path: Path, *, name: str) -> tuple[dict[str, object], dict[str, object]]:
    """Attributes and axis labels of a dataset, texts included; runs in a child process.

    In a damaged file the HDF5 library can loop for ever over where texts are kept.
    """
    with h5py.File(path, "r", locking="best-effort") as file:
        attributes, labels = _attributes_of(file[name], texts=True)
    return {}, {"attributes": attributes, "labels": labels}


def _matches(path: Path, start: bytes) -> bool:
    return bool(start) and h5py.is_hdf5(path)


FORMATS = (
    Format(
        name="hdf5",
        summary="any dataset of an HDF5 file, its axes by hint",
        suffixes=(".h5", ".hdf5", ".hdf"),
        matches=_matches,
        read=read,
        turn=1,
    ),
)
