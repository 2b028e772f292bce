"""Our own files: what is read without an error or a warning is what was written.

Every mutant that is read must give the values, units and metadata of the sound file. HDF5 keeps
bytes that mean nothing (gaps, old headers, times); those may change.
"""

from __future__ import annotations

import io
import shutil
import warnings
import zipfile
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest

import lightflight as lf
from lightflight.errors import FileFormatError
from lightflight.files.digest import DIGEST, SEALED
from lightflight.files.store import load_record, new_record, save_record
from tests.attacks.length import at_length
from tests.files.unsealed import unsealed
from tests.fuzz_bytes import mutated

read: Any = lf.read

CLOCK: dict[str, Any] = {"bin_width_ps": 55.0, "laser_period_ps": 50_000.0, "n_frames": 900}


def _hist(rng: np.random.Generator) -> lf.Histograms:
    cube = rng.poisson(2.0, (4, 4, 32)).astype(np.uint16)
    return lf.Histograms(cube, **CLOCK, settings={"room": "B9"})


def _recording(rng: np.random.Generator) -> lf.Recording:
    codes = rng.integers(1, 32, (60, 4, 4))
    frames = np.where(rng.random(codes.shape) < 0.2, codes, 0).astype(np.uint16)
    return lf.Recording.from_frames(frames, n_codes=32, no_photon_code=0, bin_width_ps=55.0)


def _told(record: Any) -> tuple[Any, ...]:
    """Everything a record says, as plain values."""
    hist = lf.histogram(record)
    fields = [getattr(hist, name) for name in (*CLOCK, "reversed_codes", "first_edge_ps")]
    rest = hist.no_photon_code, hist.poisson, dict(hist.settings), hist.counts.dtype.str
    return (*fields, *rest, hist.counts.shape, hist.counts.tobytes(), type(record).__name__)


@pytest.mark.parametrize("name", ["hist.h5", "events.h5", "x.npz", "x.mat", "x.zarr"])
def test_no_mutant_gives_other_values(tmp_path, name):
    """One to four changes of bytes: 300 mutants of each (seed 16), at length 4,000."""
    rng = np.random.default_rng(16)
    record: Any = _recording(rng) if name == "events.h5" else _hist(rng)
    if name == "x.zarr":
        pytest.importorskip("zarr")
    sound = tmp_path / "sound" / name
    sound.parent.mkdir()
    lf.write(record, sound)
    told = _told(read(sound))
    files = sorted(file for file in sound.rglob("*") if file.is_file()) or [sound]
    n_read = 0
    for _ in range(at_length(300, 4000)):
        path = tmp_path / name
        shutil.rmtree(path, ignore_errors=True)
        (shutil.copytree if sound.is_dir() else shutil.copyfile)(sound, path)
        one = files[int(rng.integers(len(files)))]
        changed = path / one.relative_to(sound) if sound.is_dir() else path
        changed.write_bytes(mutated(one.read_bytes(), rng))
        found = _outcome(path)
        n_read += found is not None
        assert found in (None, told)
    assert n_read > 0, "no mutant was read: the test says nothing"


def _outcome(path: Path) -> tuple[Any, ...] | None:
    """What is read of a file; None where that ends in an error or a warning."""
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        try:
            return _told(read(path))
        except (ValueError, UserWarning):
            return None


@pytest.mark.parametrize("name", ["calibration", "path"])
def test_one_changed_byte_of_small_arrays_and_attributes_is_seen(tmp_path, name, caplog):
    arrays = {"values": np.arange(9.0), "large": np.arange(9000.0), "names": np.array(["a", "b"])}
    attributes = {"bin_width_ps": 55.0, "laser_period_ps": 50_000.0}
    save_record(tmp_path / "x.h5", kind=name, arrays=arrays, attributes=attributes)
    content = (tmp_path / "x.h5").read_bytes()
    for old, new in (
        (b"55.0", b"95.0"),
        (b"laser_period", b"laser_periof"),
        (b"values", b"valves"),
    ):
        assert old in content
        (tmp_path / "y.h5").write_bytes(content.replace(old, new))
        with pytest.raises(FileFormatError, match=r"not as lightflight wrote it|damaged"):
            load_record(tmp_path / "y.h5", kind=name)
    other = name[:-1] + "s"
    shutil.copy(tmp_path / "x.h5", tmp_path / "y.h5")
    with h5py.File(tmp_path / "y.h5", "r+") as file:
        file.attrs.modify("kind", np.bytes_(other))
    with pytest.raises(FileFormatError, match="its digest is another"):
        load_record(tmp_path / "y.h5", kind=other)
    at = content.index(np.float64(4.0).tobytes() + np.float64(5.0).tobytes())
    (tmp_path / "y.h5").write_bytes(content[:at] + np.float64(4.5).tobytes() + content[at + 8 :])
    with pytest.raises(FileFormatError, match="its digest is another"):
        load_record(tmp_path / "y.h5", kind=name)


@pytest.mark.parametrize("mark", [DIGEST, SEALED])
def test_a_file_with_one_mark_of_two_is_refused(tmp_path, mark):
    save_record(tmp_path / "x.h5", kind="path", arrays={}, attributes={})
    with h5py.File(tmp_path / "x.h5", "r+") as file:
        del file.attrs[mark]
    with pytest.raises(FileFormatError, match="not as lightflight wrote it"):
        load_record(tmp_path / "x.h5", kind="path")


def test_a_file_of_an_earlier_version_is_opened_and_said_to_have_none(tmp_path, caplog):
    save_record(tmp_path / "x.h5", kind="path", arrays={}, attributes={"a": 1})
    with unsealed(tmp_path / "x.h5"):
        pass
    with caplog.at_level("INFO", logger="lightflight"):
        assert load_record(tmp_path / "x.h5", kind="path")[1] == {"a": 1}
        load_record(tmp_path / "x.h5", kind="path")
    assert caplog.text.count("x.h5 has no digest") == 1


def test_chunks_that_were_exchanged_are_seen(tmp_path):
    """Both are sound by their own checksums."""
    values = np.random.default_rng(16).integers(0, 1 << 16, 40_000).astype(np.uint16)
    with new_record(tmp_path / "x.h5", kind="recording", attributes={}) as record:
        record.append("pixel", values)
    with h5py.File(tmp_path / "x.h5", "r+") as file:
        node = file["pixel"].id
        places = [node.get_chunk_info(k).chunk_offset for k in (0, 1)]
        (_, first), (_, second) = (node.read_direct_chunk(place) for place in places)
        node.write_direct_chunk(places[0], second)
        node.write_direct_chunk(places[1], first)
    with pytest.raises(FileFormatError, match="its digest is another"):
        load_record(tmp_path / "x.h5", kind="recording")


def test_a_zarr_of_ours_without_a_chunk_is_refused(tmp_path):
    pytest.importorskip("zarr")
    lf.write(_hist(np.random.default_rng(16)), tmp_path / "x.zarr")
    (tmp_path / "x.zarr" / "c" / "0" / "0" / "0").unlink()
    with pytest.raises(FileFormatError, match="its digest is another"):
        read(tmp_path / "x.zarr")


def test_a_zarr_of_ours_with_empty_chunks_is_whole(tmp_path):
    """Zarr leaves out what is zero alone: no reason for a warning over a file of ours."""
    pytest.importorskip("zarr")
    cube = np.zeros((64, 64, 1024), np.uint16)
    cube[3, 3, 3] = 1
    lf.write(lf.Histograms(cube), tmp_path / "x.zarr")
    assert read(tmp_path / "x.zarr").counts.sum() == 1


@pytest.mark.parametrize("second", ["cube.npy", "cube"])
def test_an_archive_with_two_arrays_of_one_name_is_refused(tmp_path, second):
    """The last one was read in silence."""
    with zipfile.ZipFile(tmp_path / "x.npz", "w") as archive:
        for number, name in enumerate(("cube.npy", second)):
            buffer = io.BytesIO()
            np.save(buffer, np.full((2, 2, 8), number, np.uint16))
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")
                archive.writestr(name, buffer.getvalue())
    with pytest.raises(FileFormatError, match="holds two arrays of the name 'cube'"):
        read(tmp_path / "x.npz", axes="yxt")
