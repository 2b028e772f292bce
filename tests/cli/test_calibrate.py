"""`lightflight calibrate` with all it takes, `calibrate camera`, and drift in `info`."""

import json
import tomllib
from dataclasses import replace

import numpy as np
import pytest

import lightflight as lf
from lightflight.lab.lab import lab_from_toml
from lightflight.simulate import paper_scene, pf32

FLAT_PS = 5600.0


@pytest.fixture(scope="module")
def scene():
    """A PF32 of 12 x 12 pixels in the paper's set-up."""
    scene = paper_scene()
    camera = lf.Camera.facing_plane(
        shape=(12, 12), distance_mm=535.0, field_of_view_mm=(245.0, 245.0),
        center_mm=(187.5, 37.5),
    )  # fmt: skip
    return replace(scene, camera=camera, detector=pf32(seed=3))


@pytest.fixture(scope="module")
def lights(scene, tmp_path_factory):
    """Folder with bright.h5, near.h5, far.h5 (10 ns later), moved.h5 (5 ps later), frames.h5."""
    folder = tmp_path_factory.mktemp("lights")
    density = lf.simulate(scene, kind="code_density", photons_per_pixel=4e5, seed=1)
    lf.write(density, folder / "bright.h5")
    for seed, (name, late) in enumerate((("near", 0.0), ("far", 10_000.0), ("moved", 5.0)), 2):
        flat = lf.simulate(
            scene, kind="flat", photons_per_pixel=4e4, seed=seed, flat_arrival_ps=FLAT_PS + late
        )
        lf.write(flat, folder / f"{name}.h5")
    frames = lf.simulate(scene, kind="frames", photons_per_pixel=300, seed=5)
    lf.write(frames, folder / "frames.h5")
    return folder


def test_two_flats_are_a_delay_scan(run, lights, tmp_path):
    done = run(
        "calibrate", "--code-density", lights / "bright.h5", "--flat", lights / "near.h5",
        "--flat", lights / "far.h5", "--flat-arrival-ps", 0, "--flat-arrival-ps", 10_000,
        "-o", tmp_path / "c.h5", "--plot", tmp_path / "c.png", "--json",
    )  # fmt: skip
    assert done.exit_code == 0, done.stderr
    facts = json.loads(done.stdout)
    assert facts["scale_std"] < 1e-4  # 0.0036 from the code density alone
    assert "the delay scan says so" in facts["notes"]
    assert (tmp_path / "c.png").read_bytes().startswith(b"\x89PNG")
    settings = lf.TimingCalibration.load(tmp_path / "c.h5").provenance["settings"]
    assert settings["timing"]["flat_arrival_ps"] == [0.0, 10_000.0]


def test_a_map_of_arrivals_is_taken_off_the_delays(run, lights, tmp_path):
    arrival = np.linspace(0.0, 300.0, 144).reshape(12, 12)
    np.save(tmp_path / "map.npy", arrival)
    delays = []
    for text in (0, tmp_path / "map.npy"):
        done = run(
            "calibrate", "--flat", lights / "near.h5", "--flat-arrival-ps", text,
            "-o", tmp_path / "c.h5",
        )  # fmt: skip
        assert done.exit_code == 0, done.stderr
        assert "no code-density recording" in done.stdout  # what is missing, and its cost
        delays.append(lf.TimingCalibration.load(tmp_path / "c.h5"))
    seen = np.isfinite(delays[0].anchor_delay_ps)
    difference_ps = (delays[0].skew_ps - delays[1].skew_ps)[seen]
    np.testing.assert_allclose(difference_ps, arrival[seen], atol=1e-9)


def test_a_lit_screen_gives_the_arrivals_itself(run, lights, scene, tmp_path):
    (tmp_path / "lab.toml").write_text(
        "[camera]\nshape = [12, 12]\ndistance_mm = 535.0\nfield_of_view_mm = [245.0, 245.0]\n"
        "center_mm = [187.5, 37.5]\n"
    )
    words = ["calibrate", "--flat", lights / "near.h5", "-o", tmp_path / "c.h5"]
    screen = ["--screen", 187.5, 37.5, 500.0, 0, 0, 0, 0, 0, 1]
    refused = run(*words, *screen)
    assert refused.exit_code == 2
    assert "--lab" in refused.stderr
    done = run(*words, *screen, "--lab", tmp_path / "lab.toml", "--flat-tilt-std-ps", 1)
    assert done.exit_code == 0, done.stderr
    from lightflight.timing.flat_geometry import flat_arrival_from_screen_ps

    timing = lf.TimingCalibration.load(tmp_path / "c.h5")
    late = flat_arrival_from_screen_ps(
        scene.camera, source_mm=screen[1:4], screen_point_mm=screen[4:7], screen_normal=screen[7:]
    )
    plain = run(*words, "--flat-arrival-ps", 0)
    assert plain.exit_code == 0, plain.stderr
    moved = lf.TimingCalibration.load(tmp_path / "c.h5").skew_ps - timing.skew_ps
    seen = np.isfinite(timing.anchor_delay_ps)
    # up to the fitted tilt, a picosecond, and the delay itself, which is several nanoseconds
    assert np.std((moved - late)[seen]) < 1.0
    assert timing.flat_mode_names


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (["--flat", "a.h5", "--flat", "b.h5", "-o", "c.h5"], "as many --flat-arrival-ps"),
        (["--flat", "a.h5", "--flat-pulse", "mean", "--flat-response", "r.npy", "-o", "c.h5"],
         "not both"),
        (["--code-density", "a.h5", "--flat-arrival-ps", "0", "-o", "c.h5"], "need --flat"),
        (["--flat", "a.h5"], "give -o"),
        (["-o", "c.h5"], "give --code-density, --flat"),
        (["camera", "a.csv", "b.csv", "-o", "c.toml"], "one table"),
        (["camera", "a.png", "-o", "c.toml"], "--corners"),
        (["camera", "a.csv", "-o", "c.h5"], ".toml"),
    ],
)  # fmt: skip
def test_wrong_words_are_refused_before_any_work(run, words, told):
    done = run("calibrate", *words)
    assert done.exit_code == 2
    assert told in done.stderr


def test_info_says_how_far_a_clock_has_drifted(run, lights, tmp_path):
    done = run(
        "calibrate", "--code-density", lights / "bright.h5", "--flat", lights / "near.h5",
        "--flat-arrival-ps", FLAT_PS, "-o", tmp_path / "c.h5",
    )  # fmt: skip
    assert done.exit_code == 0, done.stderr
    found = run("info", lights / "moved.h5", "--timing", tmp_path / "c.h5", "--json")
    assert found.exit_code == 0, found.stderr
    assert json.loads(found.stdout)["drift_ps"] == pytest.approx(5.0, abs=0.3)
    assert "the clock drifted" in found.stderr


def test_info_follows_the_pulses_of_a_long_recording(run, lights):
    done = run("info", lights / "frames.h5", "--slices", 3, "--json")
    assert done.exit_code == 0, done.stderr
    facts = json.loads(done.stdout)
    assert max(abs(facts[f"drift_{i}_ps"]) for i in range(3)) < 15.0  # 144 pixels, 100 photons
    assert "No movement beyond its errors." in facts["notes"]
    refused = run("info", lights / "near.h5", "--slices", 3)
    assert refused.exit_code == 2
    assert "cannot be cut in time" in refused.stderr


def points_of(camera, rng, n=60):
    points = np.column_stack([rng.uniform(60, 310, n), rng.uniform(-80, 150, n),
                              rng.uniform(-60, 60, n)])  # fmt: skip
    row, col = camera.pixels_from_points(points)
    return points, np.stack([row, col], axis=1)


@pytest.mark.parametrize("kind", ["csv", "npz"])
def test_a_camera_from_points_serves_a_lab(run, scene, rng, tmp_path, kind):
    points, seen = points_of(scene.camera, rng)
    table = tmp_path / f"points.{kind}"
    if kind == "csv":
        rows = np.column_stack([points, seen])
        np.savetxt(table, rows, delimiter=",", header="x_mm,y_mm,z_mm,row,col", comments="")
    else:
        np.savez(table, points_mm=points, pixels=seen, shape=[12, 12])
    shape = ["--shape", 12, 12] if kind == "csv" else []
    done = run("calibrate", "camera", table, *shape, "-o", tmp_path / "camera.toml", "--json")
    assert done.exit_code == 0, done.stderr
    np.testing.assert_allclose(
        json.loads(done.stdout)["center_mm"], scene.camera.center_mm, atol=1e-2
    )
    (tmp_path / "lab.toml").write_text('[camera]\nfile = "camera.toml"\n')
    camera = lab_from_toml(tmp_path / "lab.toml").camera
    np.testing.assert_allclose(camera.center_mm, scene.camera.center_mm, atol=1e-2)
    assert camera.pose_covariance is not None
    direct = lab_from_toml(tmp_path / "camera.toml").camera
    np.testing.assert_array_equal(direct.matrix, camera.matrix)
    again = run("calibrate", "camera", table, *shape, "-o", tmp_path / "camera.toml")
    assert again.exit_code == 0  # an earlier result may be replaced
    assert "0.28 deg" in again.stdout
    foreign = run("calibrate", "camera", table, *shape, "-o", tmp_path / "lab.toml")
    assert foreign.exit_code == 2


def test_a_camera_from_the_real_map_of_a_pf32(run, data_dir, tmp_path):
    done = run(
        "calibrate", "camera", data_dir / "pf32-pixel-pointing" / "C0017_pixels_cali_result.mat",
        "--variable", "coords", "--mm-per-unit", 1000, "-o", tmp_path / "camera.toml",
    )  # fmt: skip
    assert done.exit_code == 0, done.stderr
    table = tomllib.loads((tmp_path / "camera.toml").read_text())["camera"]
    assert table["shape"] == [32, 32]
    assert table["matrix"][0][0] == pytest.approx(400.0, rel=1e-3)  # 20 mm lens, 50 um pixels


def test_a_camera_from_pictures_of_a_board(run, tmp_path):
    cv2 = pytest.importorskip("cv2")
    from lightflight.camera.rigid import rotation_from_vector
    from tests.camera.test_calibration import board_picture

    matrix = np.array([[300.0, 0, 162.0], [0, 300.0, 117.0], [0, 0, 1.0]])
    files = []
    for i, tilt in enumerate(((0.5, 0.1, 0), (-0.4, 0.3, 0.1), (0.1, -0.5, 0.05))):
        pose = np.eye(4)
        pose[:3, :3] = rotation_from_vector(tilt) @ np.diag([1.0, -1.0, -1.0])
        pose[:3, 3] = np.array([60.0, -40.0, 0]) - 260.0 * pose[:3, 2]
        files.append(tmp_path / f"board{i}.png")
        cv2.imwrite(str(files[-1]), board_picture(lf.Camera(matrix, (), pose, (240, 320))))
    done = run(
        "calibrate", "camera", *files, "--corners", 7, 5, "--square-mm", 20,
        "-o", tmp_path / "camera.toml", "--json",
    )  # fmt: skip
    assert done.exit_code == 0, done.stderr
    assert json.loads(done.stdout)["focal_length_px"] == pytest.approx(300.0, rel=0.02)


@pytest.mark.parametrize(
    ("name", "content", "told"),
    [
        ("none.csv", None, "no such file"),
        ("empty.csv", b"", "is empty"),
        ("short.csv", b"x_mm,y_mm,row\n1,2,3\n", "lacks the columns col"),
        ("words.csv", b"x_mm,y_mm,row,col\na,2,3,4\n", "could not convert"),
        ("junk.npz", b"no zip", "cannot be read"),
        ("points.doc", b"x", "is no .csv"),
    ],
)
def test_foreign_tables_are_refused(run, tmp_path, name, content, told):
    if content is not None:
        (tmp_path / name).write_bytes(content)
    done = run(
        "calibrate", "camera", tmp_path / name, "--shape", 8, 8, "-o", tmp_path / "camera.toml"
    )
    assert done.exit_code == 3
    assert told in done.stderr
