"""Points of known place and the pixels that saw them, and pictures of boards, from files."""

from __future__ import annotations

import csv
from collections.abc import Mapping
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from lightflight.errors import FileFormatError, optional_package
from lightflight.files.filecheck import check_memory, readable_file

Floats = NDArray[np.float64]

COLUMNS = ("x_mm", "y_mm", "z_mm", "row", "col")
_MOST_BYTES = 64 << 20


def points_from_file(
    path: Path, *, variable: str | None = None
) -> tuple[Floats, Floats, tuple[int, int] | None]:
    """Points of known place and the pixels that saw them.

    - .csv with the columns x_mm, y_mm, z_mm, row, col (others are passed over); z_mm may lack
    - .npz with points_mm (n, 3) and pixels (n, 2)
    - .npz, .npy or .mat with one array (2 or 3, rows, cols): where each pixel looks; z = 0 for two

    Parameters
    ----------
    path : Path
        The table.
    variable : str, optional
        Name of the array, where the file holds several.

    Returns
    -------
    points : array of float, shape (n, 3)
        In the file's unit (mm).
    pixels : array of float, shape (n, 2)
        (row, col).
    shape : (int, int) or None
        (rows, cols) of the camera, where the file tells it.

    Raises
    ------
    FileFormatError
        For a file that is missing, empty, too large, or holds none of these.
    """
    if readable_file(path).stat().st_size > _MOST_BYTES:
        raise FileFormatError("too large for a table of points", path=path)
    suffix = path.suffix.lower()
    if suffix in (".csv", ".txt"):
        return *_points_from_csv(path), None
    if suffix == ".mat":
        from lightflight.formats.matlab import array_from_file

        return _points_of_map(array_from_file(path, variable), path)
    if suffix not in (".npz", ".npy"):
        raise FileFormatError("is no .csv, .npz, .npy or .mat file", path=path)
    from lightflight.formats.numpy_files import arrays_from_file

    arrays = arrays_from_file(path)
    if variable is None and {"points_mm", "pixels"} <= arrays.keys():
        return _points_of_arrays(arrays, path)
    if variable is None and len(arrays) == 1:
        variable = next(iter(arrays))
    if variable not in arrays:
        raise FileFormatError(
            f"holds {', '.join(arrays)}: name one with --variable, or points_mm and pixels",
            path=path,
        )
    return _points_of_map(arrays[variable], path)


def _points_from_csv(path: Path) -> tuple[Floats, Floats]:
    try:
        with path.open(newline="", encoding="utf-8-sig") as stream:
            rows = list(csv.DictReader(stream, skipinitialspace=True))
        if not rows:
            raise ValueError("it is empty")
        missing = [name for name in COLUMNS if name not in rows[0] and name != "z_mm"]
        if missing:
            raise ValueError(f"it lacks the columns {', '.join(missing)}")
        table = np.array([[float(row.get(name) or 0.0) for name in COLUMNS] for row in rows])
    except (ValueError, TypeError, UnicodeDecodeError, csv.Error) as error:
        raise FileFormatError(
            f"is no table with the columns {', '.join(COLUMNS)}: {error}", path=path
        ) from error
    return table[:, :3], table[:, 3:]


def _points_of_arrays(
    arrays: Mapping[str, NDArray[np.generic]], path: Path
) -> tuple[Floats, Floats, tuple[int, int] | None]:
    """points_mm (n, 3), pixels (n, 2) and, where it is there, shape (rows, cols)."""
    points, seen, shape = arrays["points_mm"], arrays["pixels"], arrays.get("shape")
    lengths = f"points_mm {points.shape}, pixels {seen.shape}"
    if points.shape[1:] != (3,) or seen.shape != (len(points), 2):
        raise FileFormatError(f"holds {lengths}: they must be (n, 3) and (n, 2)", path=path)
    if points.dtype.kind not in "uif" or seen.dtype.kind not in "uif":
        raise FileFormatError("holds points_mm and pixels that are no numbers", path=path)
    if shape is not None and (shape.shape != (2,) or shape.dtype.kind not in "ui"):
        raise FileFormatError("holds a shape that is not two numbers, rows and cols", path=path)
    camera = None if shape is None else (int(shape[0]), int(shape[1]))
    return points.astype(float), seen.astype(float), camera


def _points_of_map(
    places: NDArray[np.generic], path: Path
) -> tuple[Floats, Floats, tuple[int, int]]:
    """Points and pixels of a map (2 or 3, rows, cols) of where each pixel looks."""
    if places.ndim != 3 or places.shape[0] not in (2, 3):
        raise FileFormatError(
            f"holds an array of shape {places.shape}: a map of where pixels look has (2 or 3, "
            "rows, cols); name another with --variable",
            path=path,
        )
    if places.dtype.kind not in "uif":
        raise FileFormatError(f"holds {places.dtype}, not places in space", path=path)
    rows, cols = places.shape[1:]
    points = np.zeros((rows * cols, 3))
    points[:, : len(places)] = places.reshape(len(places), -1).T
    seen = np.indices((rows, cols)).reshape(2, -1).T.astype(float)
    return points, seen, (rows, cols)


def picture_from_file(path: Path) -> Floats:
    """Picture in grey, by OpenCV.

    Parameters
    ----------
    path : Path
        Any picture that OpenCV can read.

    Returns
    -------
    array of float, shape (rows, cols)
        Grey values.

    Raises
    ------
    MissingExtraError
        Without the `camera` extra.
    FileFormatError
        For what is no picture.
    """
    cv2 = optional_package(
        "cv2",
        otherwise="reading pictures of boards needs OpenCV: pip install 'lightflight[camera]'",
    )
    readable_file(path)
    picture = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)
    if picture is None:
        raise FileFormatError("is no picture that OpenCV can read", path=path)
    # OpenCV itself stops at a gigabyte of pixels.
    check_memory(8 * picture.size, path=path, what=f"a picture {picture.shape}")
    return np.asarray(picture, dtype=np.float64)
