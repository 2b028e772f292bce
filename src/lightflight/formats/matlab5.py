"""Numbers and texts in a MATLAB v5 file (MATLAB's -v6 and -v7), and nothing else of it.

Read here and not by SciPy, which takes memory before it checks what a header claims, and
stumbles over files that hold MATLAB objects beside their arrays. Structures, cells, sparse and
complex arrays are passed over.

Format: The MathWorks, "MAT-File Format", chapter "Level 5 MAT-Files".
"""

from __future__ import annotations

import contextlib
import functools
import itertools
import math
import struct
import zlib
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO

import numpy as np

from lightflight.errors import FileFormatError
from lightflight.files.filecheck import check_claim, check_memory
from lightflight.formats.streamed import StreamedArray

_HEADER_BYTES = 128
_HEAD_BYTES = 4096
_MOST_DIMENSIONS = 32
_PACKED_AT_ONCE = 1 << 18
_MATRIX, _COMPRESSED = 14, 15
_CHAR = 4
_MOST_VARIABLES = 10_000
_NUMBERS = range(6, 16)
_COMPLEX = 0x0800
_DTYPE_FROM_TYPE = {
    1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 9: "f8", 12: "i8", 13: "u8",
    16: "u1", 17: "u2", 18: "u4",
}  # fmt: skip


@dataclass(frozen=True)
class Variable:
    """Where one array of numbers or one text lies, from its header.

    Attributes
    ----------
    name : str
        Its name.
    shape : tuple of int
        What MATLAB's size() shows.
    is_text : bool
        A text, not numbers.
    dtype : np.dtype[np.generic]
        Type the elements are stored as; MATLAB stores whole doubles as integers.
    offset : int
        Byte of the file where the element (compressed: its stream) starts.
    n_packed : int or None
        Bytes of the compressed stream; None where it is not compressed.
    skip : int
        Bytes from there (compressed: of what comes out) to the first number.
    n_bytes : int
        Bytes of the content; for numbers, those the shape needs.
    """

    name: str

    shape: tuple[int, ...]

    is_text: bool

    dtype: np.dtype[np.generic]

    offset: int

    n_packed: int | None

    skip: int

    n_bytes: int


def variables_in(path: Path) -> list[Variable]:
    """All arrays of numbers and texts, from their headers alone.

    Raises
    ------
    FileFormatError
        If the file is cut or its headers contradict each other.
    """
    with path.open("rb") as file:
        order = _byte_order(file.read(_HEADER_BYTES), path)
        return list(_scan(file, order, path))


def _byte_order(header: bytes, path: Path) -> str:
    mark = header[126:128]
    if len(header) < _HEADER_BYTES or mark not in (b"IM", b"MI"):
        raise FileFormatError(
            "is no MATLAB v5 file: save it with -v7 or -v7.3, or check the name", path=path
        )
    return "<" if mark == b"IM" else ">"


def _scan(file: BinaryIO, order: str, path: Path) -> Iterator[Variable]:
    size = path.stat().st_size
    offset = _HEADER_BYTES
    for number in itertools.count():
        if offset >= size:
            return
        if number >= _MOST_VARIABLES:
            raise FileFormatError(
                f"holds more than {_MOST_VARIABLES} variables: save the one array", path=path
            )
        file.seek(offset)
        tag = file.read(8)
        if len(tag) < 8:
            raise FileFormatError("ends in the middle of an array", path=path, offset=offset)
        kind, n_bytes = struct.unpack(f"{order}II", tag)
        if offset + 8 + n_bytes > size:
            raise FileFormatError(
                f"is truncated: an array claims {n_bytes} bytes, {size - offset - 8} are there",
                path=path,
                offset=offset,
            )
        # Headers stand at the start: the numbers are read once one array has been chosen.
        body = file.read(min(n_bytes, _HEAD_BYTES))
        if kind == _COMPRESSED:
            head = _unpacked_head(body, path, offset)
            variable = _variable_from(head[8:], order, offset + 8, n_bytes, path)
        elif kind == _MATRIX:
            variable = _variable_from(body, order, offset + 8, None, path)
        else:
            raise FileFormatError(
                f"holds an element of unknown type {kind}: the file is damaged",
                path=path,
                offset=offset,
            )
        if variable is not None:
            yield variable
        offset += 8 + n_bytes


def _unpacked_head(packed: bytes, path: Path, offset: int) -> bytes:
    try:
        # The head of a stream unpacks although its end was cut off here.
        return zlib.decompressobj().decompress(packed, _HEAD_BYTES)
    except zlib.error as error:
        raise FileFormatError(
            f"holds a damaged compressed array ({error})", path=path, offset=offset
        ) from error


def _variable_from(
    head: bytes, order: str, offset: int, n_packed: int | None, path: Path
) -> Variable | None:
    """Variable from the start of a matrix element; None for what is neither numbers nor text."""
    try:
        _, flags, at = _element(head, 0, order)
        (flag_word,) = struct.unpack_from(f"{order}I", flags)
        array_class = flag_word & 0xFF
        is_numbers = array_class in _NUMBERS and not flag_word & _COMPLEX
        if not is_numbers and array_class != _CHAR:
            return None
        _, lengths, at = _element(head, at, order)
        shape = struct.unpack(f"{order}{len(lengths) // 4}i", lengths)
        _, name, at = _element(head, at, order)
        kind, n_bytes, start = _tag(head, at, order)
    except struct.error as error:
        raise FileFormatError("an array has a broken header", path=path, offset=offset) from error
    if kind not in _DTYPE_FROM_TYPE or not 2 <= len(shape) <= _MOST_DIMENSIONS or min(shape) < 0:
        raise FileFormatError("an array has a broken header", path=path, offset=offset)
    dtype = np.dtype(order + _DTYPE_FROM_TYPE[kind])
    variable = Variable(
        name=name.decode("ascii", "replace"),
        shape=shape,
        is_text=array_class == _CHAR,
        dtype=dtype,
        offset=offset,
        n_packed=n_packed,
        # A compressed stream starts with the tag of the matrix.
        skip=start + (8 if n_packed is not None else 0),
        n_bytes=n_bytes,
    )
    needed = math.prod(shape) * dtype.itemsize
    if n_bytes != needed and not variable.is_text:
        raise FileFormatError(
            f"array {variable.name!r} {shape} needs {needed} bytes and claims {n_bytes}: the file "
            "is damaged",
            path=path,
            offset=offset,
        )
    return variable


def _tag(block: bytes, at: int, order: str) -> tuple[int, int, int]:
    """(type, bytes, start of the content) of the element at `at`; small ones share a word."""
    (word,) = struct.unpack_from(f"{order}I", block, at)
    if word >> 16:
        return word & 0xFFFF, word >> 16, at + 4
    (n_bytes,) = struct.unpack_from(f"{order}I", block, at + 4)
    return word, n_bytes, at + 8


def _element(block: bytes, at: int, order: str) -> tuple[int, bytes, int]:
    """(type, content, start of the next element)."""
    kind, n_bytes, start = _tag(block, at, order)
    if start + n_bytes > len(block):
        raise struct.error("element is longer than the header")
    end = at + 8 if start == at + 4 else start + -(-n_bytes // 8) * 8
    return kind, block[start : start + n_bytes], end


def array_of(variable: Variable, path: Path) -> StreamedArray:
    """Numbers of a variable, read when they are asked for, the axes of MATLAB backwards.

    MATLAB's first axis runs fastest: backwards it is the order of the file.
    """
    _check_packing(variable, path)
    opened = functools.partial(_opened, variable, path)
    return StreamedArray(path, variable.shape[::-1], variable.dtype, opened, ends=True)


def text_of(variable: Variable, path: Path) -> str:
    """Letters of a text variable, in one line."""
    big = variable.dtype.byteorder == ">"
    encoding = {1: "utf-8", 2: "utf-16", 4: "utf-32"}.get(variable.dtype.itemsize, "utf-8")
    if encoding != "utf-8":
        encoding += "-be" if big else "-le"
    _check_packing(variable, path)
    check_memory(3 * variable.n_bytes, path=path, what=f"text {variable.name!r}")
    with _opened(variable, path) as stream:
        content = stream.read(variable.n_bytes)
        stream.read(1)  # to its checksum
    return content.decode(encoding, "replace")


def _check_packing(variable: Variable, path: Path) -> None:
    if variable.n_packed is not None:
        what = f"array {variable.name!r} {variable.shape}"
        check_claim(variable.n_bytes, variable.n_packed, path=path, what=what)


@contextlib.contextmanager
def _opened(variable: Variable, path: Path) -> Iterator[_Numbers]:
    with path.open("rb") as file:
        file.seek(variable.offset)
        yield _Numbers(file, variable, path)


class _Numbers:
    """The content of a variable as a stream, unpacked as it is read."""

    def __init__(self, file: BinaryIO, variable: Variable, path: Path) -> None:
        self._file, self._path, self._offset = file, path, variable.offset
        self._packed = None if variable.n_packed is None else zlib.decompressobj()
        self._left = variable.n_packed or 0
        self._ready = b""
        self._content = variable.n_bytes
        if self._packed is None:
            file.seek(variable.offset + variable.skip)
        else:
            self._unpacked(variable.skip)

    def read(self, n: int, /) -> bytes:
        """So many bytes; b"" behind the content, once the checksum of the stream has been seen."""
        wanted = min(n, self._content)
        block = self._file.read(wanted) if self._packed is None else self._unpacked(wanted)
        self._content -= len(block)
        if self._content == 0 and n > wanted:
            self._see_checksum()
        return block

    def _unpacked(self, n: int) -> bytes:
        assert self._packed is not None
        blocks = []
        while n > 0 and not self._packed.eof:
            if not self._ready:
                self._ready = self._file.read(min(self._left, _PACKED_AT_ONCE))
                self._left -= len(self._ready)
                if not self._ready:
                    break
            # No more than was asked for: a small stream can unpack to gigabytes.
            blocks.append(self._packed.decompress(self._ready, n))
            self._ready = self._packed.unconsumed_tail
            n -= len(blocks[-1])
        return b"".join(blocks)

    def _see_checksum(self) -> None:
        """Raise FileFormatError where a packed stream has no sound end: what it gave may be false.

        Elements are padded to whole words of eight bytes.
        """
        if self._packed is None:
            return
        self._unpacked(8)
        if not self._packed.eof:
            raise FileFormatError(
                "a compressed array has no sound end: the file is damaged",
                path=self._path,
                offset=self._offset,
            )
