"""Arguments as users give them: what each must be, or one sentence that says so.

Every check names the argument, says what it must be and shows what was given, on one line. They
come before any work, so that nobody reads a foreign exception from deep within it.
"""

from __future__ import annotations

import math
import operator
from collections.abc import Iterable
from typing import Any

import numpy as np
from numpy.typing import NDArray

POSITIVE = math.ulp(0.0)
"""The smallest number above zero: `low=POSITIVE` asks for more than nothing."""
_MOST_SHOWN = 60
"""Characters of a value that a message repeats."""


def shown(value: object) -> str:
    """A value in a message, on one line, shortened where it is long."""
    text = " ".join(repr(value).split())
    return text if len(text) <= _MOST_SHOWN else f"{text[:_MOST_SHOWN]}..."


def finite_number(
    name: str,
    value: Any,
    must: str = "be finite",
    *,
    low: float = -math.inf,
    high: float = math.inf,
) -> float:
    """One real number from `low` to `high`, neither NaN nor infinite.

    Parameters
    ----------
    name : str
        Of the argument.
    value : object
        An int or float, of Python or NumPy.
    must : str
        What it must, in the message.
    low, high : float
        Bounds, allowed themselves.

    Returns
    -------
    float
        The same.

    Raises
    ------
    ValueError
        For anything else: texts, arrays of numbers, records, yes and no.
    """
    number = _plain_number(value)
    if not (math.isfinite(number) and low <= number <= high):
        raise ValueError(f"{name} must {must}, got {shown(value)}")
    return number


def _plain_number(value: Any) -> float:
    """A real number as float; NaN for what is none."""
    is_of_numpy = isinstance(value, np.ndarray | np.generic) and value.dtype.kind in "uif"
    if isinstance(value, bool | np.ma.MaskedArray) or np.ndim(value) != 0:
        return math.nan
    if not (is_of_numpy or isinstance(value, int | float)):
        return math.nan
    try:
        return float(value)
    except OverflowError:
        return math.inf


def finite_numbers(
    name: str,
    values: Any,
    must: str = "be finite numbers",
    *,
    shapes: Iterable[tuple[int, ...]] | None = None,
    low: float = -math.inf,
    high: float = math.inf,
) -> NDArray[np.float64]:
    """An array of real numbers from `low` to `high`, none NaN, infinite or masked.

    Parameters
    ----------
    name : str
        Of the argument.
    values : array_like
        What was given.
    must : str
        What they must, in the message.
    shapes : iterable of tuple of int or None
        Shapes that it may have; None: any.
    low, high : float
        Bounds, allowed themselves.

    Returns
    -------
    array of float
        A copy.

    Raises
    ------
    ValueError
        For anything else.
    """
    array = real_numbers(name, values, must)
    if shapes is not None and array.shape not in tuple(shapes):
        raise ValueError(f"{name} must {must}, got {shown(values)}")
    fits = np.isfinite(array) & (array >= low) & (array <= high)
    if not fits.all():
        raise ValueError(f"{name} must {must}, got {array[~fits].flat[0]}")
    return array


def real_numbers(name: str, values: Any, must: str = "be numbers") -> NDArray[np.float64]:
    """An array of real numbers as a copy, NaN and infinities among them; ValueError for others."""
    return array_of_numbers(name, values, must, kinds="uif").astype(np.float64)


def array_of_numbers(
    name: str, values: Any, must: str = "be an array of numbers", *, kinds: str = "buif"
) -> NDArray[Any]:
    """An array of numbers as they are; ValueError for texts, dates, objects and what is ragged.

    Parameters
    ----------
    name : str
        Of the argument.
    values : array_like
        What was given.
    must : str
        What they must, in the message.
    kinds : str
        Those of NumPy that may be: b, u, i, f.

    Returns
    -------
    array
        Not copied.

    Raises
    ------
    ValueError
        For other kinds, and where some are masked.
    """
    refuse_masks(name, values)
    try:
        array = np.asarray(values)
    except (TypeError, ValueError):
        array = np.empty(0, dtype=object)
    if array.dtype.kind not in kinds:
        raise ValueError(f"{name} must {must}, got {shown(values)}")
    return array


def one_of(name: str, value: Any, names: Iterable[str]) -> None:
    """Raise ValueError where a value is none of the names it may have."""
    names = tuple(names)
    if not isinstance(value, str) or value not in names:
        told = ", ".join(f'"{one}"' for one in names)
        raise ValueError(f"{name} must be one of {told}, got {shown(value)}")


def whole_number(name: str, value: Any) -> int:
    """A whole number as int: what is used as an index may not be 1.0.

    Parameters
    ----------
    name : str
        What it is, for the message.
    value : object
        An int, of Python or NumPy.

    Returns
    -------
    int
        The same.

    Raises
    ------
    ValueError
        For anything else.
    """
    try:
        if isinstance(value, bool | np.bool_):
            raise TypeError
        return operator.index(value)
    except TypeError:
        raise ValueError(f"{name} must be a whole number, got {shown(value)}") from None


def yes_or_no(name: str, value: Any) -> bool:
    """True or False, also told as 1 or 0; ValueError for anything else."""
    number = float(value) if isinstance(value, bool | np.bool_) else _plain_number(value)
    if number not in (0.0, 1.0):
        raise ValueError(f"{name} must be True or False, got {shown(value)}")
    return bool(number)


def pixels_of_shape(shape: Any) -> tuple[int, int]:
    """(rows, cols) as ints; ValueError for what is no shape of a camera."""
    try:
        rows, cols = shape
    except (TypeError, ValueError):
        raise ValueError(f"shape must be (rows, cols), got {shown(shape)}") from None
    rows, cols = whole_number("rows in shape", rows), whole_number("cols in shape", cols)
    if rows < 1 or cols < 1:
        raise ValueError(f"shape must be (rows, cols) of at least one pixel, got {shown(shape)}")
    return rows, cols


def mask_of_pixels(name: str, mask: Any, shape: tuple[int, int]) -> NDArray[np.bool_]:
    """A mask (rows, cols) as booleans; ValueError for what is no yes or no of each pixel."""
    refuse_masks(name, mask)
    try:
        told = np.asarray(mask)
    except ValueError:
        raise ValueError(f"{name} must be an array of booleans, got {shown(mask)}") from None
    if told.shape != tuple(shape):
        raise ValueError(f"{name} must have the camera's shape {tuple(shape)}, got {told.shape}")
    # NaN, a text and -1 would all be True, None and a date False.
    if told.dtype.kind not in "buif" or not ((told == 0) | (told == 1)).all():
        raise ValueError(f"{name} must hold True or False (1 or 0) for each pixel")
    return told.astype(bool)


def refuse_masks(name: str, values: object) -> None:
    """Raise ValueError for arrays with masked elements: nothing here looks at masks."""
    if isinstance(values, np.ma.MaskedArray) and np.ma.is_masked(values):
        raise ValueError(
            f"{name} are masked in places: fill them ({name}.filled(0)) and give "
            "reconstruct(exclude_mask=) the pixels to leave out"
        )


_MARKS = {
    "camera": ("pixels_from_points", "a Camera, such as Camera.facing_plane(...)"),
    "source": ("position_std_xyz_mm", "a Source, such as Source((0, 0, 0))"),
    "medium": ("path_group_index", "a Medium"),
    "timing": ("check_matches", "a TimingCalibration: calibrate_timing or TimingCalibration.load"),
    "background": ("counts", "Histograms"),
    "hist": ("counts", "Histograms: Histograms(cube, ...), or histogram(read(...)) of a file"),
    "path": ("vertices_mm", "a LightPath"),
    "truth": ("vertices_mm", "the truth of a simulated recording"),
    "arrivals": ("photon_std_ps", "Arrivals, from find_arrivals"),
    "response": ("table", "a Response"),
    "scene": ("detector", "a Scene"),
    "detector": ("bin_width_ps", "a Detector"),
}
"""What each of them has that others have not, and what it is to be, in words."""


def check_kinds(*needed: str, lists: bool = False, **told: object) -> None:
    """Raise TypeError where an argument is not what its name says.

    Parameters
    ----------
    *needed : str
        Names of those that cannot be left out.
    lists : bool
        Whether there may be several, in a list or tuple.
    **told : object
        Arguments by name; None: left out.
    """
    for name, value in told.items():
        mark, words = _MARKS[name]
        if value is None and name in needed:
            raise TypeError(f"{name} must be {words}; got None")
        for one in value if lists and isinstance(value, list | tuple) else [value]:
            if one is not None and (isinstance(one, type) or not hasattr(one, mark)):
                raise TypeError(f"{name} must be {words}; got {shown(one)}")
