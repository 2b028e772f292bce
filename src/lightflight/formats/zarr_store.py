"""What a Zarr folder says of its arrays, read and judged before zarr itself looks at it.

A store names the programs that unpack it (codecs), and some of them run code (pickle) or take any
memory they are told to. Here every name is on a list, every number is held against the others,
each chunk says how long it becomes before it is unpacked, and nothing in the folder is a link, a
pipe or a device. Chunks that are not there are counted: zarr reads them as its fill value.

Formats: https://zarr-specs.readthedocs.io (versions 2 and 3); RFC 8878 (Zstandard), the headers
of Blosc 1 and of numcodecs' LZ4.
"""

from __future__ import annotations

import contextlib
import gzip
import io
import json
import math
import os
import re
import stat
import zlib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO

from lightflight.errors import FileFormatError

_WHOLE = [f"{sign}int{bits}" for sign in ("", "u") for bits in (8, 16, 32, 64)]
V3_TYPES = frozenset(["bool", "float16", "float32", "float64", *_WHOLE])
_V2_TYPE = re.compile(r"[<>|](b1|[iu][1248]|f[248])")

_SIMPLE = frozenset(["bytes", "transpose", "crc32c"])
_CHECKSUMS = frozenset(["crc32", "crc32c", "adler32", "fletcher32"])
_FILTERS = frozenset(["delta", "shuffle", "bitround", *_CHECKSUMS])
_COMPRESSORS = frozenset(["blosc", "zstd", "gzip", "zlib", "lz4"])
CODECS = _SIMPLE | _FILTERS | _COMPRESSORS | {"sharding_indexed"}
"""Names of what may unpack a store; "numcodecs." before one of them is the same."""

_METADATA_BYTES = 16 << 20
Metadata = Mapping[str, Any]
"""What JSON of a folder says of an array: whatever the file holds, until it is checked."""

_MOST_DIMENSIONS = 32
_MOST_LENGTH = 1 << 48
# What is no larger can do no harm, whatever it says.
_SPARE_BYTES = 1 << 16
_ABSENT = (1 << 64) - 1
_INDEX_ENTRY_BYTES = 16
# zarr takes 0.1 ms and 3 kB for a chunk, there or not: 6 s and 200 MB for nothing are enough.
_MOST_ABSENT, _ABSENT_PER_FOUND = 1 << 16, 16
_BEHIND = ("crc32c", "sharding_indexed")
_ZSTD_SKIPPED, _SUMS_BYTES = 0x184D2A50, 16


@dataclass(frozen=True)
class StoredChunks:
    """One array of a store: what its metadata say, and which of its chunks are there.

    Attributes
    ----------
    name : str
        Its path in the folder; "" where the folder is the array.
    zarr_format : int
        2 or 3.
    shape, chunks : tuple of int
        Lengths of the array, and of one chunk (with shards: of one shard).
    n_expected, n_found : int
        Chunks that the shape asks for, and those in the folder.
    stored_bytes : int
        Bytes of those.
    """

    name: str
    zarr_format: int
    shape: tuple[int, ...]
    chunks: tuple[int, ...]
    n_expected: int
    n_found: int
    stored_bytes: int


def checked_arrays(folder: Path) -> dict[str, Metadata]:
    """Metadata of all arrays in a folder, by name, after checking that they may be believed.

    Parameters
    ----------
    folder : Path
        A Zarr folder.

    Returns
    -------
    dict of str to mapping
        As they stand in the folder; "" names the folder itself.

    Raises
    ------
    FileFormatError
        For links, pipes and devices in the folder, and for types and codecs that are no numbers
        or not on the list.
    """
    found: dict[str, Metadata] = {}
    for place, names in _files_in(folder):
        name = place.relative_to(folder).as_posix() if place != folder else ""
        if ".zattrs" in names:
            _check_length(place / ".zattrs", folder)
        if "zarr.json" in names:
            known = _json_of(place / "zarr.json", folder)
            if known.get("node_type") == "array":
                found[name] = {**known, "zarr_format": 3}
        elif ".zarray" in names:
            found[name] = {**_json_of(place / ".zarray", folder), "zarr_format": 2}
    for name, metadata in found.items():
        _check_array(name, metadata, folder)
    return found


def _files_in(folder: Path) -> Iterator[tuple[Path, list[str]]]:
    """Folders with the names of their files; FileFormatError for all that is neither."""
    for place, below, files in os.walk(folder, onerror=_raise):
        for name in (*below, *files):
            mode = os.lstat(os.path.join(place, name)).st_mode  # noqa: PTH118  (Path takes long)
            if not (stat.S_ISREG(mode) or stat.S_ISDIR(mode)):
                kind = "link" if stat.S_ISLNK(mode) else "pipe or device"
                where = os.path.relpath(os.path.join(place, name), folder)  # noqa: PTH118
                raise FileFormatError(
                    f"holds a {kind} ({where}), which is not followed: copy what it stands for "
                    "into the folder",
                    path=folder,
                )
        yield Path(place), files


def _raise(error: OSError) -> None:
    raise error


def _check_length(file: Path, folder: Path) -> None:
    if file.stat().st_size > _METADATA_BYTES:
        raise FileFormatError(f"{file.name} is too large: the folder is damaged", path=folder)


def _json_of(file: Path, folder: Path) -> dict[str, Any]:
    _check_length(file, folder)
    try:
        found = json.loads(file.read_bytes())
    except (ValueError, RecursionError):
        found = None
    if not isinstance(found, dict):
        raise FileFormatError(f"{file.name} is not readable: the folder is damaged", path=folder)
    return found


# --- what the metadata say --------------------------------------------------------------


class _OtherKindError(ValueError):
    """A sound array of a kind that nobody reads here."""


def _check_array(name: str, metadata: Metadata, folder: Path) -> None:
    """Raise FileFormatError for metadata that could run code or contradict themselves."""
    try:
        shape, chunks = _lengths(metadata["shape"]), _chunk_lengths(metadata)
        if len(shape) != len(chunks) or min(chunks, default=1) < 1:
            raise ValueError(f"chunks {chunks} do not divide the shape {shape}")
        _item_bytes(metadata)
        codecs = [one for one, _ in _codecs_of(metadata)]
    except _OtherKindError as error:
        raise FileFormatError(
            f"array {name!r} is not read: {error}; save counts as numbers on a regular grid of "
            "chunks",
            path=folder,
        ) from None
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise FileFormatError(
            f"array {name!r} cannot be read ({error}): the folder is damaged", path=folder
        ) from None
    unknown = [one for one in codecs if one not in CODECS]
    if unknown:
        raise FileFormatError(
            f"array {name!r} is packed by {unknown[0]!r}, which may run code: only "
            f"{', '.join(sorted(CODECS))} are unpacked; save it with one of them",
            path=folder,
        )
    packers = [k for k, one in enumerate(codecs) if one in _COMPRESSORS]
    # What is outermost says how long a chunk becomes; a checksum behind it does not hide that.
    outer = [one for one in codecs[packers[0] + 1 :] if one not in _BEHIND] if packers else []
    # The index of shards is where they end: nothing may be packed around them, no shards either.
    if outer or "sharding_indexed" in codecs[:-1]:
        raise FileFormatError(
            f"array {name!r} is packed in several layers ({', '.join(codecs[-6:])}): save it with "
            "one",
            path=folder,
        )


def _lengths(value: object) -> tuple[int, ...]:
    if not isinstance(value, list) or len(value) > _MOST_DIMENSIONS:
        raise ValueError("its shape is no list of lengths")
    if not all(type(one) is int and 0 <= one < _MOST_LENGTH for one in value):
        raise ValueError(f"its lengths cannot be {value}"[:99])
    return tuple(value)


def _chunk_lengths(metadata: Metadata) -> tuple[int, ...]:
    if metadata["zarr_format"] == 2:
        return _lengths(metadata["chunks"])
    grid = metadata["chunk_grid"]
    if grid["name"] != "regular":
        raise _OtherKindError(f"its chunks form no regular grid but {grid['name']!r}")
    return _lengths(grid["configuration"]["chunk_shape"])


def _item_bytes(metadata: Metadata) -> int:
    """Bytes of one element; ValueError for what is no number."""
    if metadata["zarr_format"] == 2:
        dtype = metadata["dtype"]
        if not isinstance(dtype, str) or _V2_TYPE.fullmatch(dtype) is None:
            raise _OtherKindError(f"it holds {str(dtype)[:40]!r}, no numbers")
        return int(dtype[2:])
    kind = metadata["data_type"]
    if not isinstance(kind, str) or kind not in V3_TYPES:
        raise _OtherKindError(f"it holds {str(kind)[:40]!r}, no numbers")
    if metadata.get("storage_transformers"):
        raise _OtherKindError("it names storage transformers")
    return 1 if kind == "bool" else int(re.sub(r"\D", "", kind)) // 8


def _codecs_of(metadata: Metadata) -> list[tuple[str, Metadata]]:
    """(name, settings) of all codecs, those within shards too; the outermost last."""
    if metadata["zarr_format"] == 2:
        listed = [*(metadata.get("filters") or ()), metadata.get("compressor")]
        found = [(str(one["id"]), one) for one in listed if one is not None]
    else:
        found = _codecs_in(metadata["codecs"])
    for name, settings in found:
        for key in ("dtype", "astype"):
            told = settings.get(key, "|u1")
            if not isinstance(told, str) or _V2_TYPE.fullmatch(told) is None:
                raise ValueError(f"codec {name!r} makes {str(told)[:40]!r} of numbers")
    return [(name.removeprefix("numcodecs."), settings) for name, settings in found]


def _codecs_in(listed: Any) -> list[tuple[str, Metadata]]:
    found: list[tuple[str, Metadata]] = []
    for one in listed:
        name, settings = (
            (one, {}) if isinstance(one, str) else (one["name"], one.get("configuration"))
        )
        settings = settings or {}
        if name == "sharding_indexed":
            _check_shards(settings)
            found += _codecs_in(settings["codecs"])
        found.append((str(name), settings))
    return found


def _check_shards(settings: Metadata) -> None:
    """Shards whose index is the one of the specification: else the chunks in it are not seen."""
    index = [one if isinstance(one, str) else one["name"] for one in settings["index_codecs"]]
    if index not in (["bytes"], ["bytes", "crc32c"]):
        raise ValueError(f"the index of its shards is packed by {index}")


# --- what the chunks say ----------------------------------------------------------------


def checked_chunks(folder: Path, name: str, metadata: Metadata) -> StoredChunks:
    """Chunks of an array, after asking each how long it becomes.

    Parameters
    ----------
    folder : Path
        A Zarr folder.
    name : str
        Which array of it.
    metadata : mapping of str
        From `checked_arrays`.

    Returns
    -------
    StoredChunks
        How many there are, of how many.

    Raises
    ------
    FileFormatError
        For a chunk that would become longer than a chunk of this array is, and where hardly any
        of very many chunks is there.
    """
    shape, chunks = _lengths(metadata["shape"]), _chunk_lengths(metadata)
    grid = [-(-length // chunk) for length, chunk in zip(shape, chunks, strict=True)]
    place = folder / name
    codecs = _codecs_of(metadata)
    packer = next((one for one, _ in codecs if one in _COMPRESSORS), None)
    shards = next((known for one, known in codecs if one == "sharding_indexed"), None)
    inner = chunks if shards is None else _lengths(shards["chunk_shape"])
    # A filter may have made wider numbers of them.
    most = math.prod(inner) * max(8, _item_bytes(metadata)) + _SPARE_BYTES
    per_shard = math.prod(-(-a // b) for a, b in zip(chunks, inner, strict=True)) if shards else 1
    if _INDEX_ENTRY_BYTES * per_shard > _METADATA_BYTES:
        raise FileFormatError(
            f"array {name!r} asks for {per_shard} chunks in each shard: it is damaged, or save it "
            "in larger ones",
            path=folder,
        )
    # What does not shrink grows a little; what is longer would only be read.
    longest = most + most // 64
    n_found = n_bytes = 0
    for file in _chunk_files(place, grid, metadata):
        size = file.stat().st_size
        if size > per_shard * (longest + _INDEX_ENTRY_BYTES):
            where = file.relative_to(folder)
            raise FileFormatError(
                f"chunk {where} has {size} bytes, a multiple of what it stands for: the folder is "
                "damaged",
                path=folder,
            )
        n_bytes += size
        with file.open("rb") as stream:
            for start, length in _pieces(stream, per_shard, shards):
                if start + length > size:
                    raise FileFormatError(
                        f"chunk {file.relative_to(folder)} is cut, or its index is damaged: copy "
                        "the folder again",
                        path=folder,
                    )
                n_found += 1
                stream.seek(start)
                _check_piece(stream, length, packer, most, file.relative_to(folder), folder)
    # Shards may reach beyond the array, whose chunks end with it.
    n_expected = math.prod(-(-a // b) for a, b in zip(shape, inner, strict=True))
    if n_expected > _MOST_ABSENT + _ABSENT_PER_FOUND * n_found:
        raise FileFormatError(
            f"array {name!r} {shape} asks for {n_expected} chunks, of which {n_found} are there: "
            "it is damaged, or save it in larger ones",
            path=folder,
        )
    return StoredChunks(
        name=name,
        zarr_format=metadata["zarr_format"],
        shape=shape,
        chunks=chunks,
        n_expected=n_expected,
        n_found=n_found,
        stored_bytes=n_bytes,
    )


def _chunk_files(place: Path, grid: Sequence[int], metadata: Metadata) -> Iterator[Path]:
    """Files that are chunks of this array, by their names."""
    encoding: Metadata = metadata.get("chunk_key_encoding") or {"name": "v2"}
    prefixed = metadata["zarr_format"] == 3 and encoding["name"] == "default"
    told = (encoding.get("configuration") or {}).get("separator")
    separator = told or metadata.get("dimension_separator") or ("/" if prefixed else ".")
    number = re.escape(str(separator)).join([r"(0|[1-9][0-9]*)"] * len(grid)) or (
        "" if prefixed else "0"
    )
    start = ("c" + (re.escape(str(separator)) if grid else "")) if prefixed else ""
    key = re.compile(start + number)
    for folder, _, names in os.walk(place):
        below = Path(folder).relative_to(place).as_posix()
        for name in names:
            found = key.fullmatch(name if below == "." else f"{below}/{name}")
            if found and all(int(at) < end for at, end in zip(found.groups(), grid, strict=True)):
                yield Path(folder, name)


def _pieces(stream: BinaryIO, per_shard: int, shards: Metadata | None) -> Iterator[tuple[int, int]]:
    """(start, length) of each packed chunk in a file: one, or those the index of a shard names."""
    size = os.fstat(stream.fileno()).st_size
    if shards is None:
        yield 0, size
        return
    index = _INDEX_ENTRY_BYTES * per_shard
    tail = index + 4 * (len(shards["index_codecs"]) - 1)
    stream.seek(0 if shards.get("index_location") == "start" else max(0, size - tail))
    # Read in parts: a shard may claim any number of chunks, and its file ends them.
    for _ in range(per_shard):
        entry = stream.read(_INDEX_ENTRY_BYTES)
        if len(entry) < _INDEX_ENTRY_BYTES:
            return
        at = stream.tell()
        start, length = (int.from_bytes(entry[k : k + 8], "little") for k in (0, 8))
        if start != _ABSENT:
            yield start, length
        stream.seek(at)


def _check_piece(
    stream: BinaryIO, length: int, packer: str | None, most: int, where: Path, folder: Path
) -> None:
    """Raise FileFormatError where a packed chunk says, or shows, that it becomes too long."""
    becomes = length
    if packer == "zstd":
        becomes = _zstd_bytes(stream.read(length))
    elif packer == "blosc":
        becomes = int.from_bytes(stream.read(16)[4:8], "little")
    elif packer == "lz4":
        becomes = int.from_bytes(stream.read(4), "little")
    elif packer in ("gzip", "zlib"):
        becomes = _inflated_bytes(stream.read(length), most, packer)
    if becomes > most:
        raise FileFormatError(
            f"chunk {where} becomes {becomes} bytes or does not say how many, where a chunk of "
            f"its array has {most - _SPARE_BYTES} at most: the folder is damaged",
            path=folder,
        )


def _zstd_bytes(content: bytes) -> int:
    """What the headers of all Zstandard frames say together (RFC 8878); huge where one does not.

    Whoever unpacks them goes on to the next frame, whatever the first one says.
    """
    total = at = 0
    # Sums behind the packed chunk are no frame, and as few bytes cannot become many.
    while at == 0 or at + _SUMS_BYTES < len(content):
        magic = int.from_bytes(content[at : at + 4], "little")
        if at and magic & ~15 == _ZSTD_SKIPPED:
            at += 8 + int.from_bytes(content[at + 4 : at + 8], "little")
            continue
        size, blocks = _zstd_head(content[at : at + 18])
        if size == _ABSENT:
            return _ABSENT
        total += size
        at = _end_of_zstd_frame(content, at + blocks, has_sum=bool(content[at + 4] & 4))
    return total


def _zstd_head(head: bytes) -> tuple[int, int]:
    """Content size in the header of a frame (3.1.1.1), and where its blocks start."""
    if len(head) < 6 or head[:4] != b"\x28\xb5\x2f\xfd":
        return _ABSENT, 0
    single, size_flag, dictionary = head[4] >> 5 & 1, head[4] >> 6, head[4] & 3
    at = 5 + (0 if single else 1) + (0, 1, 2, 4)[dictionary]
    width = (single, 2, 4, 8)[size_flag]
    if width == 0:
        return _ABSENT, 0
    size = int.from_bytes(head[at : at + width], "little") + (256 if width == 2 else 0)
    return size, at + width


def _end_of_zstd_frame(content: bytes, at: int, *, has_sum: bool) -> int:
    """Where a frame ends whose blocks start at `at` (3.1.1.2); beyond the content if it is cut."""
    is_last = False
    while not is_last and at < len(content):
        told = int.from_bytes(content[at : at + 3], "little")
        is_last, kind, size = bool(told & 1), told >> 1 & 3, told >> 3
        at += 3 + (1 if kind == 1 else size)  # 1: one byte, so many times
    return at + 4 * has_sum


def _inflated_bytes(content: bytes, most: int, packer: str) -> int:
    """Bytes that a gzip or zlib stream becomes, counted up to `most` and no further."""
    total = 0
    with contextlib.suppress(OSError, EOFError, zlib.error):  # zarr will say so
        if packer == "zlib":
            packed = zlib.decompressobj()
            while content and total <= most:
                total += len(packed.decompress(content, 1 << 20))
                content = packed.unconsumed_tail
            return total
        # By the parser that zarr has: zlib's stops where that one goes on (zeros between members,
        # sums of headers that it does not look at), and what follows would not be counted.
        with gzip.GzipFile(fileobj=io.BytesIO(content), mode="rb") as members:
            while total <= most and (block := members.read(1 << 20)):
                total += len(block)
    return total
