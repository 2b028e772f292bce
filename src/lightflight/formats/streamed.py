"""Arrays that are read from their file in slabs, so that none is in memory twice."""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import DTypeLike, NDArray

from lightflight.errors import FileFormatError
from lightflight.files.filecheck import check_memory
from lightflight.recording.histograms import counts_dtype, counts_from_slabs
from lightflight.recording.recording import SlicedArray

SLAB_BYTES = 16 << 20
"""Bytes read at a time, where the array can be cut so."""

_STREAM_BYTES = 1 << 20
"""The same of a stream: so little stays in the processor's cache while it is looked at."""


class Stream(Protocol):
    """What an array is read from: the bytes of its elements, from the first on."""

    def read(self, n: int, /) -> bytes:
        """So many bytes; fewer at the end."""


@dataclass(frozen=True, eq=False)
class StreamedArray:
    """Elements one after another in a file, packed or not, as rows of the first axis.

    Attributes
    ----------
    path : path
        The file.
    shape : tuple of int
        Length of each axis.
    dtype : np.dtype[np.generic]
        Type of the elements, as they are stored.
    opened : Callable[[], AbstractContextManager[Stream]]
        Opens the file where the elements start.
    ends : bool
        The stream ends with the array: what comes behind is an error, and checksums are seen.
    """

    path: str | os.PathLike[str]
    shape: tuple[int, ...]
    dtype: np.dtype[np.generic]
    opened: Callable[[], AbstractContextManager[Stream]]
    ends: bool

    def slabs(self) -> Iterator[NDArray[np.generic]]:
        """Rows of the first axis, some at a time; FileFormatError where the stream is cut."""
        n_rows = self.shape[0] if self.shape else 1
        row = math.prod(self.shape[1:])
        step = max(1, _STREAM_BYTES // max(1, row * self.dtype.itemsize))
        with self.opened() as stream:
            for first in range(0, n_rows if row else 0, step):
                n = min(step, n_rows - first)
                block = _exactly(stream, n * row * self.dtype.itemsize, self.path)
                yield np.frombuffer(block, self.dtype).reshape(n, *self.shape[1:])
            if self.ends and stream.read(1):
                raise FileFormatError(
                    f"holds more than its array {self.shape}: it is damaged", path=self.path
                )

    def __array__(
        self, dtype: DTypeLike | None = None, copy: bool | None = None
    ) -> NDArray[np.generic]:
        """All of it, after checking that it fits into memory."""
        n_bytes = math.prod(self.shape) * self.dtype.itemsize
        check_memory(n_bytes, path=self.path, what=f"an array {self.shape}")
        whole = np.empty(self.shape, self.dtype.newbyteorder("="))
        rows, first = whole if self.shape else whole.reshape(1), 0
        for slab in self.slabs():
            rows[first : first + len(slab)] = slab
            first += len(slab)
        return whole if dtype is None else whole.astype(dtype)


def _exactly(stream: Stream, n: int, path: str | os.PathLike[str]) -> bytes:
    block = stream.read(n)
    if len(block) < n:
        raise FileFormatError(
            f"ends in the middle of an array ({len(block)} of {n} bytes): it is damaged", path=path
        )
    return block


def slabs_of(source: SlicedArray) -> Iterator[NDArray[np.generic]]:
    """Rows of the first axis of any array that can be sliced, whole chunks at a time."""
    if hasattr(source, "slabs"):
        yield from source.slabs()
        return
    step = _step_of(source)
    for first in range(0, source.shape[0], step):
        yield np.asarray(source[first : first + step])


def _step_of(source: SlicedArray) -> int:
    """Rows in a slab."""
    row_bytes = max(1, math.prod(source.shape[1:]) * int(source.dtype.itemsize))
    chunks = getattr(source, "chunks", None)
    thick = max(1, int(chunks[0])) if chunks else 1
    return int(max(1, SLAB_BYTES // row_bytes // thick) * thick)


def cube_from(
    source: Any,
    order: tuple[int, ...],
    shape: tuple[int, int, int],
    *,
    poisson: bool,
    path: str | os.PathLike[str],
) -> NDArray[np.generic]:
    """Counts (rows, cols, codes), read-only, from an array of others, slab by slab.

    Parameters
    ----------
    source : array
        Numbers; anything with shape, dtype and slices, or with `slabs`.
    order : tuple of int
        Which axis of `source` each axis of the cube is.
    shape : (int, int, int)
        Rows, columns and codes; of as many elements.
    poisson : bool
        False for scaled intensities.
    path : path
        The file, for the message.

    Returns
    -------
    array
        As `Histograms` takes it without a copy.

    Raises
    ------
    FileFormatError
        Where it does not fit into memory.
    ValueError
        For what cannot be counts.
    """
    slab = min(_step_of(source), source.shape[0]) * math.prod(source.shape[1:])
    per_element = counts_dtype(source.dtype, poisson=poisson).itemsize
    # Beside the cube: a slab as it is stored, as it is checked and as it is packed.
    rounded = 16 if source.dtype.kind == "f" else 0
    needed = math.prod(shape) * per_element + slab * (3 * source.dtype.itemsize + rounded)
    check_memory(needed, path=path, what=f"a cube {shape}")
    is_plain = isinstance(source, np.ndarray) and not isinstance(source, np.memmap)
    if is_plain and source.dtype.kind == "u" and order == tuple(range(source.ndim)):
        source.setflags(write=False)
        return np.reshape(source, shape)
    return counts_from_slabs(slabs_of(source), source.dtype, shape, order=order, poisson=poisson)
