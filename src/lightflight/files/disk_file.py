"""A file for the HDF5 library to write to, which neither a full disk nor Ctrl-C can crash."""

from __future__ import annotations

import contextlib
import io
import os
import signal
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from _typeshed import ReadableBuffer, WriteableBuffer


@contextlib.contextmanager
def interrupts_to(disk: DiskFile) -> Iterator[None]:
    """Hold back Ctrl-C until the next `check`: raised inside HDF5 it would be lost.

    Python delivers it to the main thread alone; in any other there is nothing to do.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    # Ignored, or not set by Python: then there is nothing to hold back.
    usual = signal.getsignal(signal.SIGINT)
    if not callable(usual):
        yield
        return
    signal.signal(signal.SIGINT, lambda number, frame: disk.fail(KeyboardInterrupt()))
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, usual)
    disk.check()  # it may have come after the last one


class DiskFile(io.RawIOBase):
    """A file for HDF5 to write to that never fails in HDF5's sight.

    The HDF5 library crashes the process when a disk fills up under it. Here the first error is
    kept for `check`, and what cannot be written is held in memory until the file is closed.
    """

    def __init__(self, path: Path) -> None:
        super().__init__()
        self._file = path.open("w+b", buffering=0)
        self._position = 0
        self._error: BaseException | None = None
        self._unwritten: list[tuple[int, bytes]] = []

    def check(self) -> None:
        """Raise the first error that writing met, if any."""
        if self._error is not None:
            raise self._error

    def fail(self, error: BaseException) -> None:
        """Write no more; `check` raises `error`, unless there was another before it."""
        self._error = self._error or error

    def readable(self) -> bool:
        """True: HDF5 reads back what it wrote."""
        return True

    def writable(self) -> bool:
        """True."""
        return True

    def seekable(self) -> bool:
        """True."""
        return True

    def seek(self, offset: int, whence: int = os.SEEK_SET) -> int:
        """Move to a byte; the end counts what could not be written too."""
        if whence == os.SEEK_END:
            size = self._file.seek(0, os.SEEK_END)
            ends = [start + len(block) for start, block in self._unwritten]
            offset += max([size, *ends])
        elif whence == os.SEEK_CUR:
            offset += self._position
        self._position = offset
        return offset

    def tell(self) -> int:
        """The byte where the next read or write starts."""
        return self._position

    def truncate(self, size: int | None = None) -> int:
        """Set the length of the file."""
        size = self._position if size is None else size
        try:
            self._file.truncate(size)
        except BaseException as error:  # noqa: BLE001  (see the class: HDF5 must not see it)
            self.fail(error)
        return size

    def write(self, block: ReadableBuffer) -> int:
        """Take all of `block`, whether it can be written or not."""
        n_bytes = memoryview(block).nbytes
        try:
            if self._error is None:
                self._write_all(memoryview(block).cast("B"))
        except BaseException as error:  # noqa: BLE001
            self.fail(error)
        if self._error is not None:
            # HDF5 will read it back, and must find what it wrote.
            self._unwritten.append((self._position, bytes(block)))
        self._position += n_bytes
        return n_bytes

    def _write_all(self, block: memoryview) -> None:
        self._file.seek(self._position)
        # Unbuffered, a write may take a part only.
        while block.nbytes:
            block = block[self._file.write(block) :]

    def readinto(self, buffer: WriteableBuffer) -> int:
        """Fill `buffer`; beyond the end are zeros."""
        view = memoryview(buffer).cast("B")
        view[:] = bytes(view.nbytes)
        self._file.seek(self._position)
        self._file.readinto(view)
        for start, block in self._unwritten:
            here = self._position
            low, high = max(start, here), min(start + len(block), here + view.nbytes)
            if low < high:
                view[low - here : high - here] = block[low - start : high - start]
        self._position += view.nbytes
        return view.nbytes

    def close(self) -> None:
        """Close the file and forget what could not be written."""
        self._file.close()
        self._unwritten.clear()
        super().close()
