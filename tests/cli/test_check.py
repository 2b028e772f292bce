"""`lightflight check`: findings, prices, the figure and exit codes."""

import json

import pytest
from click.testing import CliRunner

from lightflight.cli import main
from lightflight.formats.registry import write
from tests.labs import three_legs

LAB = """
[camera]
distance_mm = 535.0
field_of_view_mm = [245.0, 245.0]
center_mm = [187.5, 37.5]

[source]
position_mm = [0.0, 0.0, 0.0]
emission_time_ps = 2000.0
pulse_fwhm_ps = 68.0
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("check")
    write(three_legs().recording(4), folder / "recording.h5")
    three_legs().timing.save(folder / "clock.h5")
    (folder / "lab.toml").write_text(LAB)
    return folder


def check(folder, *words):
    files = [str(folder / name) for name in ("lab.toml", "recording.h5")]
    return CliRunner().invoke(main, ["check", *files, "--timing", str(folder / "clock.h5"), *words])


def test_a_sound_set_up_has_prices_and_no_findings(folder):
    done = check(folder, "--json", "--strict", "-o", str(folder / "setup.png"))
    assert done.exit_code == 0
    said = json.loads(done.stdout)
    assert said["findings"] == []
    assert said["field_of_view_mm"] == pytest.approx([245.0, 245.0])
    assert said["source_px"][0] == pytest.approx(15.5 - 187.5 / 245 * 32)
    things = " ".join(said["prices"])
    for thing in ("camera's place", "camera's rotation", "focal length", "group index", "source"):
        assert thing in things
    assert (folder / "setup.png").read_bytes()[:4] == b"\x89PNG"


def test_an_emission_time_in_ns_is_named_and_strict_ends_with_6(folder):
    done = check(folder, "--set", "source.emission_time_ps=2.0", "--strict", "--json")
    assert done.exit_code == 6
    names = [one["name"] for one in json.loads(done.stdout)["findings"]]
    assert names == ["units", "source"]
    assert check(folder, "--set", "source.emission_time_ps=2.0").exit_code == 0


def test_people_read_it_too(folder):
    said = check(folder).stdout
    assert "none: the set-up can be that of the recording" in said
    assert "one pixel" in said


def test_a_set_up_without_a_camera_is_refused(folder):
    (folder / "none.toml").write_text("[source]\nposition_mm = [0.0, 0.0, 0.0]\n")
    words = ["check", str(folder / "none.toml"), str(folder / "recording.h5")]
    assert CliRunner().invoke(main, words).exit_code == 2
