"""Changes that know how a format is built: where its numbers stand, what an HDF5 file is made of.

`fields_of` finds the numbers of headers, directories and tags, for `fuzz_readers` to change.
`rebuilt_hdf5` opens an HDF5 file and changes what is in it with the library itself, so that the
result is a sound file that says something false: other types, shapes and sizes, links in a ring
or out of the file, values that cannot be, attributes and chunks of another kind.
"""

from __future__ import annotations

import contextlib
import io
import json
import struct
import zipfile
from collections.abc import Callable
from typing import Any

import h5py
import numpy as np

Fields = tuple[tuple[int, int], ...]
"""(offset, bytes) of numbers in a file."""

HURTFUL_VALUES: tuple[Any, ...] = (
    0, 1, -1, 2**31, 2**63 - 1, -(2**63), 0.5, -0.0, float("nan"), float("inf"), 1e308, True, None,
    "", "x", "None", "a" * 70_000, [], [0], [-1, 3], [[1], [2]], {}, {"shape": 1}, "\u0000",
    "\ud800",
)  # fmt: skip

_MOST_BYTES = 1 << 20
_SDT_HEADER = "<hihiHihIihhHIHH"
_SDT_BLOCK = "<BBIIHhII"
_ZIP_LOCAL = ((6, 2), (8, 2), (14, 4), (18, 4), (22, 4), (26, 2), (28, 2))
_ZIP_CENTRAL = ((8, 2), (10, 2), (16, 4), (20, 4), (24, 4), (28, 2), (30, 2), (42, 4))
_ZIP_END = ((8, 2), (10, 2), (12, 4), (16, 4), (20, 2))


def fields_of(name: str, content: bytes) -> Fields:
    """Where a valid file keeps the numbers that say how the rest is to be read."""
    if content[:8] == b"\x89HDF\r\n\x1a\n" or content[512:520] == b"\x89HDF\r\n\x1a\n":
        return _hdf5_fields(content)
    if content[:4] == b"PK\3\4":
        return _zip_fields(content)
    if name.endswith(".ptu"):
        return _ptu_fields(content)
    if name.endswith(".sdt"):
        return _sdt_fields(content)
    if name.endswith(".mat"):
        return ((124, 2), (126, 2), *((128 + 4 * k, 4) for k in range(24)))
    if name.endswith(".npy"):
        return ((6, 1), (7, 1), (8, 2))
    if name.endswith(".gz"):
        return ((2, 1), (3, 1), (len(content) - 8, 4), (len(content) - 4, 4))
    if name.endswith(".spc"):
        return tuple((at, 4) for at in range(0, len(content), 4))
    return ()


def _hdf5_fields(content: bytes) -> Fields:
    """Superblock and object headers: versions, message types and sizes, dimensions, addresses."""
    found = [(at, width) for width in (1, 4, 8) for at in range(8, 96, width)]
    with h5py.File(io.BytesIO(content), "r") as file:
        block = file.userblock_size
        nodes: list[Any] = [file["/"]]
        file.visititems(lambda _, node: nodes.append(node))
        for node in nodes:
            start = block + h5py.h5o.get_info(node.id).addr
            found += [(start + at, 2) for at in range(0, 16, 2)]
            found += [(start + at, width) for width in (2, 4, 8) for at in range(16, 272, width)]
    return tuple((at + block if at < 96 else at, width) for at, width in found)


def _zip_fields(content: bytes) -> Fields:
    found = []
    for mark, places in (
        (b"PK\3\4", _ZIP_LOCAL),
        (b"PK\1\2", _ZIP_CENTRAL),
        (b"PK\5\6", _ZIP_END),
    ):
        start = content.find(mark)
        while start >= 0:
            found += [(start + at, width) for at, width in places]
            start = content.find(mark, start + 4)
    return tuple(found)


def _ptu_fields(content: bytes) -> Fields:
    """Index, type and value of each header item, and the first records."""
    found, at = [], 16
    while at + 48 <= len(content):
        (kind,) = struct.unpack_from("<I", content, at + 36)
        found += [(at + 32, 4), (at + 36, 4), (at + 40, 8)]
        is_text = kind in (0x4001FFFF, 0x4002FFFF, 0xFFFFFFFF, 0x2001FFFF)
        last = content[at : at + 10] == b"Header_End"
        at += 48 + (struct.unpack_from("<q", content, at + 40)[0] if is_text else 0)
        if last:
            break
    return (*found, *((at + 4 * k, 4) for k in range(8)))


def _sdt_fields(content: bytes) -> Fields:
    found = _struct_fields(_SDT_HEADER, 0)
    header = struct.unpack_from(_SDT_HEADER, content)
    info_at, block_at, measured_at = header[1], header[5], header[8]
    found += [(measured_at + at, 4) for at in (64, 68)] + [(measured_at + 82, 2)]
    found += [(measured_at + at, 2) for at in range(0, 512, 2)]
    found += _struct_fields(_SDT_BLOCK, block_at) * 8
    return (*found, (info_at, 4))


def _struct_fields(form: str, start: int) -> list[tuple[int, int]]:
    found, at = [], start
    for letter in form[1:]:
        width = struct.calcsize("<" + letter)
        found.append((at, width))
        at += width
    return found


# --- HDF5, rebuilt by the library --------------------------------------------------------


def rebuilt_hdf5(content: bytes, rng: np.random.Generator) -> bytes:
    """One to three changes of what an HDF5 file holds; the file itself stays sound."""
    out = io.BytesIO(content)
    with h5py.File(out, "r+") as file:
        # Behind the digest of our own files stand all the checks that old ones rest on.
        for mark in ("digest", "sealed"):
            if mark in file.attrs and rng.random() < 0.8:
                del file.attrs[mark]
        for _ in range(int(rng.integers(1, 4))):
            change = _CHANGES[int(rng.integers(len(_CHANGES)))]
            datasets = _datasets(file)
            if not datasets:
                break
            with contextlib.suppress(Exception):  # over what a change before it broke
                change(file, datasets[int(rng.integers(len(datasets)))], rng)
    return out.getvalue()


def _datasets(file: h5py.File) -> list[str]:
    """What holds little, here; the rest was changed before."""
    nodes: list[tuple[str, Any]] = []
    file.visititems(lambda name, node: nodes.append((name, node)))
    return [
        name
        for name, node in nodes
        if isinstance(node, h5py.Dataset)
        and not (node.is_virtual or node.external)
        and (node.size or 0) * node.dtype.itemsize < _MOST_BYTES
    ]


def _replaced(file: h5py.File, name: str, **made: Any) -> None:
    attributes = dict(file[name].attrs)
    del file[name]
    dataset = file.create_dataset(name, **made)
    for key, value in attributes.items():
        dataset.attrs[key] = value


def _retyped(file: h5py.File, name: str, rng: np.random.Generator) -> None:
    values = file[name][()]
    number = np.resize(np.arange(7), np.shape(values))
    kinds: tuple[Callable[[], Any], ...] = (
        lambda: np.where(number % 3 == 0, np.nan, number),
        lambda: number.astype(np.float16),
        lambda: number.astype(np.complex128),
        lambda: number % 2 == 0,
        lambda: -number.astype(np.int8),
        lambda: number.astype(">u8") << 60,
        lambda: number.astype("S3"),
        lambda: np.zeros(np.shape(values), [("a", "u1"), ("b", "f8", (2,))]),
        lambda: np.zeros(np.shape(values), "V16"),
        lambda: np.full(np.shape(values), "text", h5py.string_dtype()),
        lambda: np.full(np.shape(values), file.ref, h5py.ref_dtype),
        lambda: h5py.Empty("f8"),
    )
    _replaced(file, name, data=kinds[int(rng.integers(len(kinds)))]())


def _reshaped(file: h5py.File, name: str, rng: np.random.Generator) -> None:
    values = np.asarray(file[name][()])
    shapes: tuple[Callable[[], Any], ...] = (
        lambda: values.ravel(),
        lambda: values.T,
        lambda: values[np.newaxis],
        lambda: values[..., np.newaxis],
        lambda: values.ravel()[: values.size // 2],
        lambda: values.ravel()[:1].reshape(()) if values.size else values,
        lambda: values.ravel()[:0],
        lambda: np.zeros((0, *values.shape), values.dtype),
        lambda: np.zeros((1,) * 17 + values.shape, values.dtype),
        lambda: np.concatenate([values.ravel(), values.ravel()]),
    )
    _replaced(file, name, data=shapes[int(rng.integers(len(shapes)))]())


def _claims_much(file: h5py.File, name: str, rng: np.random.Generator) -> None:
    """A huge array of which nothing, or one chunk, is stored; or whose chunks are huge."""
    dtype = file[name].dtype if file[name].dtype.kind in "iufb" else np.dtype("u2")
    length = int(2 ** rng.integers(20, 60))
    shape = [(length,), (length, 4, 32), (4, 4, length), (2**20, 2**20, 2)][int(rng.integers(4))]
    chunks = tuple(min(n, 64) for n in shape)
    if rng.random() < 0.3:
        chunks = (min(shape[0], 2**28), *(1 for _ in shape[1:]))
    packing = {} if rng.random() < 0.5 else {"compression": "gzip"}
    _replaced(file, name, shape=shape, dtype=dtype, chunks=chunks, **packing)
    if rng.random() < 0.5 and np.prod(chunks) < 1 << 20:
        file[name][tuple(slice(0, 1) for _ in shape)] = 1


def _revalued(file: h5py.File, name: str, rng: np.random.Generator) -> None:
    values = np.array(file[name][()])
    if values.dtype.kind not in "iuf" or not values.size:
        return
    kinds = (0, 1, -1, 255, 65_535, 2**32 - 1, 2**63 - 1, np.nan, np.inf, 1e300)
    chosen = kinds[int(rng.integers(len(kinds)))]
    flat = values.reshape(-1)
    where = rng.integers(flat.size, size=int(rng.integers(1, 9)))
    if rng.random() < 0.3:
        where = np.arange(flat.size)
    with np.errstate(all="ignore"):
        new = np.asarray(chosen, np.float64 if values.dtype.kind == "f" else object)
        if values.dtype.kind == "f":
            flat[where] = new
        else:
            bits = 0 if not np.isfinite(chosen) else int(chosen)
            flat[where] = np.array(bits & (2**64 - 1), np.uint64).astype(values.dtype)
    _replaced(file, name, data=values)


def _deleted(file: h5py.File, name: str, rng: np.random.Generator) -> None:
    del file[name]


def _is_group_now(file: h5py.File, name: str, rng: np.random.Generator) -> None:
    del file[name]
    file.create_group(name)["inside"] = 1


def _renamed(file: h5py.File, name: str, rng: np.random.Generator) -> None:
    file.move(name, f"{name}_{'x' * int(rng.integers(1, 300))}")


def _linked(file: h5py.File, name: str, rng: np.random.Generator) -> None:
    """A link to itself, to its group, to nothing, to another file, or data that lie elsewhere.

    `fuzz_process.Surroundings` sees who reads those.
    """
    shape, dtype = file[name].shape, file[name].dtype
    del file[name]
    match int(rng.integers(6)):
        case 0:
            file[name] = h5py.SoftLink(f"/{name}")
        case 1:
            file[name] = file["/"]
        case 2:
            file[name] = h5py.SoftLink("/nowhere")
        case 3:
            file[name] = h5py.ExternalLink("../secret.h5", "/x")
        case 4:
            layout = h5py.VirtualLayout(shape or (4,), np.dtype("u2"))
            layout[...] = h5py.VirtualSource("../secret.h5", "x", shape or (4,))
            file.create_virtual_dataset(name, layout)
        case _:
            kind = dtype if dtype.kind in "iuf" else np.dtype("u1")
            size = int(np.prod(shape or (1,))) * kind.itemsize
            outside = [("../secret", 0, max(1, size))]
            file.create_dataset(name, shape or (1,), kind, external=outside)


def _attribute(file: h5py.File, name: str, rng: np.random.Generator) -> None:
    """Another value of an attribute, of the root, of the data or of a group above them."""
    nodes = [file, file[name], file[name].parent]
    node = next((one for one in rng.permutation(len(nodes)) if len(nodes[one].attrs)), None)
    if node is None:
        return
    attributes = nodes[node].attrs
    key = sorted(attributes)[int(rng.integers(len(attributes)))]
    values = (
        0, 1, 2, 2**31, 2**64 - 1, -1, 1.5, np.nan, "text", b"text", b"\xff\xfe", b"", "ytx",
        h5py.Empty("f4"), np.zeros((3, 0)), np.arange(5000), np.array([b"a", b"b"]), np.uint8(3),
        np.zeros(2, [("a", "i4")]), file.ref,
    )  # fmt: skip
    new = values[int(rng.integers(len(values) + 1)) - 1]
    if rng.random() < 0.2:
        del attributes[key]
    else:
        attributes[key] = new


def _chunk(file: h5py.File, name: str, rng: np.random.Generator) -> None:
    """Noise in one chunk as it is stored, behind its compression and checksum or in front."""
    dataset = file[name]
    if dataset.chunks is None or not dataset.id.get_num_chunks():
        return
    place = dataset.id.get_chunk_info(int(rng.integers(dataset.id.get_num_chunks()))).chunk_offset
    mask, stored = dataset.id.read_direct_chunk(place)
    changed = bytearray(stored)
    for _ in range(int(rng.integers(1, 9))):
        changed[int(rng.integers(len(changed)))] ^= 1 << int(rng.integers(8))
    cut = len(changed) if rng.random() < 0.5 else int(rng.integers(1, len(changed) + 1))
    mask = mask if rng.random() < 0.8 else int(rng.integers(8))
    dataset.id.write_direct_chunk(place, bytes(changed[:cut]), mask)


def _json_text(file: h5py.File, name: str, rng: np.random.Generator) -> None:
    """Our own files: another value somewhere in the JSON that holds what is no array."""
    if "attributes" not in _datasets(file):
        return
    try:
        known = json.loads(bytes(file["attributes"][()]))
    except (ValueError, TypeError):
        return
    text = json.dumps(changed_json(known, rng)).encode("utf-8", "surrogatepass")
    if rng.random() < 0.1:
        text = b"[" * 100_000
    del file["attributes"]
    file.create_dataset("attributes", data=np.array(text, f"S{max(1, len(text))}"))


def changed_json(value: Any, rng: np.random.Generator) -> Any:
    """The same, but for one value at any depth; keys may go, too."""
    if isinstance(value, dict) and value and rng.random() < 0.85:
        key = sorted(value)[int(rng.integers(len(value)))]
        if rng.random() < 0.15:
            return {name: one for name, one in value.items() if name != key}
        return {**value, key: changed_json(value[key], rng)}
    if isinstance(value, list) and value and rng.random() < 0.7:
        at = int(rng.integers(len(value)))
        return [*value[:at], changed_json(value[at], rng), *value[at + 1 :]]
    return HURTFUL_VALUES[int(rng.integers(len(HURTFUL_VALUES)))]


_CHANGES: tuple[Callable[[h5py.File, str, np.random.Generator], None], ...] = (
    _retyped, _reshaped, _claims_much, _revalued, _revalued, _deleted, _is_group_now, _renamed,
    _linked, _attribute, _attribute, _chunk, _json_text, _json_text,
)  # fmt: skip


def zip_bomb(content: bytes, rng: np.random.Generator) -> bytes:
    """An archive of arrays in which one claims, and truly unpacks to, far more than it stores."""
    n = int(2 ** rng.integers(20, 25))
    shape = f"({n // 2048}, 32, 32)" if rng.random() < 0.5 else f"({n * 8},)"
    words = f"{{'descr': '<u2', 'fortran_order': False, 'shape': {shape}, }}"
    header = words.ljust(117) + "\n"
    body = b"\x93NUMPY\1\0" + struct.pack("<H", len(header)) + header.encode() + bytes(n)
    return with_other_member(content, rng, lambda _: body)


def with_other_member(
    content: bytes, rng: np.random.Generator, change: Callable[[bytes], bytes]
) -> bytes:
    """A zip archive, packed again with one of its files changed."""
    out = io.BytesIO()
    with (
        zipfile.ZipFile(io.BytesIO(content)) as old,
        zipfile.ZipFile(out, "w", zipfile.ZIP_DEFLATED) as new,
    ):
        names = old.namelist()
        chosen = names[int(rng.integers(len(names)))]
        for name in names:
            member = old.read(name)
            new.writestr(name, change(member) if name == chosen else member)
    return out.getvalue()
