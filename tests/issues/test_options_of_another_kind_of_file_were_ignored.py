"""Options that say nothing of what a file holds were taken in silence.

`movie path.h5 --slice-codes 4` or `plot path.h5 --pixel 3 4` went on as if they had not been given,
and who had given them took what came out for their work.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from lightflight.cli import main
from tests.view import fakes

OF_A_PATH = (
    ("movie path.h5 --slice-codes 4 -o f.gif", "--slice-codes goes with a recording"),
    ("movie path.h5 --title Flight -o f.gif", "--title goes with a recording"),
    ("movie path.h5 --timing clock.h5 -o f.gif", "--timing goes with a recording"),
    ("plot path.h5 --pixel 3 4 -o f.png", "--pixel goes with --what pixel"),
    ("plot path.h5 --timing clock.h5 -o f.png", "--timing goes with a recording"),
    ("plot path.h5 --hint axes=tyx -o f.png", "--hint goes with a recording"),
    ("view path.h5 path.h5 --viewpoint 1 2 3 -o f.html", "--viewpoint goes with one path file"),
    ("view path.h5 path.h5 --recording counts.npy -o f.html", "--recording goes with one path"),
    ("export path.h5 --what pulses -o path.vtu", "--what goes with a table: .csv or .parquet"),
)
OF_A_RECORDING = (
    ("movie counts.npy --pace 100 -o f.gif", "--pace goes with a path"),
    ("movie counts.npy --orbit 60 -o f.gif", "--orbit goes with a path"),
    ("movie counts.npy --viewpoint 1 2 3 -o f.gif", "--viewpoint goes with a path"),
    ("plot counts.npy --pixel 3 4 -o f.png", "--pixel goes with --what pixel"),
)


@pytest.mark.parametrize(("command", "sentence"), OF_A_PATH + OF_A_RECORDING)
def test_it_is_said_what_they_go_with(
    command: str, sentence: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    fakes.fake_path().save("path.h5")
    np.save("counts.npy", np.zeros((4, 4, 8), dtype=np.uint16))
    done = CliRunner().invoke(main, command.split(), prog_name="lightflight")
    assert done.exit_code == 2
    assert sentence in done.stderr
    assert not list(tmp_path.glob("f.*"))


def test_defaults_are_no_options_that_were_given(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    fakes.fake_path().save("path.h5")
    for command in ("export path.h5 -o path.vtu", "export path.h5 --what pulses -o path.csv"):
        done = CliRunner().invoke(main, command.split(), prog_name="lightflight")
        assert done.exit_code == 0, done.stderr
