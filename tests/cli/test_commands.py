"""Every command, used as the README says, and what its output holds."""

import csv
import json
import os
import subprocess
import sys
import tomllib

import numpy as np
import pytest

import lightflight as lf
from lightflight.lab import lab_from_toml
from tools.make_golden_files import FOLDER


def test_simulate_writes_a_recording_that_read_takes(lab_folder):
    hist = lf.histogram(lf.read(lab_folder / "recording.h5"))
    assert hist.shape == (32, 32)
    assert hist.reversed_codes
    assert hist.photons.max() > 1000


def test_simulate_gives_the_same_photons_for_the_same_seed(run, tmp_path):
    for name, seed in (("a.h5", 5), ("b.h5", 5), ("c.h5", 6)):
        done = run("simulate", "--photons", 500, "--seed", seed, "-o", tmp_path / name)
        assert done.exit_code == 0, done.stderr
    a, b, c = (lf.read(tmp_path / name).counts for name in ("a.h5", "b.h5", "c.h5"))
    np.testing.assert_array_equal(a, b)
    assert (a != c).any()


def test_simulate_follows_the_set_up(run, tmp_path):
    lab = tmp_path / "lab.toml"
    lab.write_text(
        """
        [camera]
        shape = [8, 12]
        distance_mm = 500.0
        field_of_view_mm = [240.0, 160.0]
        [scene]
        vertices_mm = [[-150.0, 0.0, 0.0], [150.0, 0.0, 0.0]]
        photons_per_pixel = 300.0
        [detector]
        preset = "ideal"
        bin_width_ps = 100.0
        n_codes = 500
        """
    )
    done = run("simulate", "--lab", lab, "-o", tmp_path / "r.h5", "--json")
    assert done.exit_code == 0, done.stderr
    facts = json.loads(done.stdout)
    assert facts["shape"] == [8, 12]
    assert facts["bin_width_ps"] == 100.0
    brightest = lf.read(tmp_path / "r.h5").photons.max()
    # 300 expected in the brightest pixel; the greatest of a row of some 12 such
    assert 240 < brightest < 380


def test_dry_run_prints_a_set_up_that_reads_back(run, lab_folder, tmp_path):
    done = run(
        "reconstruct", "nowhere.h5", "--lab", lab_folder / "lab.toml", "--dry-run",
        "--set", "medium.path_group_index=1.47", "--n-legs", 3,
    )  # fmt: skip
    assert done.exit_code == 0, done.stderr
    table = tomllib.loads(done.stdout)
    assert table["medium"]["path_group_index"] == 1.47
    assert table["reconstruct"] == {"n_legs": 3}
    printed = tmp_path / "printed.toml"
    printed.write_text(done.stdout)
    again, first = lab_from_toml(printed), lab_from_toml(lab_folder / "lab.toml")
    np.testing.assert_array_equal(again.camera.world_from_camera, first.camera.world_from_camera)


@pytest.mark.parametrize(
    ("name", "holds"),
    [
        ("recording.h5", "recording (histograms)"),
        ("bright.h5", "recording (histograms)"),
        ("calibration.h5", "calibration of a clock"),
    ],
)
def test_info_says_what_a_file_holds(run, lab_folder, name, holds):
    done = run("info", lab_folder / name)
    assert done.exit_code == 0, done.stderr
    assert name in done.stdout
    assert holds in done.stdout
    assert done.stderr == ""


def test_info_for_programs_is_strict_json_with_units(run, lab_folder):
    done = run("info", lab_folder / "recording.h5", "--json")
    facts = json.loads(done.stdout, parse_constant=lambda word: pytest.fail(word))
    assert facts["kind"] == "histograms"
    assert facts["laser_period_ps"] == 50_000.0
    assert facts["reversed_codes"] is True
    assert facts["photons"] == int(lf.read(lab_folder / "recording.h5").photons.sum())


def test_calibrate_reports_the_clock_it_found(run, lab_folder, tmp_path):
    done = run(
        "calibrate", "--code-density", lab_folder / "bright.h5", "--flat", lab_folder / "flat.h5",
        "--json", "-o", tmp_path / "c.h5", "-o", tmp_path / "c.png",
    )  # fmt: skip
    assert done.exit_code == 0, done.stderr
    facts = json.loads(done.stdout)
    # 0.7 % lies between dead codes absorbed and lost, and nobody said which
    assert facts["bin_width_ps"] == pytest.approx(55.0, rel=0.005)
    assert facts["scale_std"] > 0.001
    assert len(facts["phases"]) == 8
    assert (tmp_path / "c.png").read_bytes().startswith(b"\x89PNG")
    assert (
        lf.TimingCalibration.load(tmp_path / "c.h5").provenance["inputs"][0]["name"] == "bright.h5"
    )


def test_reconstruct_writes_path_table_and_figure(run, lab_folder, tmp_path):
    outputs = [tmp_path / name for name in ("path.h5", "path.csv", "path.png")]
    done = run(
        "reconstruct", lab_folder / "recording.h5", "--lab", lab_folder / "lab.toml",
        "--timing", lab_folder / "calibration.h5", *(w for o in outputs for w in ("-o", o)),
    )  # fmt: skip
    assert done.exit_code == 0, done.stderr
    assert "corner" in done.stdout
    path = lf.LightPath.load(outputs[0])
    assert path.n_legs == 3
    assert {i["name"] for i in path.provenance["inputs"]} >= {"recording.h5", "calibration.h5"}
    assert path.provenance["settings"]["source"]["position_mm"] == [0.0, 0.0, 0.0]
    rows = list(csv.DictReader(outputs[1].read_text().splitlines()))
    assert len(rows) == 1000
    assert float(rows[0]["x_mm"]) == pytest.approx(path.vertices_mm[0, 0], abs=1e-6)
    assert outputs[2].read_bytes().startswith(b"\x89PNG")


def test_reconstruct_for_programs(run, lab_folder):
    done = run(
        "reconstruct", lab_folder / "recording.h5", "--lab", lab_folder / "lab.toml",
        "--timing", lab_folder / "calibration.h5", "--response-fwhm-ps", "150", "--json",
    )  # fmt: skip
    assert done.exit_code == 0, done.stderr
    facts = json.loads(done.stdout)
    # the simulated laser's pulse is 68 ps long
    assert facts["laser_fwhm_ps"] == pytest.approx(68.0, abs=4 * facts["laser_fwhm_std_ps"] + 1)
    assert len(facts["apparent_fwhm_ps"]) == 3
    assert np.shape(facts["vertices_mm"]) == (4, 3)
    assert len(facts["legs"]) == 3
    assert facts["converged"] is True
    # 20,000 photons, source known: some 0.2 mm; a millimetre is a failure, not bad luck
    assert facts["position_rms_mm"] < 1.0


def test_reconstruct_takes_repeats(run, lab_folder, tmp_path):
    again = tmp_path / "again.h5"
    assert run("simulate", "--photons", 20_000, "--seed", 1, "-o", again).exit_code == 0
    done = run(
        "reconstruct", lab_folder / "recording.h5", again, "--lab", lab_folder / "lab.toml",
        "--timing", lab_folder / "calibration.h5", "--json",
    )  # fmt: skip
    assert done.exit_code == 0, done.stderr


def test_info_of_a_path(run, lab_folder, tmp_path):
    done = run(
        "reconstruct", lab_folder / "recording.h5", "--lab", lab_folder / "lab.toml",
        "--timing", lab_folder / "calibration.h5", "-o", tmp_path / "path.h5",
    )  # fmt: skip
    assert done.exit_code == 0, done.stderr
    done = run("info", tmp_path / "path.h5")
    assert "path of a pulse" in done.stdout
    assert "joint" in done.stdout


def test_without_a_calibration_one_line_of_warning_says_what_it_costs(run, tmp_path):
    lf.write(lf.read(FOLDER / "histograms.h5"), tmp_path / "small.h5")
    done = run("reconstruct", tmp_path / "small.h5", "--lab", FOLDER / "lab.toml", "--json")
    lines = done.stderr.splitlines()
    assert any(line.startswith("warning: no timing calibration") for line in lines)
    said = [line for line in lines if not line.endswith(" ...")]  # progress of slow machines
    assert all(line.startswith(("warning: ", "lightflight: ")) for line in said)


def test_without_a_camera_the_legs_stay_in_the_picture(run, lab_folder):
    done = run(
        "reconstruct", lab_folder / "recording.h5", "--timing", lab_folder / "calibration.h5"
    )
    assert done.exit_code == 0, done.stderr
    assert "Legs in the picture" in done.stdout
    assert "[camera] distance_mm and field_of_view_mm" in done.stdout
    done = run(
        "reconstruct", lab_folder / "recording.h5", "--timing", lab_folder / "calibration.h5",
        "--json",
    )  # fmt: skip
    facts = json.loads(done.stdout)
    assert len(facts["legs"]) == 3
    assert len(facts["needs"]) == 1


def test_without_a_camera_no_path_is_written(run, lab_folder, tmp_path):
    done = run(
        "reconstruct", lab_folder / "recording.h5", "--timing", lab_folder / "calibration.h5",
        "-o", tmp_path / "path.h5",
    )  # fmt: skip
    assert done.exit_code == 2
    assert "path.h5 not written" in done.stderr
    assert not (tmp_path / "path.h5").exists()


def test_demo_compares_with_the_paper(run, tmp_path):
    done = run("demo", "-o", tmp_path / "demo", "--photons", 20_000, "--json")
    assert done.exit_code == 0, done.stderr
    rows = json.loads(done.stdout)["rows"]
    assert (rows[0]["position_rms_mm"], rows[0]["event_time_rms_ps"]) == (1.75, 3.84)
    assert [r["method"] for r in rows[1:]] == ["paper", "joint", "paper", "joint", "joint"]
    assert all(r["prior"] and r["photons_per_pixel"] == 20_000 for r in rows[1:])
    assert "emission time fitted" in rows[4]["prior"]
    # 20,000 photons, defects on and calibrated: 0.1 to 0.2 mm; the goal for twice as many is 0.4
    assert rows[2]["position_rms_mm"] < 0.6
    assert rows[4]["position_rms_mm"] < 0.6
    for name in ("recording.h5", "calibration.h5", "path.h5", "path.csv", "demo.png"):
        assert (tmp_path / "demo" / name).stat().st_size > 1000
    assert "calibrating the clock" in done.stderr


@pytest.mark.parametrize(
    "words", [(), ("fig5a", "--quick"), ("table", "--json", "--seed", 3, "-o", "somewhere")]
)
def test_paper_says_where_its_experiments_went(run, words):
    done = run("paper", *words)
    assert done.exit_code == 2
    assert done.stdout == ""
    (line,) = done.stderr.splitlines()
    assert "`make paper` in a checkout" in line


def test_versions_names_what_a_bug_report_needs(run):
    done = run("versions")
    for word in ("lightflight", "python", "numpy", "numba"):
        assert word in done.stdout
    assert json.loads(run("versions", "--json").stdout)["lightflight"] == lf.__version__
    assert lf.__version__ in run("--version").stdout


MIRRORS = """
[camera]
distance_mm = 535.0
field_of_view_mm = [245.0, 245.0]
center_mm = [187.5, 37.5]
[source]
position_mm = [0.0, 0.0, 0.0]
[scene]
source_direction = [375.0, 25.0, 50.0]
mirrors = [
    [0.0, 50.0, 10.0, 1.0, 0.0, 0.0, 25.4],
    [375.0, 25.0, 50.0, 1.0, 0.0, 0.0, 25.4],
]
exit_length_mm = 380.0
dust_contrast = 0.2
"""


def test_simulate_follows_mirrors_and_says_the_path_it_made_of_them(run, tmp_path):
    lab = tmp_path / "lab.toml"
    lab.write_text(MIRRORS.replace("[0.0, 50.0, 10.0,", "[0.0, 50.0, 100.0,"))
    done = run("simulate", "--lab", lab, "-o", tmp_path / "r.h5", "--dry-run")
    assert done.exit_code == 0, done.stderr
    table = tomllib.loads(done.stdout)
    assert "mirrors" not in table["scene"]
    # both mirrors stand across x: y and z go on as they were
    np.testing.assert_allclose(table["scene"]["vertices_mm"][1:3], [[375, 25, 50], [0, 50, 100]])
    done = run("simulate", "--lab", lab, "--photons", 500, "-o", tmp_path / "r.h5", "--json")
    assert done.exit_code == 0, done.stderr
    np.testing.assert_allclose(
        lf.read(tmp_path / "r.h5").truth.vertices_mm[:3], [[0, 0, 0], [375, 25, 50], [0, 50, 100]]
    )


def test_a_pulse_that_meets_no_mirror_is_said_so(run, tmp_path):
    lab = tmp_path / "lab.toml"
    lab.write_text(MIRRORS.replace("[375.0, 25.0, 50.0]\nmirrors", "[0.0, -1.0, 0.0]\nmirrors"))
    done = run("simulate", "--lab", lab, "-o", tmp_path / "r.h5")
    assert done.exit_code != 0
    assert "meets none of the mirrors" in done.stderr


def test_commands_keep_the_algebra_to_one_thread_unless_told_otherwise():
    script = "import sys, os; from lightflight.cli import main\n"
    script += "try: main(['--version'])\n"
    script += "except SystemExit: print(os.environ['OPENBLAS_NUM_THREADS'])"
    for given, expected in (({}, "1"), ({"OPENBLAS_NUM_THREADS": "3"}, "3")):
        known = {k: v for k, v in os.environ.items() if k != "OPENBLAS_NUM_THREADS"}
        done = subprocess.run(
            [sys.executable, "-c", script], env=known | given, capture_output=True, text=True,
            check=True,
        )  # fmt: skip
        assert done.stdout.split()[-1] == expected


def test_glass_told_in_the_set_up_is_simulated_and_found(run, tmp_path):
    """And the path, as a file and as a table, runs through it at the speed that light has there."""
    lab = tmp_path / "lab.toml"
    lab.write_text(
        """
        [camera]
        shape = [32, 32]
        distance_mm = 535.0
        field_of_view_mm = [245.0, 245.0]
        center_mm = [187.5, 37.5]
        [source]
        position_mm = [0.0, 0.0, 0.0]
        [block]
        center_mm = [187.5, 20.0, 15.0]
        normal = [1.0, 0.3, 0.2]
        thickness_mm = 20.0
        diameter_mm = 30.0
        glass_indices = [1.5, 1.55]
        [detector]
        preset = "ideal"
        [scene]
        vertices_mm = [[0.0, 0.0, 0.0], [375.0, 40.0, 30.0]]
        photons_per_pixel = 40000.0
        """
    )
    recording, path, table = (tmp_path / name for name in ("r.h5", "p.h5", "p.csv"))
    for args in (
        ("simulate", "--lab", lab, "-o", recording),
        ("reconstruct", recording, "--lab", lab, "-o", path, "-o", table),
    ):
        done = run(*args)
        assert done.exit_code == 0, done.stderr
    assert done.stdout.count("face of glass") == 2
    found = lf.LightPath.load(path)
    assert found.legs_in_glass == (1,)
    with table.open(newline="") as file:
        rows = [row for row in csv.DictReader(file) if row["leg"] == "1"]
    times = np.array([float(row["event_time_ps"]) for row in rows])
    places = np.array([[float(row[f"{axis}_mm"]) for axis in "xyz"] for row in rows])
    speed = np.linalg.norm(places[-1] - places[0]) / (times[-1] - times[0])
    assert speed == pytest.approx(0.299792458 / 1.55, rel=1e-3)
