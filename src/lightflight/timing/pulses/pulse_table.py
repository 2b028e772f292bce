"""What tables of pulses have in common: one row a pulse, some flagged, each column a picture."""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lightflight import flags as fl
from lightflight.display import (
    Card,
    Labelled,
    Tabled,
    count_facts,
    flag_facts,
    number,
    picture_from_image,
    size_facts,
)


class PulseTable(Tabled, Labelled):
    """Columns of `Pulses` and of `Arrivals`, which say what each is."""

    row: NDArray[np.int32]
    col: NDArray[np.int32]
    photons: NDArray[np.float64]
    flags: NDArray[np.uint32]
    shape: tuple[int, int]

    @property
    def usable(self) -> NDArray[np.bool_]:
        """(n,), True where no flag keeps the pulse out of a reconstruction."""
        return fl.is_usable(self.flags)

    def image(self, name: str) -> NDArray[Any]:
        """One column as a picture (rows, cols), of the strongest pulse of each pixel.

        Parameters
        ----------
        name : str
            Name of the column ("photons", "flags" ...), or "n_pulses".

        Returns
        -------
        array, shape (rows, cols)
            NaN (0 for integers) where a pixel has no pulse.

        Raises
        ------
        ValueError
            There is no such column.
        """
        pixel = self.row.astype(np.int64) * self.shape[1] + self.col
        size = self.shape[0] * self.shape[1]
        if name == "n_pulses":
            return np.bincount(pixel[np.isfinite(self.photons)], minlength=size).reshape(self.shape)
        column = getattr(self, name, None)
        if not isinstance(column, np.ndarray) or column.shape != pixel.shape:
            raise ValueError(f"there is no column {name!r} to draw: use one of the table's columns")
        weakest_first = np.argsort(np.nan_to_num(self.photons, nan=-np.inf), kind="stable")
        if column.dtype.kind == "f":
            image = np.full(size, np.nan)
        else:
            image = np.zeros(size, dtype=column.dtype)
        image[pixel[weakest_first]] = column[weakest_first]
        return image.reshape(self.shape)

    def card_of(self, column: str, what: str, error_ps: NDArray[np.float64]) -> Card:
        """How many pulses, what is wrong with them, and a column's picture, with its errors."""
        usable = self.usable
        values = np.asarray(getattr(self, column), dtype=float)[usable]
        values = values[np.isfinite(values)]
        facts = size_facts(self.shape)
        facts.append(("pulses", f"{len(self.row)}, {int(usable.sum())} usable"))
        if values.size:
            facts.append((what, f"{number(values.min(), 6)} \u2026 {number(values.max(), 6)} ps"))
            typical = float(np.nanmedian(error_ps[usable]))
            facts.append(("typical error", f"{number(typical, 2)} ps"))
            facts += count_facts(photons=float(np.nansum(self.photons[usable])))
        facts += flag_facts(self.flags)
        picture = partial(picture_from_image, self.image(column))
        return Card(type(self).__name__, facts, picture, f"{what} by pixel")
