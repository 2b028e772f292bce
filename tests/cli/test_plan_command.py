"""`lightflight plan`: what it prints and writes, and what it refuses."""

from __future__ import annotations

import json

import pytest


def test_the_papers_experiment_without_a_set_up(run, tmp_path):
    done = run(
        "plan", "--position-mm", "0.2", "--rate-hz", "200", "--camera", "side=600,40,300",
        "-o", tmp_path / "plan.png",
    )  # fmt: skip
    assert done.exit_code == 0, done.stderr
    assert "as given" in done.stdout
    assert "side" in done.stdout
    assert (tmp_path / "plan.png").stat().st_size > 10_000


def test_json_holds_the_same(run):
    done = run("plan", "--position-mm", "0.2", "--rate-hz", "200", "--json")
    found = json.loads(done.stdout)
    place = found["placements"][0]
    assert place["needed_seconds"] == pytest.approx(place["needed_photons_per_pixel"] / 200.0)
    assert place["position_rms_mm"] == pytest.approx(0.0906, rel=0.02)
    assert len(found["arrays"]) == 4


def test_what_is_known_of_the_source_counts(run, tmp_path):
    setup = tmp_path / "lab.toml"
    setup.write_text(
        "[camera]\nshape = [32, 32]\ndistance_mm = 535.0\nfield_of_view_mm = [245.0, 245.0]\n"
        "center_mm = [187.5, 37.5]\n[source]\nposition_mm = [0, 0, 0]\nposition_std_mm = 1.0\n"
        "[scene]\nvertices_mm = [[0, 0, 0], [375, 25, 50], [0, 50, 10], [375, 75, 50]]\n"
    )
    found = json.loads(run("plan", setup, "--json").stdout)
    assert found["placements"][0]["position_rms_mm"] == pytest.approx(0.64, rel=0.3)


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["--camera", "side"], "write name=x,y,z"),
        (["--camera", "side=1,2,nan"], "write name=x,y,z"),
        (["--position-mm", "-1"], "position-mm"),
        (["nowhere.toml"], "nowhere.toml"),
        (["-o", "plan.txt"], "must end in"),
    ],
)
def test_wrong_input_is_one_sentence(run, arguments, says):
    done = run("plan", *arguments)
    assert done.exit_code in (2, 3)
    assert says in done.stderr
    assert "Traceback" not in done.stderr
