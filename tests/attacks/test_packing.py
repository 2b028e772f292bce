"""Chunks of HDF5 packed to harm: streams without end, packings that HDF5 follows blindly."""

from __future__ import annotations

import subprocess
import sys
import zlib
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest

import lightflight as lf
from lightflight.errors import FileFormatError
from lightflight.files.chunked import read_in_parts

CUBE = np.ones((4, 4, 64), np.uint16)
READ = "import sys, lightflight as lf; lf.histogram(lf.read(sys.argv[1], axes='yxt'))"


@pytest.fixture(scope="module")
def endless() -> bytes:
    """3 MB that stand for 3 GB."""
    stream = zlib.compressobj(9)
    start = stream.compress(bytes(1 << 24)) + stream.flush(zlib.Z_FULL_FLUSH)
    again = stream.compress(bytes(1 << 24)) + stream.flush(zlib.Z_FULL_FLUSH)
    return start + 180 * again


def _read_by_another(path: Path) -> str:
    """What another process says: this one is to live on."""
    done = subprocess.run(
        [sys.executable, "-c", READ, str(path)], capture_output=True, text=True, check=False
    )
    assert done.returncode == 1, f"ended by {done.returncode}"
    return done.stderr.splitlines()[-1]


@pytest.mark.parametrize("codes", [64, 1 << 17], ids=["a small chunk", "a large chunk"])
def test_a_chunk_that_unpacks_without_end_is_refused(tmp_path, endless, codes):
    with h5py.File(tmp_path / "x.h5", "w") as file:
        shape = (4, 4, codes)
        counts = file.create_dataset("counts", shape, "u2", chunks=shape, compression="gzip")
        counts.id.write_direct_chunk((0, 0, 0), endless)
    with pytest.raises(FileFormatError, match=r"a chunk of array '/counts'.*hold"):
        lf.histogram(lf.read(tmp_path / "x.h5", axes="yxt"))


@pytest.mark.parametrize("number", [4, 5, 6], ids=["szip", "nbit", "scale and offset"])
def test_packings_that_follow_the_file_blindly_are_refused(tmp_path, number):
    """One byte of a file made HDF5's own n-bit packing of its checksum: a segmentation fault."""
    path = tmp_path / "x.h5"
    with h5py.File(path, "w") as file:
        file.create_dataset("counts", data=CUBE, compression="gzip", fletcher32=True)
    whole = bytearray(path.read_bytes())
    # Number of the filter, length of its name, flags, number of parameters; 2 bytes each.
    place = whole.index(b"fletcher32") - 8
    assert whole[place] == h5py.h5z.FILTER_FLETCHER32
    whole[place] = number
    path.write_bytes(whole)
    assert "is packed in an unusual way" in _read_by_another(path)


def test_what_programs_pack_is_read(tmp_path):
    ways: tuple[dict[str, Any], ...] = (
        {}, {"compression": "gzip"}, {"compression": "gzip", "shuffle": True}, {"fletcher32": True},
        {"compression": "lzf"}, {"compression": "lzf", "shuffle": True, "fletcher32": True},
    )  # fmt: skip
    rng = np.random.default_rng(0)
    # Noise does not pack at all: its chunks are a little longer than what they hold.
    cube = rng.integers(0, 1 << 16, (8, 8, 1 << 14), dtype=np.uint16)
    for k, way in enumerate(ways):
        with h5py.File(tmp_path / f"{k}.h5", "w") as file:
            file.create_dataset("counts", data=cube, chunks=True, **way)
        hist = lf.histogram(lf.read(tmp_path / f"{k}.h5", axes="yxt"))
        assert np.array_equal(hist.counts, cube)


def test_only_the_chunks_that_are_asked_for_are_looked_at(tmp_path, endless):
    """By the number of a frame too: to look at all of them for each takes hours."""
    with h5py.File(tmp_path / "x.h5", "w") as file:
        counts = file.create_dataset("x", (4, 1 << 17), "u2", chunks=(1, 1 << 17), compression=1)
        counts[:] = np.arange(4)[:, np.newaxis]
        counts.id.write_direct_chunk((3, 0), endless[:250_000])
        sound: list[Any] = [1, slice(0, 2), (2, slice(5, 9)), (slice(1, 3), 7), np.int64(0), -2]
        for key in sound:
            assert np.array_equal(read_in_parts(counts, key), counts[key])
        harmful: list[Any] = [3, -1, slice(2, 4), (), (slice(None), 0), ([0, 3],)]
        for key in harmful:
            with pytest.raises(FileFormatError, match="unpacks to more"):
                read_in_parts(counts, key)
