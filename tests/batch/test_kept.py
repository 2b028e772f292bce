"""What a later task finds where an earlier one keeps a file."""

import numpy as np
import pytest

from lightflight.batch.kept import is_kept, is_kept_whole, kept_arrays
from lightflight.errors import FileFormatError
from lightflight.files.store import save_record

KIND = "counted piece"


@pytest.fixture
def file(tmp_path):
    path = tmp_path / "piece.h5"
    # Noise, which cannot be packed: else the counts are a small part of the file.
    arrays = {"counts": np.random.default_rng(1).integers(0, 1 << 32, (200, 300), np.uint32)}
    save_record(path, kind=KIND, arrays=arrays, attributes={"key": "mine"})
    return path


def test_a_file_of_the_same_job_is_taken_up(file):
    assert is_kept(file, KIND, "mine")
    assert is_kept_whole(file, KIND, "mine")
    assert kept_arrays(file, KIND, "mine")["counts"].shape == (200, 300)


@pytest.mark.parametrize("kind", [KIND, "sorted piece"])
def test_a_file_of_another_job_or_kind_is_not(file, kind):
    key = "another" if kind == KIND else "mine"
    assert not is_kept(file, kind, key)
    assert not is_kept_whole(file, kind, key)
    with pytest.raises(FileFormatError):
        kept_arrays(file, kind, key)


def test_what_is_not_there_is_not_kept(tmp_path):
    assert not is_kept(tmp_path / "none.h5", KIND, "mine")
    assert not is_kept_whole(tmp_path / "none.h5", KIND, "mine")


def test_damage_behind_the_head_shows_only_to_who_reads_all(file):
    stored = bytearray(file.read_bytes())
    middle = len(stored) // 2
    stored[middle : middle + 64] = bytes(64)
    file.write_bytes(stored)
    assert is_kept(file, KIND, "mine")
    assert not is_kept_whole(file, KIND, "mine")
