"""Arrays of HDF5 that no cube is: one of nine axes was told as several, half floats warned."""

from __future__ import annotations

import warnings

import h5py
import numpy as np
import pytest

import lightflight as lf
from lightflight.errors import FileFormatError


@pytest.mark.parametrize("shape", [(), (2,) * 9])
def test_one_array_of_other_axes_is_not_several(tmp_path, shape):
    with h5py.File(tmp_path / "x.h5", "w") as file:
        file.create_dataset("counts", shape, "u2")
    with pytest.raises(FileFormatError, match="axes") as told:
        lf.read(tmp_path / "x.h5", axes="yxt")
    assert "several" not in str(told.value)


def test_half_precision_is_read_without_a_word(tmp_path):
    with h5py.File(tmp_path / "x.h5", "w") as file:
        file.create_dataset("counts", data=np.ones((4, 4, 8), np.float16))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert lf.histogram(lf.read(tmp_path / "x.h5", axes="yxt")).counts.sum() == 128
