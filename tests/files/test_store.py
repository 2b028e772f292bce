"""store: files appear whole or not at all, and damaged ones are refused in one sentence."""

from __future__ import annotations

import os
import stat
from pathlib import Path

import h5py
import numpy as np
import pytest
from hypothesis import given, strategies as st
from hypothesis.extra import numpy as hnp

from lightflight.errors import FileFormatError
from lightflight.files.store import (
    NEWEST_SCHEMA,
    kind_of_record,
    load_record,
    new_record,
    save_record,
)
from lightflight.files.whole_file import atomic_path
from tests.files.unsealed import unsealed


def _save(path: Path, **arrays: np.ndarray) -> None:
    save_record(path, kind="path", arrays=arrays, attributes={"a": 1})


def _names(folder: Path) -> list[str]:
    return sorted(entry.name for entry in folder.iterdir())


# --- round trip -------------------------------------------------------------------------


def test_round_trip_keeps_values_types_shapes_and_order(tmp_path, rng):
    table = np.zeros(700, dtype=[("row", "i4"), ("used", "?"), ("arrival_ps", "f8")])
    table["arrival_ps"] = rng.normal(size=700)
    arrays = {
        "zeta": rng.integers(0, 2**63, (40, 50), dtype=np.uint64),
        "camera/matrix": rng.normal(size=(3, 3)),
        "alpha": np.array([np.nan, np.inf, -np.inf]),
        "flag": np.array([True, False]),
        "names": np.array(["gerade", "µ-leg"]),
        "empty": np.zeros((0, 4)),
        "scalar": np.array(2.5),
        "table": table,
        "strided": np.arange(60_000.0).reshape(200, 300)[::2, ::-3],
    }
    attributes = {"text": "façade \x00", "number": 1.5, "none": None, "list": [1, {"x": [True]}]}
    save_record(tmp_path / "r.h5", kind="path", arrays=arrays, attributes=attributes)
    back, back_attributes = load_record(tmp_path / "r.h5", kind="path")
    assert back_attributes == attributes
    assert set(back) == set(arrays)
    for name, array in arrays.items():
        assert back[name].dtype == array.dtype, name
        np.testing.assert_array_equal(back[name], array)
    assert kind_of_record(tmp_path / "r.h5") == "path"


@given(
    values=hnp.arrays(
        dtype=st.one_of(hnp.integer_dtypes(), hnp.floating_dtypes(), hnp.boolean_dtypes()),
        shape=hnp.array_shapes(min_dims=0, max_dims=4, min_side=0, max_side=12),
    )
)
def test_any_array_comes_back(values, tmp_path_factory):
    path = tmp_path_factory.mktemp("any") / "r.h5"
    _save(path, values=values)
    back = load_record(path, kind="path")[0]["values"]
    assert back.dtype == values.dtype.newbyteorder("=")
    np.testing.assert_array_equal(back, values)


def test_numpy_values_and_non_finite_numbers_become_json(tmp_path):
    attributes = {"n": np.int64(3), "shape": (2, 3), "x": np.arange(2.0), "bad": float("nan")}
    save_record(tmp_path / "r.h5", kind="path", arrays={}, attributes=attributes)
    back = load_record(tmp_path / "r.h5", kind="path")[1]
    assert back["n"] == 3
    assert back["shape"] == [2, 3]
    assert back["x"] == [0.0, 1.0]
    assert np.isnan(back["bad"])


def test_growing_an_array_equals_writing_it_at_once(tmp_path, rng):
    codes = rng.integers(0, 1024, 3_000_000).astype(np.uint16)
    with new_record(tmp_path / "r.h5", kind="recording", attributes={}) as record:
        for start in range(0, codes.size, 700_001):
            record.append("code", codes[start : start + 700_001])
    back = load_record(tmp_path / "r.h5", kind="recording")[0]["code"]
    np.testing.assert_array_equal(back, codes)


def test_objects_are_refused_and_leave_nothing(tmp_path):
    with pytest.raises(TypeError, match="'x' holds Python objects"):
        _save(tmp_path / "r.h5", x=np.array([object()]))
    with pytest.raises(TypeError, match="cannot be stored"):
        save_record(tmp_path / "r.h5", kind="path", arrays={}, attributes={"x": object()})
    assert _names(tmp_path) == []


# --- whole or not at all ----------------------------------------------------------------


@pytest.mark.parametrize("error", [ValueError, KeyboardInterrupt, SystemExit])
def test_an_exception_keeps_the_old_file_and_leaves_nothing(tmp_path, error):
    path = tmp_path / "table.csv"
    path.write_text("old")

    def write_half() -> None:
        with atomic_path(path) as fresh:
            fresh.write_text("half")
            raise error

    with pytest.raises(error):
        write_half()
    assert path.read_text() == "old"
    assert _names(tmp_path) == ["table.csv"]


def test_an_exception_inside_a_record_keeps_the_old_record(tmp_path):
    path = tmp_path / "r.h5"
    _save(path, x=np.arange(5))

    def write_half() -> None:
        with new_record(path, kind="path", attributes={}) as record:
            record.write("x", np.zeros(100_000))
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        write_half()
    np.testing.assert_array_equal(load_record(path, kind="path")[0]["x"], np.arange(5))
    assert _names(tmp_path) == ["r.h5"]


def test_atomic_path_keeps_suffix_permissions_and_links(tmp_path):
    real = tmp_path / "real.csv"
    real.write_text("old")
    real.chmod(0o640)
    link = tmp_path / "link.csv"
    link.symlink_to(real)
    with atomic_path(link) as fresh:
        assert fresh.suffix == ".csv"
        assert fresh.parent == tmp_path
        fresh.write_text("new")
        assert real.read_text() == "old"
    assert link.is_symlink()
    assert real.read_text() == "new"
    assert stat.S_IMODE(real.stat().st_mode) == 0o640


def test_a_new_file_gets_the_permissions_of_the_umask(tmp_path):
    old = os.umask(0o027)
    try:
        with atomic_path(tmp_path / "new.csv") as fresh:
            fresh.write_text("x")
        with atomic_path(tmp_path / "new.zarr", directory=True):
            pass
    finally:
        os.umask(old)
    assert stat.S_IMODE((tmp_path / "new.csv").stat().st_mode) == 0o640
    assert stat.S_IMODE((tmp_path / "new.zarr").stat().st_mode) == 0o750


def test_a_folder_appears_whole_or_not_at_all(tmp_path):
    path = tmp_path / "cube.zarr"
    for text in ("first", "second"):
        with atomic_path(path, directory=True) as fresh:
            (fresh / "part").write_text(text)
        assert (path / "part").read_text() == text

    def write_half() -> None:
        with atomic_path(path, directory=True) as fresh:
            (fresh / "part").write_text("half")
            raise ValueError("stop")

    with pytest.raises(ValueError, match="stop"):
        write_half()
    assert (path / "part").read_text() == "second"
    assert _names(tmp_path) == ["cube.zarr"]


def test_targets_that_cannot_be_written_are_refused_before_work(tmp_path):
    (tmp_path / "file").write_text("old")
    (tmp_path / "folder").mkdir()
    os.mkfifo(tmp_path / "pipe")
    cases = [
        (tmp_path / "absent" / "x.h5", False, FileNotFoundError, "make its folder first"),
        (tmp_path / "folder", False, IsADirectoryError, "in place of a folder"),
        (tmp_path / "file", True, NotADirectoryError, "in place of a file"),
        (tmp_path / "pipe", False, OSError, "pipe or device"),
    ]
    for path, directory, error, text in cases:
        with pytest.raises(error, match=text), atomic_path(path, directory=directory):
            pytest.fail("must not get here")
    assert _names(tmp_path) == ["file", "folder", "pipe"]


# --- files that are not what they should be ---------------------------------------------


def _bad_files(folder: Path) -> dict[str, Path]:
    good = folder / "good.h5"
    _save(good, x=np.random.default_rng(0).normal(size=20_000))
    image = good.read_bytes()
    contents = {
        "is empty": b"",
        "not a lightflight file": b"row,col\n1,2\n",
        "truncated|damaged": image[: len(image) // 2],
        "damaged|not a lightflight": image[:40],
    }
    files = {}
    for index, (text, content) in enumerate(contents.items()):
        files[text] = folder / f"bad{index}.h5"
        files[text].write_bytes(content)
    files["no such file"] = folder / "absent.h5"
    files["is a folder"] = folder
    files["pipe or device"] = folder / "pipe"
    os.mkfifo(files["pipe or device"])
    files["not one of lightflight"] = folder / "foreign.h5"
    with h5py.File(files["not one of lightflight"], "w") as file:
        file["x"] = [1, 2]
    return files


def test_bad_files_give_one_sentence_with_their_name(tmp_path):
    for text, path in _bad_files(tmp_path).items():
        with pytest.raises(FileFormatError, match=text) as caught:
            load_record(path, kind="path")
        assert str(path) in str(caught.value)
        assert "\n" not in str(caught.value)
        assert caught.value.path == str(path)


def test_every_truncation_is_refused(tmp_path, rng):
    _save(tmp_path / "good.h5", x=rng.normal(size=3_000), y=np.arange(3))
    image = (tmp_path / "good.h5").read_bytes()
    cut = tmp_path / "cut.h5"
    for length in [1, 8, 95, 96, 500, 2_000, len(image) // 2, len(image) - 1]:
        cut.write_bytes(image[:length])
        with pytest.raises(FileFormatError):
            load_record(cut, kind="path")


def test_a_flipped_bit_in_a_large_array_is_noticed(tmp_path, rng):
    values = rng.normal(size=20_000)
    _save(tmp_path / "good.h5", x=values)
    image = bytearray((tmp_path / "good.h5").read_bytes())
    image[len(image) // 2] ^= 16
    (tmp_path / "bad.h5").write_bytes(image)
    with pytest.raises(FileFormatError, match="damaged"):
        load_record(tmp_path / "bad.h5", kind="path")


def test_wrong_kind_and_newer_schema_say_what_to_do(tmp_path):
    path = tmp_path / "r.h5"
    _save(path)
    with pytest.raises(FileFormatError, match="holds 'path', but 'calibration' is needed"):
        load_record(path, kind="calibration")
    with unsealed(path) as file:
        file.attrs["schema_version"] = NEWEST_SCHEMA["path"] + 1
    with pytest.raises(FileFormatError, match=r"newer lightflight .* upgrade"):
        load_record(path, kind="path")


def test_texts_of_variable_length_are_not_read(tmp_path):
    """Where they are kept, the HDF5 library can loop for ever in a damaged file."""
    path = tmp_path / "r.h5"
    _save(path)
    with h5py.File(path, "r") as file:
        dtypes = [file.attrs.get_id(name).dtype for name in file.attrs]
        assert not any(dtype.hasobject for dtype in dtypes)
    with unsealed(path) as file:
        file.attrs["format"] = "lightflight"
    assert kind_of_record(path) is None


def test_sizes_are_checked_before_memory_is_taken(tmp_path):
    path = tmp_path / "r.h5"
    _save(path)
    with unsealed(path) as file:
        file.create_dataset("huge", (1 << 40,), np.float64, chunks=(1 << 16,))
    with pytest.raises(FileFormatError, match=r"'huge' .* claims 8796093022208 bytes"):
        load_record(path, kind="path")


def test_arrays_in_other_files_are_not_followed(tmp_path):
    (tmp_path / "secret.bin").write_bytes(bytes(800))
    path = tmp_path / "r.h5"
    _save(path)
    with unsealed(path) as file:
        file.create_dataset("away", (100,), "f8", external=[(str(tmp_path / "secret.bin"), 0, 800)])
    with pytest.raises(FileFormatError, match="'away' lies in another file"):
        load_record(path, kind="path")
