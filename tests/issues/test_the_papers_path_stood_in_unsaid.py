"""`plan` and `simulate` took the paper's path into a lab of one's own, and did not say so."""

import pytest
from click.testing import CliRunner

from lightflight.cli import main

LAB = "[camera]\nshape = [8, 8]\ndistance_mm = 535.0\nfield_of_view_mm = [245.0, 245.0]\n"
OWN = "scene.vertices_mm=[[-150,0,0],[150,5,10]]"
SAID = "the set-up has no path ([scene] vertices_mm)"


@pytest.mark.parametrize(
    "words", [("plan", "lab.toml"), ("simulate", "--lab", "lab.toml", "--dry-run", "-o", "a.h5")]
)
def test_it_is_told_unless_the_set_up_has_one(words, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "lab.toml").write_text(LAB)
    done = CliRunner().invoke(main, [*words, "--set", "camera.center_mm=[187.5, 37.5]"])
    assert done.exit_code == 0
    assert SAID in done.stderr
    assert SAID not in CliRunner().invoke(main, [*words, "--set", OWN]).stderr


def test_nothing_is_said_without_a_set_up(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    done = CliRunner().invoke(main, ["simulate", "--dry-run", "-o", "a.h5"])
    assert done.exit_code == 0
    assert SAID not in done.stderr
