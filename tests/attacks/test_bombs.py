"""Small files that claim, or become, much: refused by what they need, never read to the end first.

Each reader is run in a process whose memory is measured: at most 1.5 x the cube it returns, and
200 MB beside it.
"""

from __future__ import annotations

import gzip
import io
import json
import os
import struct
import subprocess
import sys
import zipfile
import zlib
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
from click.testing import CliRunner

import lightflight as lf
from lightflight.cli import main
from lightflight.errors import FileFormatError
from lightflight.files import filecheck
from tests.attacks.length import at_length
from tests.formats.made_by_hand import ptu_image_bytes, sdt_bytes

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="asks /proc and makes holes")
read: Any = lf.read

MEASURE = """
import json, resource, sys, warnings
warnings.simplefilter("ignore")
import lightflight as lf
from lightflight.files import filecheck
import lightflight.recording.counting, lightflight.formats.registry
lightflight.formats.registry.known_formats()
def peak():
    # VmHWM: pages of mapped files count as well.
    lines = open("/proc/self/status").read().splitlines()
    return next(int(line.split()[1]) for line in lines if line.startswith("VmHWM")) * 1024
warm, path, hints = json.loads(sys.argv[1])
def of_readers():
    return resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss * 1024
for one in warm:
    lf.histogram(lf.read(one, **hints))
before, readers_before, said, n = peak(), of_readers(), "", 0
try:
    hist = lf.histogram(lf.read(path, **hints))
    n = hist.counts.nbytes
except ValueError as error:
    said = str(error)
# A vendor's reader has ended before its cube is taken in here.
print(json.dumps([max(peak() - before, of_readers() - readers_before), n, said]))
"""


def measured(path: Path, hints: dict[str, Any], warm: Path) -> tuple[int, int, str]:
    """(bytes of memory taken beside what a small file takes, bytes of the cube, what was said)."""
    done = subprocess.run(
        [sys.executable, "-c", MEASURE, json.dumps([[str(warm)], str(path), hints])],
        capture_output=True, text=True, check=False, timeout=300,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    taken, n, said = json.loads(done.stdout)
    return taken, n, said


def _npz(folder: Path, cube: np.ndarray) -> Path:
    np.savez_compressed(folder / "x.npz", cube=cube)
    return folder / "x.npz"


def _npy(folder: Path, cube: np.ndarray) -> Path:
    np.save(folder / "x.npy", cube)
    return folder / "x.npy"


def _mat(folder: Path, cube: np.ndarray) -> Path:
    from scipy.io import savemat

    savemat(folder / "x.mat", {"cube": cube}, do_compression=True)
    return folder / "x.mat"


def _hdf5(folder: Path, cube: np.ndarray) -> Path:
    with h5py.File(folder / "x.h5", "w") as file:
        file.create_dataset("cube", data=cube, chunks=(8, *cube.shape[1:]), compression="gzip")
    return folder / "x.h5"


def _zarr(folder: Path, cube: np.ndarray) -> Path:
    zarr = pytest.importorskip("zarr")
    chunks = (8, *cube.shape[1:])
    node = zarr.create_array(
        str(folder / "x.zarr"), shape=cube.shape, chunks=chunks, dtype=cube.dtype
    )
    node[...] = cube
    return folder / "x.zarr"


def _ours(folder: Path, cube: np.ndarray) -> Path:
    lf.write(lf.Histograms(cube), folder / "x.h5")
    return folder / "x.h5"


_MAKERS = {"npy": _npy, "npz": _npz, "mat": _mat, "hdf5": _hdf5, "zarr": _zarr, "ours": _ours}


@pytest.mark.slow
@pytest.mark.parametrize("dtype", ["u2", "f8"])
@pytest.mark.parametrize("name", _MAKERS)
def test_a_cube_is_in_memory_once_and_a_half(tmp_path, name, dtype):
    """200 MB (quick: 100 MB) of counts that pack well."""
    n = at_length(1 << 20, 1 << 22)
    cube = np.zeros((64, n // 64 // 32, 32 * 8), dtype)
    cube[0, 0, :9] = 3
    (tmp_path / "small").mkdir()
    warm = _MAKERS[name](tmp_path / "small", cube[:16, :8])
    hints = {} if name == "ours" else {"axes": "yxt"}
    taken, n_cube, said = measured(_MAKERS[name](tmp_path, cube), hints, warm)
    assert said == ""
    assert taken <= 1.5 * n_cube + 200e6


def _text(folder: Path, cube: np.ndarray) -> tuple[Path, dict[str, Any]]:
    with gzip.open(folder / "x.txt.gz", "wb", 1) as file:
        for number, pixel in enumerate(cube.reshape(-1, cube.shape[2])):
            file.write(b"Pixel %d\n%s\n" % (number, b" ".join(b"%d" % one for one in pixel)))
    return folder / "x.txt.gz", {"shape": cube.shape[:2]}


def _frames(folder: Path, cube: np.ndarray) -> tuple[Path, dict[str, Any]]:
    frames = np.zeros((cube.size // 1024, 32, 32), "<u2")
    frames[::7, 3, 4] = 5
    frames.tofile(folder / "x.bin")
    return folder / "x.bin", {"footer_bytes": 0}


def _ptu(folder: Path, cube: np.ndarray) -> tuple[Path, dict[str, Any]]:
    pytest.importorskip("ptufile")
    codes = np.full((*cube.shape[:2], 4), 7)
    codes[0, 0, 0] = 1023
    (folder / "x.ptu").write_bytes(ptu_image_bytes(codes))
    return folder / "x.ptu", {}


def _sdt(folder: Path, cube: np.ndarray) -> tuple[Path, dict[str, Any]]:
    pytest.importorskip("sdtfile")
    decays = cube.reshape(-1, cube.shape[2]).astype("<u2")
    (folder / "x.sdt").write_bytes(sdt_bytes(decays, packed=True))
    return folder / "x.sdt", {}


_OF_OTHERS = {"text": _text, "frames": _frames, "ptu": _ptu, "sdt": _sdt}


@pytest.mark.slow
@pytest.mark.parametrize("name", _OF_OTHERS)
def test_what_instruments_write_is_in_memory_once_and_a_half_too(tmp_path, name):
    """A cube of 67 MB (quick: 17 MB) of counts of 32 bits; a vendor's reader is counted as well."""
    n = at_length(64, 128)
    cube = np.zeros((n, n, 1024), np.uint32)
    cube[0, 0, :9] = 3
    (tmp_path / "small").mkdir()
    small, _ = _OF_OTHERS[name](tmp_path / "small", cube[:32, :32])
    path, hints = _OF_OTHERS[name](tmp_path, cube)
    if name == "text":  # whose shape is told
        small, _ = _OF_OTHERS[name](tmp_path / "small", cube[:, :, :8])
    taken, n_cube, said = measured(path, hints, small)
    assert said == ""
    assert taken <= 1.5 * n_cube + 200e6, (taken, n_cube)


def _holes(path: Path, head: bytes, n_bytes: int) -> Path:
    """A file that is long, and of which hardly anything is on the disk."""
    path.write_bytes(head)
    os.truncate(path, len(head) + n_bytes)
    return path


def _npy_head(shape: tuple[int, ...]) -> bytes:
    out = io.BytesIO()
    np.lib.format.write_array_header_1_0(
        out, {"descr": "<u2", "fortran_order": False, "shape": shape}
    )
    return out.getvalue()


_BOMB = (1 << 12, 1 << 10, 1 << 10)


def _npy_bomb(folder: Path) -> tuple[Path, dict[str, Any]]:
    return _holes(folder / "b.npy", _npy_head(_BOMB), 1 << 33), {"axes": "yxt"}


def _hdf5_bomb(folder: Path) -> tuple[Path, dict[str, Any]]:
    with h5py.File(folder / "b.h5", "w") as file:
        cube = file.create_dataset("cube", _BOMB, "u2", chunks=(64, 1024, 1024), compression=9)
        packed = zlib.compress(bytes(64 << 21), 9)
        for first in range(0, at_length(64, _BOMB[0]), 64):
            cube.id.write_direct_chunk((first, 0, 0), packed)
    return folder / "b.h5", {"axes": "yxt"}


def _text_bomb(folder: Path) -> tuple[Path, dict[str, Any]]:
    line = b"0 " * 1000 + b"\n"
    lines = b"".join(b"Pixel %d\n%s" % (k, line) for k in range(200))
    (folder / "b.txt.gz").write_bytes(gzip.compress(lines))
    return folder / "b.txt.gz", {"shape": [1 << 15, 1 << 15]}


def _mat_bomb(folder: Path) -> tuple[Path, dict[str, Any]]:
    header = struct.pack("<IIII", 6, 8, 6, 0) + struct.pack("<IIiii", 5, 12, *_BOMB) + bytes(4)
    name = struct.pack("<II", 1, 4) + b"cube" + bytes(4)
    body = header + name + struct.pack("<II", 9, 0xFFFFFFF8)
    head = b"MATLAB 5.0 MAT-file".ljust(124) + b"\0\1IM"
    (folder / "b.mat").write_bytes(head + struct.pack("<II", 14, len(body)) + body)
    return folder / "b.mat", {"axes": "yxt"}


_BOMBS = {"npy": _npy_bomb, "hdf5": _hdf5_bomb, "text": _text_bomb, "mat": _mat_bomb}
"""Files of some kilobytes that stand for 8 GiB or more."""


@pytest.mark.parametrize("kind", _BOMBS)
def test_what_stands_for_more_than_half_of_the_memory_is_refused_at_once(
    tmp_path, kind, monkeypatch
):
    monkeypatch.setattr(filecheck, "free_memory_bytes", lambda: 1 << 32)
    path, hints = _BOMBS[kind](tmp_path)
    before = _resident()
    with pytest.raises(FileFormatError) as caught:
        read(path, **hints)
    assert _resident() - before < 300e6
    if kind not in ("mat", "hdf5"):
        assert "say --trust (trust=True)" in str(caught.value)


def _resident() -> int:
    return int(Path("/proc/self/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE")


_CRUMBS = (4, 4, 1 << 21)
"""67 MB of counts in eight million chunks of which none is stored: minutes, and 32 GB by HDF5."""


@pytest.mark.parametrize("name", ["x.h5", "x.mat", "x.zarr"])
def test_what_is_cut_into_more_pieces_than_are_there_is_refused_at_once(tmp_path, name):
    if name == "x.zarr":
        zarr = pytest.importorskip("zarr")
        zarr.create_array(str(tmp_path / name), shape=_CRUMBS, chunks=(4, 1, 1), dtype="u2")
    else:
        with h5py.File(tmp_path / name, "w", userblock_size=512) as file:
            file.create_dataset("cube", _CRUMBS, "u2", chunks=(4, 1, 1))
        if name == "x.mat":
            content = (tmp_path / name).read_bytes()[128:]
            (tmp_path / name).write_bytes(b"MATLAB 7.3 MAT-file".ljust(124) + b"\0\2IM" + content)
    with pytest.raises(FileFormatError, match=r"8388608 (pieces|chunks)"):
        read(tmp_path / name, axes="yxt")


def test_many_pieces_are_read_few_at_a_time(tmp_path, monkeypatch):
    """The same values, however they are cut; HDF5 alone would take 4 kB for each piece."""
    from lightflight.files import chunked

    values = np.random.default_rng(16).integers(0, 99, (8, 50, 60)).astype(np.uint16)
    keys: Any = [(), slice(None), slice(1, 5), slice(2, 2), 3, (slice(0, 2), 1)]
    monkeypatch.setattr(chunked, "_MOST_AT_ONCE", 50)
    for chunks in ((2, 3, 4), (1, 1, 1), (8, 1, 60)):
        with h5py.File(tmp_path / "x.h5", "w") as file:
            cube = file.create_dataset("cube", data=values, chunks=chunks)
            for key in keys:
                np.testing.assert_array_equal(chunked.read_in_parts(cube, key), values[key])
    monkeypatch.undo()
    with h5py.File(tmp_path / "x.h5", "w") as file:
        file.create_dataset("cube", (4, 4, 1 << 16), "u2", chunks=(4, 1, 1))
    (tmp_path / "small").mkdir()
    taken, _, said = measured(tmp_path / "x.h5", {"axes": "yxt"}, _hdf5(tmp_path / "small", values))
    assert said == ""
    assert taken < 200e6, "a quarter of a million pieces"


def test_what_starves_is_no_bomb(tmp_path):
    """A ratio alone is no reason: 16 million counts of which nine are not zero."""
    cube = np.zeros((64, 64, 4096), np.uint16)
    cube[0, 0, :9] = 1
    path = _npz(tmp_path, cube)
    assert cube.nbytes > 900 * path.stat().st_size
    assert read(path, axes="yxt").counts.sum() == 9


def test_trust_is_said_once_and_forgotten(tmp_path, monkeypatch):
    cube = np.ones((4, 4, 4096), np.uint16)
    path = _npz(tmp_path, cube)
    monkeypatch.setattr(filecheck, "free_memory_bytes", lambda: 800_000)
    with pytest.raises(FileFormatError, match=r"say --trust \(trust=True\)"):
        read(path, axes="yxt")
    assert read(path, axes="yxt", trust=True).counts.sum() == cube.size
    with pytest.raises(FileFormatError, match="say --trust"):
        read(path, axes="yxt")
    words = ["info", str(path), "--hint", "axes=yxt"]
    refused = CliRunner().invoke(main, words)
    assert refused.exit_code == 3
    assert CliRunner().invoke(main, [*words, "--trust"]).exit_code == 0
    assert not filecheck.is_trusted()


def test_text_that_never_ends_is_ended(tmp_path):
    (tmp_path / "x.txt.gz").write_bytes(
        gzip.compress(b"Pixel 0\n1 2 3\n" + b"\n" * 30_000_000, compresslevel=1)
    )
    with pytest.raises(FileFormatError, match="is no histogram, or more than 2 GB of text"):
        read(tmp_path / "x.txt.gz", shape=(2, 2))


def test_events_of_spc_stay_in_the_file(tmp_path, monkeypatch):
    """The same photons, whatever the blocks they are read in."""
    from lightflight.formats import spc

    rng = np.random.default_rng(16)
    records = rng.integers(0, 1 << 32, 5000, dtype=np.uint64).astype("<u4") & ~np.uint32(1 << 31)
    records[0] = 0x80000064
    records.tofile(tmp_path / "x.spc")
    photons = records[1:][records[1:] & 0x90000000 == 0]
    whole = lf.histogram(read(tmp_path / "x.spc")).counts
    expected = np.zeros((1, 16, 4096), int)
    np.add.at(expected, (0, photons >> 12 & 15, 4095 - (photons >> 16 & 0xFFF)), 1)
    np.testing.assert_array_equal(whole, expected)
    monkeypatch.setattr(spc, "_RECORDS_AT_ONCE", 700)
    monkeypatch.setattr(spc, "_HELD_BYTES", 0)
    recording = read(tmp_path / "x.spc")
    np.testing.assert_array_equal(lf.histogram(recording, chunk_bytes=999).counts, expected)
    np.testing.assert_array_equal(
        recording.code[100:2500], 4095 - (photons[100:2500] >> 16 & 0xFFF)
    )


@pytest.mark.slow
def test_a_long_spc_is_counted_in_little_memory(tmp_path):
    """100 MB (at length: 3 GB)."""
    n = at_length(25_000_000, 750_000_000)
    rng = np.random.default_rng(16)
    block = rng.integers(0, 1 << 28, 1 << 20, dtype=np.int64).astype("<u4") & ~np.uint32(0xF000)
    with (tmp_path / "x.spc").open("wb") as file:
        file.write(np.array([0x80000064], "<u4").tobytes())
        for _ in range(-(-n // block.size)):
            file.write(block.tobytes())
    np.array([0x80000064, 1 << 16], "<u4").tofile(tmp_path / "warm.spc")
    taken, n_cube, said = measured(tmp_path / "x.spc", {}, tmp_path / "warm.spc")
    assert (said, n_cube) == ("", 4096 * 4)
    assert taken < 300e6


def test_an_archive_within_its_checksum_alone_is_read(tmp_path):
    """A member whose header was changed to less would leave its checksum unseen."""
    cube = np.arange(64, dtype=np.uint16).reshape(4, 4, 4)
    buffer = io.BytesIO()
    np.save(buffer, cube)
    content = buffer.getvalue().replace(b"(4, 4, 4)", b"(4, 4, 2)")
    with zipfile.ZipFile(tmp_path / "x.npz", "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("cube.npy", content)
    with pytest.raises(FileFormatError, match="the archive holds 128"):
        read(tmp_path / "x.npz", axes="yxt")


def test_pictures_and_lists_of_numbers_are_bounded_too(tmp_path, monkeypatch):
    from lightflight.cli.commands.calibrate import _array_from_file
    from lightflight.formats.point_tables import picture_from_file

    cv2 = pytest.importorskip("cv2")
    cv2.imwrite(str(tmp_path / "x.png"), np.zeros((4000, 4000), np.uint8))
    monkeypatch.setattr(filecheck, "free_memory_bytes", lambda: 200_000_000)
    with pytest.raises(FileFormatError, match=r"a picture \(4000, 4000\) needs"):
        picture_from_file(tmp_path / "x.png")
    (tmp_path / "x.txt.gz").write_bytes(gzip.compress(b"1 2 3\n" * 1000))
    with pytest.raises(FileFormatError, match="holds no array of numbers"):
        _array_from_file(tmp_path / "x.txt.gz")
    os.mkfifo(tmp_path / "pipe.txt")
    with pytest.raises(FileFormatError, match="is a pipe or device"):
        _array_from_file(tmp_path / "pipe.txt")
    (tmp_path / "x.csv").write_text("1,2\n3,4\n")
    assert _array_from_file(tmp_path / "x.csv").shape == (2, 2)


def test_an_archive_of_very_many_arrays_is_not_gone_through(tmp_path):
    """100,000 of three numbers each, 25 MB, took half a minute to say that they are several."""
    with zipfile.ZipFile(tmp_path / "x.npz", "w") as archive:
        for number in range(10_001):
            archive.writestr(f"{number}.npy", b"")
    with pytest.raises(FileFormatError, match="an archive of 10001 files, more than 10000"):
        read(tmp_path / "x.npz", axes="yxt")


def test_a_matlab_file_of_very_many_variables_is_not_gone_through(tmp_path):
    """200,000 empty ones took seconds, and ten times as many ten times as long."""
    body = struct.pack("<IIIIIIii", 6, 8, 6, 0, 5, 8, 1, 1)
    body += struct.pack("<I4sIId", 1 | 1 << 16, b"v", 9, 8, 1.0)
    one = struct.pack("<II", 14, len(body)) + body
    head = b"MATLAB 5.0 MAT-file".ljust(124) + b"\0\1IM"
    (tmp_path / "x.mat").write_bytes(head + one * 10_001)
    with pytest.raises(FileFormatError, match="more than 10000 variables"):
        read(tmp_path / "x.mat", axes="yxt")
