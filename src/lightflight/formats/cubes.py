"""Arrays of others: which axis is which, and what they hold.

Axis letters: `y` rows, `x` columns, `t` codes (time), `p` pixels row by row, `f` frames. An
order that the file does not state must be given as `axes`; it is never guessed.
"""

from __future__ import annotations

import itertools
import math
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lightflight.arguments import pixels_of_shape
from lightflight.errors import ConfigError, FileFormatError
from lightflight.files.filecheck import record_error_as_format_error
from lightflight.formats.streamed import cube_from
from lightflight.recording.histograms import Histograms
from lightflight.recording.recording import Recording

_MOST_PIXELS = 1 << 40
_HISTOGRAM_AXES = ({"y", "x", "t"}, {"p", "t"}, {"t"})
_FRAME_AXES = ({"f", "y", "x"}, {"f", "p"})


def check_axes_hint(axes: object) -> None:
    """Raise ConfigError where `axes` is not one of the orders there can be.

    Parameters
    ----------
    axes : object
        What the user gave; a str of the letters of this module is right.
    """
    if stated_axes(axes) is None:
        raise ConfigError(
            f"hint axes must be an order of 'yxt' (rows, columns, codes), 'pt' (pixels, codes), "
            f"'fyx' (frames, rows, columns) or 'fp', got {axes!r}"
        )


def stated_axes(axes: object) -> str | None:
    """What a file says of its axes, where it is one of the orders there can be."""
    if not isinstance(axes, str) or len(set(axes)) != len(axes):
        return None
    return axes if set(axes) in (*_HISTOGRAM_AXES, *_FRAME_AXES) else None


def axes_of(
    name: str, shape: tuple[int, ...], axes: str | None, *, path: str | os.PathLike[str]
) -> str:
    """Order of the axes of an array; FileFormatError that asks for it where it is not known."""
    if axes is None:
        raise FileFormatError(
            f"does not tell the order of its axes ({shapes_text({name: shape})}): give axes=, a "
            "letter per axis (y rows, x columns, t codes, f frames), like axes='yxt' or axes='tyx'",
            path=path,
        )
    return axes


def only_array(
    shapes: Mapping[str, tuple[int, ...]], *, option: str, path: str | os.PathLike[str]
) -> str:
    """Name of the one array of three axes, or of the one there is; else FileFormatError."""
    cubes = [name for name, shape in shapes.items() if len(shape) == 3] or list(shapes)
    if not cubes:
        raise FileFormatError(
            "holds no array of numbers: save a plain array (Python objects are never loaded)",
            path=path,
        )
    if len(cubes) > 1:
        raise several_arrays(shapes, option=option, path=path)
    return cubes[0]


def several_arrays(
    found: Mapping[str, tuple[int, ...]], *, option: str, path: str | os.PathLike[str]
) -> FileFormatError:
    """Error that asks for the name of one array.

    Parameters
    ----------
    found : mapping of str to (int, ...)
        Shapes by name.
    option : str
        The hint that takes the name.
    path : path
        The file.

    Returns
    -------
    FileFormatError
        To be raised.
    """
    return FileFormatError(
        f"holds several arrays ({shapes_text(found)}): name one with {option}=", path=path
    )


def check_is_there(
    wanted: str, shapes: Mapping[str, tuple[int, ...]], *, option: str, path: Path
) -> None:
    """Raise ConfigError where an array that the user named is not in the file."""
    if wanted not in shapes:
        raise ConfigError(
            f"{option}={wanted!r} is no array of numbers in {path.name}: it holds "
            f"{shapes_text(shapes)}"
        )


def shapes_text(found: Mapping[str, tuple[int, ...]]) -> str:
    """Names and shapes of what was found, for an error text."""
    shown = [f"{name} {shape}" for name, shape in itertools.islice(found.items(), 8)]
    return ", ".join(shown) + (", ..." if len(found) > 8 else "")


def record_from_array(
    values: Any,
    axes: str,
    clock: Mapping[str, Any],
    *,
    path: str | os.PathLike[str],
    shape: tuple[int, int] | None = None,
    n_codes: int | None = None,
    poisson: bool | None = None,
    settings: Mapping[str, object] | None = None,
) -> Recording | Histograms:
    """Histograms, or a recording of frames, from an array whose axes are known.

    Parameters
    ----------
    values : array
        One axis per letter of `axes`.
    axes : str
        Order of the axes; the letters are those of this module.
    clock : mapping
        Fields of the record that say how codes become times, and `poisson` where the file says it.
    path : path
        Where the array came from, for error texts.
    shape : (rows, cols), optional
        Needed for `p` (pixels row by row), which does not tell it.
    n_codes : int, optional
        Needed for frames, which do not tell how many codes the TDC has.
    poisson : bool, optional
        False for scaled intensities; None: as `clock` says, else counts.
    settings : mapping of str, optional
        Carried along.

    Returns
    -------
    Recording or Histograms
        A recording where `axes` has frames.

    Raises
    ------
    FileFormatError
        If the array cannot be what `axes` says.
    ConfigError
        If a hint is missing, or is none.
    """
    if shape is not None:
        shape = checked_shape(shape)
    check_axes_hint(axes)
    if values.dtype.kind not in "uifb":
        raise FileFormatError(f"holds {values.dtype}, not real numbers", path=path)
    check_axes(axes, values.shape, path)
    told = {**clock, "settings": dict(settings or {})}
    told_poisson = bool(told.pop("poisson", True))
    with record_error_as_format_error(path):
        if "f" in axes:
            if n_codes is None:
                raise ConfigError(
                    "frames of codes need n_codes=: how many codes the TDC has (PF32: 1024)"
                )
            frames = _ordered(values, axes, "fyx" if "y" in axes else "fp")
            frames = _with_pixels(frames, 1, shape, path)
            return Recording.from_frames(frames, n_codes=n_codes, **told)
        wanted = "yxt" if "y" in axes else "pt" if "p" in axes else "t"
        order = tuple(axes.index(letter) for letter in wanted)
        lengths = tuple(values.shape[k] for k in order)
        *pixels, n_codes = lengths if len(lengths) > 1 else (1, *lengths)
        rows, cols = _pixel_shape(tuple(pixels), shape, path)
        is_poisson = told_poisson if poisson is None else poisson
        if 0 in lengths:
            raise FileFormatError(f"has an empty array, of shape {tuple(values.shape)}", path=path)
        cube = cube_from(values, order, (rows, cols, n_codes), poisson=bool(is_poisson), path=path)
        return Histograms(cube, **told, poisson=is_poisson)


def check_axes(axes: str, shape: tuple[int, ...], path: str | os.PathLike[str]) -> None:
    """Raise FileFormatError where there is not one letter per axis."""
    if len(shape) != len(axes):
        raise FileFormatError(
            f"has an array of shape {tuple(shape)}, which axes={axes!r} does not describe: "
            "give one letter per axis",
            path=path,
        )


def _ordered(values: Any, axes: str, wanted: str) -> NDArray[np.generic]:
    """The array with its axes in the wanted order; not touched where they are."""
    order = [axes.index(letter) for letter in wanted]
    if order == sorted(order):
        return values  # type: ignore[no-any-return]
    return np.transpose(values, order)


def _with_pixels(
    values: NDArray[np.generic],
    axis: int,
    shape: tuple[int, int] | None,
    path: str | os.PathLike[str],
) -> NDArray[np.generic]:
    """Split the axis of pixels into (rows, cols) where there is one; check `shape` otherwise."""
    kept = 2 if len(values.shape) == 3 else 1
    found = tuple(values.shape[axis : axis + kept])
    rows, cols = _pixel_shape(found, shape, path)
    if kept == 2:
        return values
    return values.reshape(*values.shape[:axis], rows, cols, *values.shape[axis + 1 :])


def _pixel_shape(
    found: tuple[int, ...], shape: tuple[int, int] | None, path: str | os.PathLike[str]
) -> tuple[int, int]:
    """(rows, cols) of (rows, cols), or of (pixels,) whose shape the user tells."""
    if len(found) == 2:
        if shape is not None and found != tuple(shape):
            raise FileFormatError(f"holds {found} pixels, not shape={tuple(shape)}", path=path)
        return found[0], found[1]
    n_pixels = found[0]
    if shape is None:
        if n_pixels != 1:
            raise ConfigError(f"{n_pixels} pixels row by row need shape=(rows, cols)")
        shape = (1, 1)
    if math.prod(shape) != n_pixels:
        raise FileFormatError(f"holds {n_pixels} pixels, not shape={tuple(shape)}", path=path)
    return shape


def checked_shape(shape: object) -> tuple[int, int]:
    """(rows, cols) from a hint.

    Parameters
    ----------
    shape : object
        What the user gave; two positive whole numbers are right.

    Returns
    -------
    (int, int)
        Rows and columns.

    Raises
    ------
    ConfigError
        Where it is something else.
    """
    try:
        rows, cols = pixels_of_shape(shape)
    except ValueError:
        rows = cols = 0
    # No camera has more: the product is a length of arrays.
    if not 0 < rows * cols < _MOST_PIXELS:
        raise ConfigError(f"hint shape must be (rows, cols), two whole numbers, got {shape!r}")
    return rows, cols
