"""Each number of a header set to all that hurts: one by one, and by pairs where they multiply.

    python -m tests.attacks.fields --only .ptu

Of MATLAB files (v5 plain, packed and of the other byte order, v7.3) and of `.ptu`, `.sdt` and
`.spc`, from files that share no writer with the readers. `fuzz_readers` draws changes by chance;
these are all of a list, and claims that multiply are also made to agree with each other, so that
they come past the first check. What counts as a finding is told there.
"""

from __future__ import annotations

import argparse
import itertools
import os
import struct
import sys
import tempfile
import zlib
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import h5py
import numpy as np

from tests.formats.made_by_hand import ptu_bytes, ptu_image_bytes, sdt_bytes, spc_bytes
from tests.fuzz_readers import Finding, Mutant, read_all
from tests.fuzz_seeds import Seed, seeds

_FOUR = (0, 1, 2, 7, 255, 2**16, 2**20, 2**28, 2**31 - 8, 2**31 - 1, 2**31, 2**32 - 8, 2**32 - 1)
_TWO = (0, 1, 255, 4096, 2**15 - 1, 2**15, 2**16 - 1)
_LENGTHS = (0, 3, 2**15 - 1, 2**16, 2**24, 2**31 - 1, 2**31, 2**32 - 1)
"""For what multiplies: products of these pass 2 GB, 2^32 and 2^63."""
_FLOATS = (0.0, -1.0, 5e-324, 1e-30, 1e30, 1e308, float("nan"), float("inf"), -float("inf"))


class Place(NamedTuple):
    """Where a number stands."""

    name: str
    at: int
    width: int


def with_values(content: bytes, *changes: tuple[Place, int]) -> bytes:
    """The same with other numbers at some places, little-endian."""
    out = bytearray(content)
    for place, value in changes:
        kept = value & ((1 << 8 * place.width) - 1)
        out[place.at : place.at + place.width] = kept.to_bytes(place.width, "little")
    return bytes(out)


def _extremes(content: bytes, place: Place) -> list[int]:
    """Values for a place: hurtful ones, and neighbours of what stands there."""
    now = int.from_bytes(content[place.at : place.at + place.width], "little")
    values = {1: range(0, 256, 5), 2: _TWO, 4: _FOUR}.get(place.width, (*_FOUR, 2**40, 2**62,
              2**63 - 1, 2**63, 2**64 - 1))  # fmt: skip
    near = (now + 1, now - 1, now + 8, 2 * now, now // 2, now << 16)
    whole = 1 << 8 * place.width
    return sorted({value % whole for value in (*values, *near)} - {now})


def _one_by_one(seed: Seed, places: list[Place]) -> Iterator[Mutant]:
    for place in places:
        for value in _extremes(seed.content, place):
            content = with_values(seed.content, (place, value))
            yield Mutant(seed, content, change=f"{place.name}={value}")


def _by_pairs(
    seed: Seed, first: Place, second: Place, values: tuple[int, ...] = _LENGTHS
) -> Iterator[Mutant]:
    for pair in itertools.product(values, values):
        changes = tuple(zip((first, second), pair, strict=True))
        words = " ".join(f"{place.name}={value}" for place, value in changes)
        yield Mutant(seed, with_values(seed.content, *changes), change=words)


# --- MATLAB v5 ---------------------------------------------------------------------------

_SIZES = {1: 1, 2: 1, 3: 2, 4: 2, 5: 4, 6: 4, 7: 4, 9: 8, 12: 8, 13: 8, 16: 1, 17: 2, 18: 4}


def mat_elements(content: bytes) -> list[bytes]:
    """Elements of a little-endian file behind its header, each with its tag; packed ones not."""
    found, at = [], 128
    while at < len(content):
        kind, n_bytes = struct.unpack_from("<II", content, at)
        whole = content[at : at + 8 + n_bytes]
        found.append(zlib.decompress(whole[8:]) if kind == 15 else whole)
        at += 8 + n_bytes
    return found


def mat_places(element: bytes) -> dict[str, Place]:
    """Numbers of one array: its tag, class, flags, dimensions, name and the tag of its data."""
    found = [Place("type", 0, 4), Place("bytes", 4, 4), Place("flags tag", 8, 4)]
    found += [Place("flags bytes", 12, 4), Place("class", 16, 1), Place("flags", 17, 1)]
    found += [Place("most stored", 20, 4), Place("dims tag", 24, 4), Place("dims bytes", 28, 4)]
    (n_bytes,) = struct.unpack_from("<I", element, 28)
    found += [Place(f"dim {k}", 32 + 4 * k, 4) for k in range(n_bytes // 4)]
    at = 32 + -(-n_bytes // 8) * 8
    found += [Place("name tag", at, 4), Place("name bytes", at + 4, 4)]
    word, length = struct.unpack_from("<II", element, at)
    at += 8 if word >> 16 else 8 + -(-length // 8) * 8
    if at + 8 <= len(element):
        found += [Place("data type", at, 4), Place("data bytes", at + 4, 4)]
    return {place.name: place for place in found}


def mat_file(seed: Seed, elements: list[bytes], *, packed: bool, order: str = "<") -> bytes:
    """A v5 file of these elements."""
    out = bytearray(seed.content[:128])
    if order == ">":
        out[124:128] = b"\1\0MI"
    for one in elements:
        body = zlib.compress(one) if packed else one
        out += struct.pack(f"{order}II", 15, len(body)) + body if packed else body
    return bytes(out)


def mat5_mutants(seed: Seed) -> Iterator[Mutant]:
    """Of each array in a v5 file, plain and packed."""
    elements = mat_elements(seed.content)
    header = [Place("version", 124, 2), Place("byte order", 126, 2)]
    yield from _one_by_one(seed, header + [Place(f"first {k}", 128 + 4 * k, 4) for k in range(2)])
    for packed, (index, element) in itertools.product((False, True), enumerate(elements)):
        for words, other in _other_elements(element):
            changed = [*elements[:index], other, *elements[index + 1 :]]
            change = f"{'packed' if packed else 'plain'} array {index}: {words}"
            yield Mutant(seed, mat_file(seed, changed, packed=packed), True, change=change)


def _other_elements(element: bytes) -> Iterator[tuple[str, bytes]]:
    places = mat_places(element)
    for place in places.values():
        for value in _extremes(element, place):
            yield f"{place.name}={value}", with_values(element, (place, value))
    dims = [place for name, place in places.items() if name.startswith("dim ")]
    for (one, two), pair in itertools.product(
        itertools.combinations(dims, 2), itertools.product(_LENGTHS, _LENGTHS)
    ):
        other = with_values(element, (one, pair[0]), (two, pair[1]))
        words = f"{one.name}={pair[0]} {two.name}={pair[1]}"
        yield words, other
        yield f"{words}, all agree", _agreeing(other, places, dims)
    if "data type" in places:
        kinds = (0, 1, 2, 3, 4, 5, 6, 7, 9, 12, 13, 14, 15, 16, 18, 99)
        for kind, array_class in itertools.product(kinds, range(20)):
            changes = (places["data type"], kind), (places["class"], array_class)
            other = with_values(element, *changes)
            yield f"data type={kind} class={array_class}", _agreeing(other, places, dims)
        # A small element keeps its length and up to four bytes in one word.
        for n_bytes, kind in itertools.product((0, 1, 4, 5, 255, 2**16 - 1), (1, 2, 6, 9, 16)):
            other = with_values(element, (places["data type"], n_bytes << 16 | kind))
            yield f"small data of {n_bytes} bytes, type {kind}", other
    for n_dims in (0, 1, 2, 31, 32, 33, 500, 1000):
        head, rest = element[8:24], element[32 + -(-len(dims) // 2) * 8 :]
        for length in (0, 1, 2, 2**31 - 1):
            lengths = struct.pack(f"<{n_dims}I", *[length] * n_dims)
            lengths = struct.pack("<II", 5, len(lengths)) + lengths + bytes(-len(lengths) % 8)
            body = head + lengths + rest
            yield f"{n_dims} dims of {length}", struct.pack("<II", 14, len(body)) + body


def _agreeing(element: bytes, places: dict[str, Place], dims: list[Place]) -> bytes:
    """The same where data and array claim what the dimensions need, as far as 32 bits go."""
    if "data type" not in places:
        return element
    needed = 1
    for place in dims:
        needed *= int.from_bytes(element[place.at : place.at + 4], "little", signed=True)
    kind = int.from_bytes(element[places["data type"].at :][:4], "little")
    needed *= _SIZES.get(kind, 1)
    begin = places["data bytes"].at + 4
    changes = (places["data bytes"], needed), (places["bytes"], begin - 8 + needed)
    return with_values(element, *changes)


def other_order(seed: Seed) -> Seed:
    """The same cube written byte by byte in the other byte order, with a short name."""
    cube = np.arange(4 * 4 * 32, dtype=">u2") % 7

    def element(kind: int, content: bytes) -> bytes:
        return struct.pack(">II", kind, len(content)) + content + bytes(-len(content) % 8)

    name = struct.pack(">HH", 3, 1) + b"abc\0"
    body = element(6, struct.pack(">II", 11, 0)) + element(5, struct.pack(">3i", 4, 4, 32))
    body += name + element(4, cube.tobytes())
    return replace(
        seed, name="other-order.mat",
        content=mat_file(seed, [struct.pack(">II", 14, len(body)) + body], packed=False, order=">"),
    )  # fmt: skip


def other_order_mutants(seed: Seed) -> Iterator[Mutant]:
    """Each word of the header of an array in the other byte order."""
    for at, value in itertools.product(range(128, 200, 4), (*_FOUR, 2**16 + 1, 2**18 + 4)):
        content = seed.content[:at] + struct.pack(">I", value) + seed.content[at + 4 :]
        yield Mutant(seed, content, change=f"word {at}={value}")


# --- MATLAB v7.3 -------------------------------------------------------------------------


def mat73_mutants(seed: Seed) -> Iterator[Mutant]:
    """Every word of all that is no data, and arrays that claim what they do not hold."""
    for width, values in ((4, (0, 1, 2**31, 2**32 - 1)), (2, (0, 2**15, 2**16 - 1)), (8, (
        0, 1, 512, 2**31, 2**40, 2**63 - 1, 2**63, 2**64 - 1,
    ))):  # fmt: skip
        for at in range(512, len(seed.content), width):
            if not any(seed.content[max(512, at - 24) : at + 24]):
                continue
            for value in values:
                place = Place(f"word {at}:{width}", at, width)
                if int.from_bytes(seed.content[at : at + width], "little") != value:
                    yield Mutant(
                        seed, with_values(seed.content, (place, value)),
                        change=f"{place.name}={value}",
                    )  # fmt: skip
    with tempfile.TemporaryDirectory() as folder:
        for number, (change, content) in enumerate(_other_v73(Path(folder), seed)):
            yield Mutant(seed, content, True, change=f"{number}: {change}")


def _other_v73(folder: Path, seed: Seed) -> Iterator[tuple[str, bytes]]:
    lengths = (0, 1, 3, 2**16, 2**31 - 1, 2**32, 2**40, 2**62)
    for pair in itertools.product(lengths, lengths):
        for chunks, dtype in itertools.product(((8, 1, 1), (1, 64, 64)), ("u2", "f8", "u1")):
            shape = (32, *pair)
            fitting = tuple(min(c, max(1, n)) for c, n in zip(chunks, shape, strict=True))
            made = {"shape": shape, "dtype": dtype, "compression": "gzip", "chunks": fitting}
            yield from _made_v73(folder, f"{pair} {dtype} in {chunks}", seed, made)
    for dtype in ("f2", "f4", "c16", "S4", "i8", ">u8", "V3", "?"):
        data = np.zeros((32, 4, 4), dtype)
        yield from _made_v73(folder, dtype, seed, {"data": data})
    for name, value in itertools.product(
        ("MATLAB_class", "MATLAB_empty", "MATLAB_sparse", "MATLAB_int_decode", "MATLAB_fields"),
        (0, 1, -1, 2**63 - 1, 1.5, b"char", b"cell", b"struct", b"\xff\xfe", "x" * 60_000,
         np.zeros((3, 0)), h5py.Empty("f8"), np.array([b"a", b"b"])),
    ):  # fmt: skip
        yield from _made_v73(folder, f"{name}={value!r:.20}", seed, {}, (name, value))


def _made_v73(
    folder: Path, change: str, seed: Seed, made: dict[str, object], *attributes: tuple[str, object]
) -> Iterator[tuple[str, bytes]]:
    """A v7.3 file with another array in it, or other attributes of it, where HDF5 writes such."""
    path = folder / "new.mat"
    path.write_bytes(seed.content)
    try:
        with h5py.File(path, "r+") as file:
            if made:
                del file["series"]
                file.create_dataset("series", **made)
                file["series"].attrs["MATLAB_class"] = np.bytes_("uint16")
            for name, value in attributes:
                file["series"].attrs[name] = value
    except (ValueError, OSError, OverflowError, RuntimeError, TypeError):
        return
    content = path.read_bytes()
    yield change, b"MATLAB 7.3 MAT-file".ljust(124) + b"\0\2IM" + content[128:]


# --- .ptu --------------------------------------------------------------------------------

_TYPES = (0xFFFF0008, 8, 0x10000008, 0x11000008, 0x12000008, 0x20000008, 0x21000008, 0x2001FFFF,
          0x4001FFFF, 0x4002FFFF, 0xFFFFFFFF, 0, 1, 0x7FFFFFFF)  # fmt: skip
_RECORDS = (0x00010303, 0x00010203, 0x00010304, 0x00010204, 0x01010304, 0x00010305, 0x00010306,
            0x00010307, 0x01010303, 0x00010308, 0x0, 0xFFFFFFFF)  # fmt: skip
_MULTIPLY = (
    "ImgHdr_PixX", "ImgHdr_PixY", "ImgHdr_Dimensions", "ImgHdr_LineStart", "ImgHdr_LineStop",
    "ImgHdr_Frame", "TTResult_NumberOfRecords", "HW_InpChannels", "MeasDesc_Resolution",
    "MeasDesc_GlobalResolution", "TTResultFormat_BitsPerRecord", "ImgHdr_TimePerPixel",
)  # fmt: skip


def ptu_tags(content: bytes) -> dict[str, int]:
    """Where each item of the header starts, by name."""
    found, at = {}, 16
    while at + 48 <= len(content):
        name = content[at : at + 32].rstrip(b"\0").decode("ascii", "replace")
        kind, value = struct.unpack_from("<Iq", content, at + 36)
        found[name] = at
        at += 48 + (value if kind in (0x4001FFFF, 0x4002FFFF, 0xFFFFFFFF, 0x2001FFFF) else 0)
        if name == "Header_End":
            break
    return found


def ptu_mutants(seed: Seed) -> Iterator[Mutant]:
    """Name, index, type and value of each item, as number and as float; pairs; records."""
    tags = ptu_tags(seed.content)
    bits = tuple(int.from_bytes(struct.pack("<d", value), "little") for value in _FLOATS)
    for name, at in tags.items():
        value, kind = Place(f"{name} value", at + 40, 8), Place(f"{name} type", at + 36, 4)
        yield from _one_by_one(seed, [Place(f"{name} index", at + 32, 4), value])
        for new in bits:
            yield Mutant(seed, with_values(seed.content, (value, new)), change=f"{name}={new:#x}")
        for new in _TYPES:
            yield Mutant(seed, with_values(seed.content, (kind, new)), change=f"{kind.name}={new}")
            for number in (0, 2**31, 2**63 - 1, 2**64 - 1):
                content = with_values(seed.content, (kind, new), (value, number))
                yield Mutant(seed, content, change=f"{kind.name}={new} value={number}")
        for other in (b"", b"\xff" * 32, b"x" * 32, b"Header_End", b"__class__", b"ImgHdr_PixX"):
            content = seed.content[:at] + other.ljust(32, b"\0") + seed.content[at + 32 :]
            yield Mutant(seed, content, change=f"{name} is called {other!r}")
    there = [Place(name, tags[name] + 40, 8) for name in _MULTIPLY if name in tags]
    whole = (0, 2**15, 2**16, 2**24, 2**31 - 1, 2**32, 2**63 - 1, 2**64 - 1)
    for one, two in itertools.combinations(there, 2):
        is_float = [place.name.startswith("MeasDesc") for place in (one, two)]
        choices = [bits if one_is else whole for one_is in is_float]
        for pair in itertools.product(*choices):
            content = with_values(seed.content, (one, pair[0]), (two, pair[1]))
            yield Mutant(seed, content, change=f"{one.name}={pair[0]} {two.name}={pair[1]}")
    record = tags.get("TTResultFormat_TTTRRecType")
    if record is not None:
        for record_kind, one in itertools.product(_RECORDS, there):
            for number in whole:
                both = (Place("", record + 40, 8), record_kind), (one, number)
                words = f"record {record_kind:#x} {one.name}={number}"
                yield Mutant(seed, with_values(seed.content, *both), change=words)
    start = tags["Header_End"] + 48
    for at, word in itertools.product(range(start, min(start + 64, len(seed.content)), 4), _FOUR):
        content = with_values(seed.content, (Place("", at, 4), word))
        yield Mutant(seed, content, change=f"record at {at}={word}")
    for n_bytes in (0, 8, 16, 17, 47, start - 48, start, start + 1, start + 4):
        yield Mutant(seed, seed.content[:n_bytes], change=f"cut after {n_bytes} bytes")


# --- .sdt --------------------------------------------------------------------------------

_SDT_HEADER = (("revision", 2), ("info offset", 4), ("info length", 2), ("set-up offset", 4),
               ("set-up length", 2), ("block offset", 4), ("blocks", 2), ("block length", 4),
               ("measurement offset", 4), ("measurements", 2), ("measurement length", 2),
               ("valid", 2), ("reserved 1", 4), ("reserved 2", 2), ("checksum", 2))  # fmt: skip
_SDT_BLOCK = (("number", 1), ("number 2", 1), ("data offset", 4), ("next", 4), ("kind", 2),
              ("measurement", 2), ("id", 4), ("length", 4))  # fmt: skip


def _consecutive(parts: tuple[tuple[str, int], ...], start: int) -> dict[str, Place]:
    found = {}
    for name, width in parts:
        found[name] = Place(name, start, width)
        start += width
    return found


def sdt_places(content: bytes) -> dict[str, Place]:
    """Header, first block, and what the description of the measurement says of sizes and times."""
    from sdtfile import sdtfile

    found = _consecutive(_SDT_HEADER, 0)
    measured = int.from_bytes(content[24:28], "little")
    n_bytes = int.from_bytes(content[found["measurement length"].at :][:2], "little")
    block = int.from_bytes(content[found["block offset"].at :][:4], "little")
    found |= {f"block {k}": p._replace(name=f"block {k}") for k, p in _consecutive(
        _SDT_BLOCK, block).items()}  # fmt: skip
    fields: Any = sdtfile.record_dtype(sdtfile.MEASURE_INFO, n_bytes).fields or {}
    assert measured == int.from_bytes(content[found["measurement offset"].at :][:4], "little")
    for name, (dtype, at, *_) in fields.items():
        if dtype.kind in "iuf" and dtype.itemsize <= 8:
            found[name] = Place(name, measured + at, dtype.itemsize)
        for inner, (kind, deeper, *_) in (dtype.fields or {}).items():
            if kind.kind in "iuf" and kind.itemsize <= 8:
                found[f"{name}.{inner}"] = Place(f"{name}.{inner}", measured + at + deeper,
                                                 kind.itemsize)  # fmt: skip
    return found


def sdt_mutants(seed: Seed) -> Iterator[Mutant]:
    """Each number; sizes by pairs; kinds of blocks; floats."""
    places = sdt_places(seed.content)
    yield from _one_by_one(seed, list(places.values()))
    for name in ("tac_r", "tac_g", "StopInfo.min_sync_rate"):
        for value in _FLOATS if name in places and places[name].width == 4 else ():
            with np.errstate(all="ignore"):
                bits = int.from_bytes(np.float32(value).tobytes(), "little")
            content = with_values(seed.content, (places[name], bits))
            yield Mutant(seed, content, change=f"{name}={value}")
    multiply = ("adc_re", "scan_x", "scan_y", "image_x", "image_y", "scan_rx", "scan_ry",
                "image_rx", "block length", "block data offset", "block next", "blocks",
                "block kind")  # fmt: skip
    for one, two in itertools.combinations([places[k] for k in multiply if k in places], 2):
        yield from _by_pairs(seed, one, two, (0, 1, 64, 2**15, 2**16 - 1, 2**31 - 1, 2**32 - 1))
    kind = places["block kind"]
    for value in range(0, 2**16, 61):
        yield Mutant(seed, with_values(seed.content, (kind, value)), change=f"kind={value:#x}")
    for text in (b"*IDENTIFICATION\r\n  __class__ : x\r\n*END", b"*IDENTIFICATION Data File",
                 b"*IDENTIFICATION\r\n  ID : Data File\r\n*END", b"\xff" * 60):  # fmt: skip
        at = places["info offset"].at
        start = int.from_bytes(seed.content[at : at + 4], "little")
        content = seed.content[:start] + text.ljust(60) + seed.content[start + 60 :]
        yield Mutant(seed, content, change=f"info {text!r}")


# --- .spc --------------------------------------------------------------------------------


def spc_mutants(seed: Seed) -> Iterator[Mutant]:
    """Each bit and value of header and first records; lengths; what the `.set` beside it says."""
    words = (*_FOUR, *(1 << k for k in range(32)), *(k << 28 for k in range(16)), 0x8000005F,
             0x80000000, 0xBFFFFFFF)  # fmt: skip
    for at in range(0, min(40, len(seed.content)), 4):
        for value in dict.fromkeys(words):
            content = with_values(seed.content, (Place("", at, 4), value))
            yield Mutant(seed, content, change=f"word {at}={value:#x}")
    for n_bytes in range(min(24, len(seed.content))):
        yield Mutant(seed, seed.content[:n_bytes], change=f"cut after {n_bytes} bytes")
    for top in range(16):
        records = np.full(5000, top << 28 | 0x0FFF0FFF, "<u4").tobytes()
        yield Mutant(seed, seed.content[:4] + records, change=f"all records {top:#x}...")
    beside = Path(seed.name).with_suffix(".set").name
    for width in ("0", "-1", "nan", "1e999", "-1e999", "1e-999", "e", "-", "+-", "..", "1e5e5",
                  "1" * 400, "0." + "0" * 400 + "1", "9" * 5_000_000, "1e-8", "5e-324", "", "1.5.2",
                  "\0", "é", "1e-8]\n[SP_TAC_TC,F,-5"):  # fmt: skip
        text = f"*SETUP\n  #SP [SP_TAC_TC,F,{width}]\n*END\n".encode()
        yield Mutant(seed, seed.content, True, {beside: text}, f".set says {width[:20]}")
    for text in (b"", bytes(1 << 20), b"[SP_TAC_TC,F," * 100_000, b"\xff" * 1000):
        yield Mutant(seed, seed.content, True, {beside: text}, f".set of {len(text)} bytes")


# --- all ---------------------------------------------------------------------------------


def mutants(folder: Path, only: str = "") -> Iterator[Mutant]:
    """All of them, format after format; `only` those whose name ends so."""
    valid = {one.name: one for one in seeds(folder)}
    rng = np.random.default_rng(16)
    mine = [
        ("plain.mat", None, mat5_mutants), ("x.mat", None, mat5_mutants),
        ("new.mat", None, mat73_mutants),
        ("x.ptu", ptu_bytes(rng.integers(0, 3000, 50)), ptu_mutants),
        ("image.ptu", ptu_image_bytes(rng.integers(0, 3000, (4, 4, 3))), ptu_mutants),
        ("ptufile.ptu", None, ptu_mutants),
        ("x.sdt", sdt_bytes(rng.poisson(9.0, (2, 64))), sdt_mutants),
        ("packed.sdt", None, sdt_mutants), ("real.sdt", None, sdt_mutants),
        ("x.spc", spc_bytes(rng.integers(0, 4096, 300), rng.integers(0, 4, 300)), spc_mutants),
        ("tttrlib.spc", None, spc_mutants), ("tiny.spc", None, spc_mutants),
    ]  # fmt: skip
    for name, content, of in mine:
        if name in valid and name.endswith(only):
            seed = valid[name] if content is None else replace(valid[name], content=content)
            # The same claims tell that a file is another one, digest or not.
            yield from of(seed)
    if "other-order.mat".endswith(only):
        yield from other_order_mutants(other_order(valid["plain.mat"]))


def run(
    folder: Path, *, only: str = "", each: int = 1, keep: Path | None = None, first: int = 0
) -> tuple[dict[str, dict[str, int]], list[Finding]]:
    """Read every `each`-th of them, and tell as `fuzz_readers.run` does."""
    # Each start of a vendor's reader takes a second; `fuzz_readers` sees to real ones.
    os.environ.setdefault("LIGHTFLIGHT_REAL_STARTS", "500")
    (folder / "made").mkdir()
    chosen = itertools.islice(mutants(folder / "made", only), None, None, each)
    return read_all(chosen, folder, keep=keep, first=first, report=_say)


def _main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--only", default="", help="end of a name of a valid file")
    parser.add_argument("--each", type=int, default=1, help="every so manieth alone")
    parser.add_argument("--first", type=int, default=0, help="go on from there")
    parser.add_argument("--keep", type=Path, help="folder for the files of findings")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix="lightflight-fields-") as folder:
        tally, findings = run(
            Path(folder), only=options.only, each=options.each, keep=options.keep,
            first=options.first,
        )  # fmt: skip
    for name, count in sorted(tally.items()):
        _say(f"{name:20s}" + "".join(f"  {key} {value:6d}" for key, value in count.items()))
    _say(f"{len(findings)} findings")
    return 1 if findings else 0


def _say(text: str) -> None:
    sys.stdout.write(f"{text}\n")
    sys.stdout.flush()


if __name__ == "__main__":
    sys.exit(_main())
