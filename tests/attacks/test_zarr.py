"""Zarr folders that a stranger made: codecs, types, links, pipes, chunks that lack or swell."""

from __future__ import annotations

import json
import os
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import lightflight as lf
from lightflight.errors import FileFormatError, SuspectDataWarning
from lightflight.formats import zarr_store

zarr = pytest.importorskip("zarr")
numcodecs = pytest.importorskip("numcodecs")
read: Any = lf.read

CUBE = np.random.default_rng(16).poisson(3.0, (8, 5, 16)).astype(np.uint16)


def folder_of(tmp_path: Path, version: int = 3, **options: Any) -> Path:
    """A store that is sound."""
    path = tmp_path / "x.zarr"
    node = zarr.create_array(
        str(path), shape=CUBE.shape, chunks=(4, 5, 16), dtype="u2", zarr_format=version, **options
    )
    node[...] = CUBE
    return path


def changed(path: Path, version: int, **values: Any) -> Path:
    """The same, with other metadata."""
    file = path / ("zarr.json" if version == 3 else ".zarray")
    file.write_text(json.dumps({**json.loads(file.read_text()), **values}))
    return path


class Marks:
    def __init__(self, folder: str) -> None:
        self.folder = folder

    def __reduce__(self):
        return os.mkdir, (self.folder,)


@pytest.mark.parametrize("version", [2, 3])
@pytest.mark.parametrize("packed", ["zstd", "gzip", "blosc", "none", "shards", "delta"])
def test_what_is_allowed_is_read(tmp_path, version, packed):
    if version == 2:
        kinds: dict[str, Any] = {
            "zstd": {"compressors": numcodecs.Zstd()},
            "gzip": {"compressors": numcodecs.GZip()},
            "blosc": {"compressors": numcodecs.Blosc()},
            "none": {"compressors": None},
            "shards": {"compressors": numcodecs.LZ4()},
            "delta": {"filters": [numcodecs.Delta("<u2")], "compressors": numcodecs.Zlib()},
        }
    else:
        codecs = zarr.codecs
        kinds = {
            "zstd": {"compressors": codecs.ZstdCodec(checksum=True)},
            "gzip": {"compressors": codecs.GzipCodec()},
            "blosc": {"compressors": codecs.BloscCodec(cname="zstd")},
            "none": {"compressors": None},
            "shards": {"shards": (8, 10, 16)},
            "delta": {"compressors": [codecs.ZstdCodec(), codecs.Crc32cCodec()]},
        }
    path = folder_of(tmp_path, version, **kinds[packed])
    np.testing.assert_array_equal(read(path, axes="yxt").counts, CUBE)


@pytest.mark.parametrize("version", [2, 3])
def test_a_pickle_codec_runs_nothing(tmp_path, version):
    path = folder_of(tmp_path, version)
    mark = tmp_path / "it_ran"
    packed = numcodecs.Pickle().encode(np.array([Marks(str(mark))], object))
    chunk = next(file for file in path.rglob("*") if file.is_file() and "0" in file.name)
    chunk.write_bytes(packed)
    if version == 2:
        changed(path, 2, dtype="|O", filters=[{"id": "pickle", "protocol": 5}], compressor=None)
    else:
        changed(path, 3, codecs=[{"name": "numcodecs.pickle", "configuration": {"protocol": 5}}])
    with pytest.raises(FileFormatError, match=r"holds .*O.*no numbers|'pickle'.* may run code"):
        read(path, axes="yxt")
    assert not mark.exists()


@pytest.mark.parametrize(
    ("version", "values", "text"),
    [
        (2, {"dtype": "|O"}, "no numbers"),
        (2, {"dtype": [["a", "<u2"]]}, "no numbers"),
        (2, {"filters": [{"id": "json2"}]}, "'json2', which may run code"),
        (2, {"filters": [{"id": "delta", "dtype": "|O"}]}, "makes '|O' of numbers"),
        (2, {"compressor": {"id": "bz2"}}, "'bz2'"),
        (2, {"chunks": [0, 5, 16]}, "do not divide"),
        (2, {"shape": [8, 5, -16]}, "cannot be"),
        (2, {"shape": [8, 5, 1 << 62]}, "cannot be"),
        (3, {"data_type": "string"}, "no numbers"),
        (3, {"data_type": {"name": "struct", "configuration": {}}}, "no numbers"),
        (3, {"codecs": [{"name": "vlen-utf8"}]}, "'vlen-utf8', which may run code"),
        (3, {"codecs": ["bytes", "zstd", "gzip"]}, "in several layers"),
        (3, {"codecs": ["bytes", "zstd", "numcodecs.crc32"]}, "in several layers"),
        (3, {"storage_transformers": [{"name": "x"}]}, "storage transformers"),
        (3, {"chunk_grid": {"name": "rectangular"}}, "no regular grid"),
    ],
)
def test_what_is_not_on_the_list_is_refused(tmp_path, version, values, text):
    path = changed(folder_of(tmp_path, version), version, **values)
    with pytest.raises(FileFormatError, match=text) as caught:
        read(path, axes="yxt")
    assert str(path) in str(caught.value)


def test_consolidated_metadata_are_not_believed(tmp_path):
    """What zarr would look at first says another thing than the array itself."""
    group = zarr.open_group(str(tmp_path / "g.zarr"), mode="w")
    group.create_array("cube", shape=CUBE.shape, chunks=(4, 5, 16), dtype="u2")[...] = CUBE
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        zarr.consolidate_metadata(str(tmp_path / "g.zarr"))
    file = tmp_path / "g.zarr" / "zarr.json"
    file.write_text(file.read_text().replace('"uint16"', '"string"'))
    np.testing.assert_array_equal(read(tmp_path / "g.zarr", axes="yxt").counts, CUBE)


@pytest.mark.skipif(os.name == "nt", reason="POSIX")
@pytest.mark.parametrize("kind", ["link", "link to a folder", "pipe"])
def test_links_and_pipes_are_neither_followed_nor_waited_for(tmp_path, kind):
    path = folder_of(tmp_path)
    chunk = path / "c" / "1" / "0" / "0"
    (tmp_path / "other").mkdir()
    if kind == "link":
        chunk.rename(tmp_path / "away")
        chunk.symlink_to(tmp_path / "away")
    elif kind == "pipe":
        chunk.unlink()
        os.mkfifo(chunk)
    else:
        (path / "more").symlink_to(tmp_path / "other")
    with pytest.raises(FileFormatError, match=r"holds a (link|pipe or device) \("):
        read(path, axes="yxt")


@pytest.mark.parametrize("version", [2, 3])
def test_chunks_that_lack_are_told(tmp_path, version):
    path = folder_of(tmp_path, version)
    (path / ("1.0.0" if version == 2 else "c/1/0/0")).unlink()
    with pytest.warns(SuspectDataWarning, match="1 of 2 chunks are not there"):
        hist = read(path, axes="yxt")
    assert hist.counts[4:].sum() == 0


def test_chunks_that_lack_within_shards_are_told(tmp_path):
    path = tmp_path / "x.zarr"
    node = zarr.create_array(
        str(path), shape=CUBE.shape, chunks=(4, 5, 16), shards=(8, 5, 16), dtype="u2"
    )
    node[:4] = CUBE[:4]
    with pytest.warns(SuspectDataWarning, match="1 of 2 chunks are not there"):
        read(path, axes="yxt")


def test_another_spelling_of_a_number_is_no_chunk(tmp_path):
    """c/00/0/0 was counted for c/0/0/0, which was not there and became zeros in silence."""
    path = folder_of(tmp_path)
    (path / "c" / "0").rename(path / "c" / "00")
    with pytest.warns(SuspectDataWarning, match="1 of 2 chunks are not there"):
        read(path, axes="yxt")


# Of the flags, 2 announces a sum of the header, which is wrong here, and 32 nothing.
_MEMBERS: dict[str, Any] = {
    "two gzip": lambda first, bomb: first + bomb,
    "padded gzip": lambda first, bomb: first + bytes(7) + bomb,
    "summed gzip": lambda _, bomb: bomb[:3] + b"\2" + bomb[4:10] + b"\0\0" + bomb[10:],
    "flagged gzip": lambda _, bomb: bomb[:3] + b"\x20" + bomb[4:],
    "two zstd": lambda first, bomb: first + bomb,
    "zstd behind a gap": lambda first, bomb: first + b"\x50\x2a\x4d\x18\4\0\0\0gap!" + bomb,
}


@pytest.mark.parametrize("packed", ["zstd", "blosc", "gzip", *_MEMBERS, "zlib"])
def test_chunks_that_would_swell_are_refused_unpacked(tmp_path, packed):
    """A chunk of 640 bytes that would become 4 MB; of gzip also where zlib itself would stop."""
    codecs = zarr.codecs
    kinds = {"zstd": codecs.ZstdCodec(), "blosc": codecs.BloscCodec(), "gzip": codecs.GzipCodec()}
    version = 2 if packed == "zlib" else 3
    kind = next(one for one in ("zstd", "blosc", "gzip", "zlib") if one in packed)
    kinds["zlib"] = numcodecs.Zlib()
    path = folder_of(tmp_path, version, compressors=kinds[kind])
    zeros = bytes(4 << 20)
    packers = {"zstd": numcodecs.Zstd(), "blosc": numcodecs.Blosc(), "gzip": numcodecs.GZip(),
               "zlib": numcodecs.Zlib()}  # fmt: skip
    content = bytes(packers[kind].encode(zeros))
    if packed in _MEMBERS:
        content = _MEMBERS[packed](bytes(packers[kind].encode(b"\0")), content)
    (path / ("0.0.0" if version == 2 else "c/0/0/0")).write_bytes(content)
    with pytest.raises(FileFormatError, match=r"becomes .* bytes or does not say how many"):
        read(path, axes="yxt")


def _shards(inner: list[int], codecs: list[Any]) -> dict[str, Any]:
    index = [{"name": "bytes", "configuration": {"endian": "little"}}]
    told = {"chunk_shape": inner, "codecs": codecs, "index_codecs": index, "index_location": "end"}
    return {"name": "sharding_indexed", "configuration": told}


_BYTES = {"name": "bytes", "configuration": {"endian": "little"}}
_BLOSC = {
    "name": "blosc",
    "configuration": {
        "cname": "zstd", "clevel": 5, "shuffle": "noshuffle", "typesize": 2, "blocksize": 0,
    },
}  # fmt: skip


@pytest.mark.parametrize("kind", ["packed again", "within shards", "too long", "too many"])
def test_what_lies_in_shards_is_not_hidden(tmp_path, kind):
    """64 MB in a few kilobytes, where the index of its shard does not show it."""
    bomb = bytes(numcodecs.Blosc(cname="zstd").encode(bytes(64 << 20)))
    inner, packed = [4, 5, 16], [_BYTES, _BLOSC]
    entry = np.array([0, len(bomb)], "<u8").tobytes()
    content, codecs = bomb + entry, [_shards(inner, packed)]
    if kind == "packed again":
        zeros = bytes(numcodecs.Zstd().encode(bytes(64 << 20)))
        content, codecs = zeros, [_shards(inner, [_BYTES]), {"name": "zstd", "configuration": {}}]
    elif kind == "within shards":
        # The outer index: one entry; read as that of two, it says that nothing is there.
        content += np.array([0, len(content)], "<u8").tobytes()
        codecs = [_shards(inner, [_shards(inner, packed)])]
    elif kind == "too long":
        content = bomb + np.array([0, len(bomb) + 999], "<u8").tobytes()
    path = changed(folder_of(tmp_path), 3, codecs=codecs)
    if kind == "too many":
        grid = {"name": "regular", "configuration": {"chunk_shape": [4, 5, 1 << 40]}}
        changed(path, 3, codecs=[_shards([1, 1, 1], packed)], chunk_grid=grid)
    for file in path.rglob("c/*/0/0"):
        file.write_bytes(content)
    with pytest.raises(FileFormatError, match=r"several layers|is cut|becomes|in each shard|multi"):
        read(path, axes="yxt")


@pytest.mark.parametrize("name", [".zattrs", "0.0.0"])
def test_files_of_a_store_are_no_longer_than_what_they_stand_for(tmp_path, name, monkeypatch):
    """A gigabyte of holes behind metadata or a chunk: zarr reads files whole."""
    path = folder_of(tmp_path, 2)
    with (path / name).open("ab") as file:
        file.truncate(1 << 30)
    monkeypatch.setattr(zarr, "open_array", lambda *_, **__: pytest.fail("zarr was asked"))
    with pytest.raises(FileFormatError, match=r"is too large|a multiple of what it stands for"):
        read(path, axes="yxt")


@pytest.mark.parametrize("n", [0, 1, 255, 70_000, 1_000_000])
@pytest.mark.parametrize("checksum", [False, True])
def test_frames_of_zstandard_are_counted_as_they_are_written(n, checksum):
    """By an encoder of others: noise, which does not pack, and zeros, which do."""
    codec = numcodecs.Zstd(checksum=checksum)
    noise = np.random.default_rng(16).bytes(n) + bytes(n)
    frames = bytes(codec.encode(noise)) + bytes(codec.encode(noise[:n] + bytes(range(64))))
    assert zarr_store._zstd_bytes(frames) == 3 * n + 64
