"""Arrays that no cube is: nine axes were told as several arrays, complex numbers as damage."""

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


def test_a_zarr_of_complex_numbers_is_not_damaged(tmp_path):
    zarr = pytest.importorskip("zarr")
    zarr.save(tmp_path / "x.zarr", np.ones((4, 4, 8), np.complex64))
    with pytest.raises(FileFormatError, match="'complex64', no numbers; save counts") as told:
        lf.read(tmp_path / "x.zarr", axes="yxt")
    assert "damaged" not in str(told.value)
