"""Tables of points for `calibrate camera`: read as they are, or refused with the file's name."""

from __future__ import annotations

import zipfile
from pathlib import Path

import numpy as np
import pytest

from lightflight.errors import FileFormatError
from lightflight.formats.point_tables import points_from_file

POINTS = np.arange(18.0).reshape(6, 3)
PIXELS = np.arange(12.0).reshape(6, 2)


def test_arrays_and_text_say_the_same(tmp_path):
    np.savez(tmp_path / "p.npz", points_mm=POINTS, pixels=PIXELS, shape=(4, 5))
    lines = [",".join(map(str, row)) for row in np.hstack([POINTS, PIXELS])]
    (tmp_path / "p.csv").write_text("\n".join(["x_mm,y_mm,z_mm,row,col", *lines]))
    for name, expected in (("p.npz", (4, 5)), ("p.csv", None)):
        points, pixels, shape = points_from_file(tmp_path / name)
        np.testing.assert_array_equal(points, POINTS)
        np.testing.assert_array_equal(pixels, PIXELS)
        assert shape == expected


@pytest.mark.parametrize(
    ("arrays", "said"),
    [
        ({"points_mm": POINTS[:5], "pixels": PIXELS}, "must be (n, 3) and (n, 2)"),
        ({"points_mm": POINTS.ravel(), "pixels": PIXELS}, "must be (n, 3) and (n, 2)"),
        ({"points_mm": POINTS.astype(str), "pixels": PIXELS}, "no numbers"),
        ({"points_mm": POINTS, "pixels": PIXELS, "shape": 4}, "two numbers"),
        ({"places": np.zeros((3, 4, 4), bool)}, "holds bool"),
        ({"places": np.zeros((3, 4))}, "a map of where pixels look"),
    ],
)
def test_other_arrays_are_refused(tmp_path, arrays, said):
    np.savez(tmp_path / "p.npz", **arrays)
    with pytest.raises(FileFormatError) as refused:
        points_from_file(tmp_path / "p.npz")
    assert said in str(refused.value)
    assert str(tmp_path / "p.npz") in str(refused.value)


def test_no_archive_a_cut_one_and_false_claims_are_refused(tmp_path):
    (tmp_path / "letter.npz").write_bytes(b"Dear colleague,")
    np.save(tmp_path / "cut.npy", POINTS)
    whole = (tmp_path / "cut.npy").read_bytes()
    (tmp_path / "cut.npy").write_bytes(whole[:-8])
    with zipfile.ZipFile(tmp_path / "claim.npz", "w", zipfile.ZIP_DEFLATED) as archive:
        claim = whole.replace(b"(6, 3), }" + b" " * 11, b"(999999999999, 3), }")
        archive.writestr("points_mm.npy", claim)
        archive.writestr("pixels.npy", whole)
    for name in ("letter.npz", "cut.npy", "claim.npz"):
        with pytest.raises(FileFormatError, match=name):
            points_from_file(Path(tmp_path, name))
