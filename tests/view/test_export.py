"""Files other programs open."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np
import pytest

from lightflight.view.export import write_csv, write_figure
from lightflight.view.figures_timing import draw_times
from tests.view import fakes


def test_csv_holds_the_samples_of_the_path(tmp_path: Path) -> None:
    path = fakes.fake_path()
    write_csv(path, tmp_path / "path.csv", samples=50)
    with (tmp_path / "path.csv").open(newline="") as stream:
        rows = list(csv.DictReader(stream))
    table = path.sample(50)
    assert list(rows[0]) == list(table.dtype.names or ())
    for name in rows[0]:
        read = np.array([float(row[name]) for row in rows])
        np.testing.assert_allclose(read, table[name].astype(float), rtol=1e-8)


@pytest.mark.parametrize(
    ("suffix", "magic"), [("png", b"\x89PNG"), ("pdf", b"%PDF"), ("svg", b"<?xml")]
)
def test_figures_are_written_in_the_format_of_their_name(
    tmp_path: Path, suffix: str, magic: bytes
) -> None:
    figure = draw_times(fakes.fake_path()).get_figure(root=True)
    assert figure is not None
    for name in ("a", "b"):
        write_figure(figure, tmp_path / f"{name}.{suffix}")
    written = (tmp_path / f"a.{suffix}").read_bytes()
    assert written.startswith(magic)
    if suffix != "svg":  # ids in SVG are random unless a salt is set
        assert written == (tmp_path / f"b.{suffix}").read_bytes()


def test_a_foreign_suffix_is_refused_and_nothing_is_written(tmp_path: Path) -> None:
    figure = draw_times(fakes.fake_path()).get_figure(root=True)
    assert figure is not None
    with pytest.raises(ValueError, match=r"must end in \.png"):
        write_figure(figure, tmp_path / "picture.txt")
    with pytest.raises(ValueError, match=r"\.csv"):
        write_csv(fakes.fake_path(), tmp_path / "path.txt")
    with pytest.raises(ValueError, match="at least 2"):
        write_csv(fakes.fake_path(), tmp_path / "path.csv", samples=1)
    assert list(tmp_path.iterdir()) == []
