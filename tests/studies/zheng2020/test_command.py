"""`python -m studies.zheng2020`: what it writes, that it goes on where it was, and its table."""

import json

import numpy as np
import pytest
from click.testing import CliRunner
from PIL import Image

from studies.zheng2020 import fig5a, run
from studies.zheng2020.command import command, write_pictures
from studies.zheng2020.table import Row, markdown_from_rows
from tests.studies.zheng2020 import fakes


@pytest.fixture
def cheap_angles(monkeypatch):
    """Angles that are not measured."""
    monkeypatch.setattr(fig5a, "QUICK_ANGLES_DEG", (-4.0, 4.0))
    monkeypatch.setattr(fig5a, "measure_angle", fakes.measure_angle)
    fakes.CALLS.clear()


def paper(*words):
    return CliRunner().invoke(command, [str(word) for word in words])


@pytest.mark.parametrize("what", ["fig5a", "fig5b", "fig5c"])
def test_a_figure_is_drawn(cheap_angles, tmp_path, what):
    done = paper(what, "--quick", "--workers", 1, "-o", tmp_path)
    assert done.exit_code == 0, done.stderr
    assert (tmp_path / f"{what}.png").stat().st_size > 10_000
    assert "2 of 2" in done.stderr


def test_json_names_seed_and_version(cheap_angles, tmp_path):
    done = paper("fig5a", "--quick", "--workers", 1, "--seed", 3, "--json", "-o", tmp_path)
    assert done.exit_code == 0, done.stderr
    told = json.loads(done.stdout)
    assert told["seed"] == 3
    assert told["quick"] is True
    assert {row["reported"] for row in told["rows"]} >= {0.15, 3.03}
    assert json.loads((tmp_path / "fig5a-table.json").read_text())["rows"] == told["rows"]


def test_a_second_run_uses_the_first(cheap_angles, tmp_path):
    for what in ("fig5a", "fig5c"):
        done = paper(what, "--quick", "--workers", 1, "-o", tmp_path)
        assert done.exit_code == 0, done.stderr
    assert fakes.CALLS == [-4.0, 4.0]


def test_each_experiment_can_be_asked_for():
    parts = [names for what, names in run.CHOICES.items() if what != "all"]
    assert {name for names in parts for name in names} == set(run.EXPERIMENTS)


@pytest.mark.parametrize("quick", [True, False])
def test_units_have_names_of_their_own(quick):
    units = run.units_of_results(tuple(run.EXPERIMENTS), quick=quick)
    assert len({u.name for u in units}) == len(units)
    assert all("/" not in u.name for u in units)


def test_markdown_has_every_cell():
    row = Row("angle", "deg", "Fig. 5a", 0.15, 0.2, 0.01, None, 0.005, "all known")
    text = markdown_from_rows(
        (row,),
        {"lightflight": "1", "seed": 0, "made_utc": "2026-01-01", "quick": True},
        notes=["One thing.", "Another."],
    )
    assert "| angle | deg | 0.15 | 0.2 | 0.01 | – | 0.005 | 15 | all known |" in text
    assert "\n\nOne thing.\n\nAnother.\n\n" in text
    assert "quick run" in text


def test_frames_as_pictures_take_the_place_of_those_that_were_there(tmp_path):
    rng = np.random.default_rng(3)
    frames = rng.integers(0, 256, (3, 20, 30, 3), dtype=np.uint8)
    folder = tmp_path / "new" / "frames"
    assert write_pictures(frames, folder) == 3
    assert write_pictures(frames[:2], folder) == 2
    assert sorted(file.name for file in folder.iterdir()) == ["frame-0000.png", "frame-0001.png"]
    with Image.open(folder / "frame-0001.png") as picture:
        np.testing.assert_array_equal(np.asarray(picture), frames[1])
