"""Arrays that stay in an HDF5 file and are read in parts."""

from __future__ import annotations

import math
import os
from dataclasses import dataclass

import h5py
import numpy as np
from numpy.typing import DTypeLike, NDArray

from lightflight.files.chunked import read_in_parts
from lightflight.files.filecheck import (
    ANY_MOST,
    check_claim,
    check_memory,
    damage_as_format_error,
)
from lightflight.files.store import check_dataset


@dataclass(frozen=True, eq=False)
class StoredArray:
    """One dataset of an HDF5 file; slicing opens the file, reads that part and closes it.

    Holds no open file: it can be pickled and used by several threads or workers at once.

    Attributes
    ----------
    path : str
        The file.
    name : str
        Dataset in it.
    shape : tuple of int
        Length of each axis.
    dtype : np.dtype[np.generic]
        Type of the elements, native byte order.
    chunks : tuple of int or None
        Lengths of the blocks it is packed in.
    """

    path: str

    name: str

    shape: tuple[int, ...]

    dtype: np.dtype[np.generic]

    chunks: tuple[int, ...] | None = None

    @classmethod
    def of(
        cls, dataset: h5py.Dataset, *, path: str | os.PathLike[str], ours: bool = True
    ) -> StoredArray:
        """Array of an open dataset.

        Parameters
        ----------
        dataset : h5py.Dataset
            Of a file that may be closed afterwards.
        path : path
            The file.
        ours : bool
            Whether this package wrote it (`store.check_dataset`).

        Raises
        ------
        FileFormatError
            Where `store.check_dataset` does.
        """
        check_dataset(dataset, path=path, ours=ours)
        dtype = dataset.dtype.newbyteorder("=")
        where = os.path.abspath(path)  # noqa: PTH100
        return cls(where, dataset.name, dataset.shape, dtype, dataset.chunks)

    @classmethod
    def streamed(cls, dataset: h5py.Dataset, *, path: str | os.PathLike[str]) -> StoredArray:
        """Array of somebody else's that is read through to its end, in parts.

        Raises
        ------
        FileFormatError
            Where `of` does, and where it claims more than can be stored: that takes no memory, but
            time without end.
        """
        found = cls.of(dataset, path=path, ours=False)
        n_bytes = math.prod(found.shape) * found.dtype.itemsize
        what = f"array {found.name} {found.shape}"
        check_claim(n_bytes, dataset.id.get_storage_size(), path=path, what=what, most=ANY_MOST)
        return found

    def __len__(self) -> int:
        """Length of the first axis."""
        return self.shape[0]

    def __getitem__(self, key: object) -> NDArray[np.generic]:
        """Part of it, read now."""
        with damage_as_format_error(self.path), h5py.File(self.path, "r") as file:
            return np.asarray(read_in_parts(file[self.name], key), self.dtype)

    def __array__(
        self, dtype: DTypeLike | None = None, copy: bool | None = None
    ) -> NDArray[np.generic]:
        """All of it, after checking that it fits into memory."""
        n_bytes = math.prod(self.shape) * self.dtype.itemsize
        check_memory(n_bytes, path=self.path, what=f"array {self.name} {self.shape}")
        return np.asarray(self[()], dtype)
