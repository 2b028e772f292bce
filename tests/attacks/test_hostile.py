"""Paths and calibrations with a sound digest that say what no program of ours writes."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner

import lightflight as lf
from lightflight import elsewhere
from lightflight.cli import main
from lightflight.errors import FileFormatError
from lightflight.files.store import load_record, save_record
from lightflight.formats import isolation, ptu
from lightflight.path.tables import RESIDUAL_DTYPE
from lightflight.path.trace import across_axes, trace_from_path
from lightflight.view.export.files import export_path
from lightflight.view.figures.camera import draw_pixel_histogram
from lightflight.view.figures.path import draw_path_3d
from lightflight.view.film import flight
from lightflight.view.solids import error_tube
from tests.attacks import fields
from tests.formats.made_by_hand import ptu_image_bytes
from tests.path_fakes import make_path, random_covariance

DEEP: Any = []
for _ in range(400):
    DEEP = [DEEP]


@pytest.fixture(scope="module")
def sound(tmp_path_factory) -> Path:
    file: Path = tmp_path_factory.mktemp("sound") / "path.h5"
    make_path().save(file)
    return file


@pytest.mark.parametrize(
    ("where", "value"),
    [
        ("method", "x" * 3_000_000),
        ("prior", 1e308),
        ("prior", {"a": 1}),
        ("goodness.chi2", None),
        ("goodness.chi2", DEEP),
        ("goodness.dof", "<script>"),
        ("goodness.dof", 10**400),
        ("goodness.n_pulses", "x" * 3_000_000),
        ("goodness.converged", 1),
        ("statements", "x" * 3_000_000),
        ("statements", [[]]),
        ("statements", ["x"] * 100_000),
        ("prices", [DEEP]),
        ("provenance", "x"),
    ],
)
def test_a_path_that_no_fit_makes_is_refused(sound, tmp_path, where, value):
    """They ended in internal errors, and a title of three million letters in minutes."""
    arrays, attributes = load_record(sound, kind="path")
    plain = json.loads(json.dumps(attributes))
    *above, last = where.split(".")
    place = plain
    for name in above:
        place = place[name]
    place[last] = value
    save_record(tmp_path / "x.h5", kind="path", arrays=arrays, attributes=plain)
    with pytest.raises(FileFormatError, match=f"{last} cannot be|it holds") as caught:
        lf.LightPath.load(tmp_path / "x.h5")
    assert len(str(caught.value)) < 500 + len(str(tmp_path))


@pytest.mark.parametrize("value", ["x" * 3_000_000, [DEEP], [1], {"a": 1}])
@pytest.mark.parametrize("name", ["notes", "flat_mode_names", "shape"])
def test_a_calibration_of_other_texts_is_refused(tmp_path, name, value):
    """`info` ended in an internal error, and an error in a sentence of three million letters."""
    hist = lf.Histograms(np.ones((2, 2, 32), np.uint16), bin_width_ps=55.0, laser_period_ps=1500.0)
    timing = lf.TimingCalibration.nominal(hist)
    timing.save(tmp_path / "y.h5")
    arrays, attributes = load_record(tmp_path / "y.h5", kind="calibration")
    value = [None] if name == "shape" and value == [1] else value
    changed = {**attributes, name: value}
    save_record(tmp_path / "x.h5", kind="calibration", arrays=arrays, attributes=changed)
    with pytest.raises(FileFormatError, match=f"{name} cannot be") as caught:
        lf.TimingCalibration.load(tmp_path / "x.h5")
    assert len(str(caught.value)) < 500 + len(str(tmp_path))


def zigzag(n_vertices: int) -> np.ndarray:
    up = np.linspace(0.0, 75.0, n_vertices)
    return np.column_stack([375.0 * (np.arange(n_vertices) % 2), up, 0 * up])


def of_truth(vertices: np.ndarray, **times: np.ndarray) -> dict[str, np.ndarray]:
    told = times.get("times", np.arange(len(vertices), dtype=float))
    return {"truth_vertices_mm": vertices, "truth_vertex_times_ps": told}


def of_pulses(n: int, **columns: float) -> dict[str, np.ndarray]:
    return {f"residuals_{name}": np.full(n, columns.get(name, 1), RESIDUAL_DTYPE[name])
            for name in RESIDUAL_DTYPE.names or ()}  # fmt: skip


@pytest.mark.parametrize(
    ("arrays", "why"),
    [
        ({"vertices_mm": zigzag(102), "vertex_times_ps": np.arange(102) * 1e3,
          "covariance": np.zeros((408, 408))}, "at most 100 legs, got 101"),
        ({"vertex_times_ps": np.linspace(0, 1e300, 4)}, "within 1e"),
        ({"vertex_times_ps": np.array([-1.7e308, 0.0, 1.0, 1.7e308])}, "within 1e"),
        ({"vertices_mm": np.zeros((4, 3))}, "must differ"),
        (of_truth(zigzag(4) * 1e300), "its truth reaches beyond"),
        (of_truth(zigzag(4), times=np.array([0, 1, np.nan, 3])), "its truth"),
        (of_truth(zigzag(4), times=np.array([3.0, 2.0, 1.0, 0.0])), "its truth"),
        (of_truth(zigzag(4), times=np.arange(3.0)), "its truth"),
        (of_truth(zigzag(1)), "its truth"),
        (of_truth(zigzag(10_001)), "its truth has 10001 vertices"),
        ({"camera_shape": np.array([2**31, 2**31])}, "its camera cannot have .* pixels"),
        ({"camera_shape": np.array([1e300, 1e300])}, "its camera cannot have .* pixels"),
        (of_pulses(2_000_001), "it holds 2000001 pulses"),
        (of_pulses(9, std_ps=np.inf), "residuals_std_ps must be below"),
        (of_pulses(9, residual_ps=-1e300), "residuals_residual_ps must be below"),
    ],
)  # fmt: skip
def test_a_path_that_could_not_be_drawn_is_refused(sound, tmp_path, arrays, why):
    """500 legs drew for minutes, 10^7 pulses took 4 GB; the others ended in internal errors."""
    known, attributes = load_record(sound, kind="path")
    save_record(tmp_path / "x.h5", kind="path", arrays={**known, **arrays}, attributes=attributes)
    with pytest.raises(FileFormatError, match=why) as caught:
        lf.LightPath.load(tmp_path / "x.h5")
    # A limit of ours is not told as damage of the file.
    is_limit = any(
        word in why
        for word in ("at most", "within", "beyond", "pulses", "below", "pixels", "10001")
    )
    assert ("beyond a limit" in str(caught.value)) == is_limit
    assert ("damaged; copy" in str(caught.value)) != is_limit


def test_a_film_without_end_is_refused(sound, tmp_path):
    """Times in a file asked for 10^11 frames, and for the memory to count them."""
    arrays, attributes = load_record(sound, kind="path")
    arrays = {**arrays, "vertex_times_ps": np.linspace(0, 1e12, 4)}
    save_record(tmp_path / "x.h5", kind="path", arrays=arrays, attributes=attributes)
    rng = np.random.default_rng(16)
    counts = rng.poisson(1.0, (1, 2, 20_000)).astype(np.uint16)
    lf.write(lf.Histograms(counts, bin_width_ps=1.0), tmp_path / "y.h5")
    for name, options in (("x", []), ("y", ["--slice-codes", "1"])):
        words = ["movie", str(tmp_path / f"{name}.h5"), "-o", str(tmp_path / "x.gif"), *options]
        done = CliRunner().invoke(main, words)
        assert done.exit_code == 2, done.output
        assert "frames, more than 10000: give" in done.output
    assert sorted(one.name for one in tmp_path.iterdir()) == ["x.h5", "y.h5"]


def test_an_orbit_is_drawn_by_steps_of_a_pixel(monkeypatch):
    """Each frame drew the whole scene anew: three hours for a hundred legs and 10,000 frames."""
    drawn = []
    real = draw_path_3d

    def noted(*args: Any, **options: Any) -> Any:
        drawn.append(options["view"].azimuth_deg)
        return real(*args, **options)

    monkeypatch.setattr("lightflight.view.film.flight.draw_path_3d", noted)
    settings = flight.MovieSettings(size_px=(320, 180), orbit_deg=3.0, pace_ps_per_s=3000.0)
    frames = list(flight.movie_frames(make_path(), settings=settings))
    assert len(frames) > 30
    # 0.6 degrees are a pixel there; one drawing more is of the scene before it turns.
    assert 5 <= len(set(drawn)) <= 7
    assert len(drawn) <= 8
    assert (frames[0] != frames[-1]).any()


def test_a_window_that_is_not_there_is_not_asked_for(tmp_path):
    """MPLBACKEND=nonsense was an internal error: Matplotlib does not start with it."""
    hist = lf.Histograms(np.ones((2, 2, 16), np.uint16), bin_width_ps=55.0)
    lf.TimingCalibration.nominal(hist).save(tmp_path / "x.h5")
    done = subprocess.run(
        [sys.executable, "-P", "-m", "lightflight", "plot", "x.h5", "-o", "x.png"], cwd=tmp_path,
        env={**os.environ, "MPLBACKEND": "nonsense"}, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr


@pytest.mark.parametrize("told", ["0", "-1"])
def test_no_number_of_threads_is_told(monkeypatch, told):
    """It was an internal error of every command that fits."""
    monkeypatch.setenv("NUMBA_NUM_THREADS", told)
    monkeypatch.delitem(sys.modules, "numba", raising=False)
    with pytest.raises(ValueError, match=f"NUMBA_NUM_THREADS is {told} in the environment"):
        elsewhere.check_number_of_threads()


def test_a_pixel_of_many_codes_is_drawn_at_once():
    """A bar each: `plot --what pixel` took minutes for a pixel of 100,000 codes."""
    hist = lf.Histograms(np.ones((1, 1, 100_000), np.uint16))
    ax: Any = draw_pixel_histogram(hist, 0, 0)
    assert [len(bars.get_data().values) for bars in ax.patches] == [199_999]


def test_a_leg_is_drawn_without_the_others(monkeypatch):
    """Each leg's tube was made of all legs' errors: minutes for a hundred."""
    path = make_path(zigzag(12), random_covariance(np.random.default_rng(3), 12, scale=0.1))
    trace = trace_from_path(path)
    seen = []

    def noted(part: Any) -> Any:
        seen.append(len(part.leg))
        return across_axes(part)

    monkeypatch.setattr("lightflight.view.solids.across_axes", noted)
    tube = error_tube(trace, 5.0)
    assert tube is not None
    assert seen == [65] * 11


def test_errors_of_any_size_are_exported(tmp_path):
    """They ended in numbers that JSON does not know."""
    path = make_path(covariance=np.eye(16) * 1e300)
    export_path(path, tmp_path / "x.glb")
    assert (tmp_path / "x.glb").read_bytes()[:4] == b"glTF"


@pytest.mark.skipif(os.name == "nt", reason="Windows keeps a folder that somebody is in")
def test_a_current_folder_that_is_gone_is_told(sound, tmp_path):
    (tmp_path / "gone").mkdir()
    code = "import os, runpy, sys; os.rmdir(os.getcwd()); sys.argv[:] = sys.argv[1:]; "
    code += "runpy.run_module('lightflight', run_name='__main__', alter_sys=True)"
    path = os.pathsep.join(filter(None, sys.path))
    for words, exit_code, text in (
        (["info", str(sound)], 0, "joint"),
        (["export", str(sound), "-o", "x.csv"], 3, "that this was started in is gone"),
    ):
        done = subprocess.run(
            [sys.executable, "-P", "-c", code, "lightflight", *words], cwd=tmp_path / "gone",
            env={**os.environ, "PYTHONPATH": path}, capture_output=True, text=True, check=False,
        )  # fmt: skip
        (tmp_path / "gone").mkdir(exist_ok=True)
        assert done.returncode == exit_code, done.stderr
        assert text in done.stdout + done.stderr


@pytest.mark.parametrize("mark", [33, 2**31, 2**63 - 1, -2])
@pytest.mark.parametrize("name", ["ImgHdr_LineStart", "ImgHdr_LineStop", "ImgHdr_Frame"])
def test_numbers_of_marks_are_no_powers(tmp_path, name, mark):
    """ptufile raises two to them: a .ptu of a kilobyte was worked at until it was ended."""
    ptufile = pytest.importorskip("ptufile")
    content = ptu_image_bytes(np.zeros((2, 2, 3), int))
    place = fields.Place(name, fields.ptu_tags(content)[name] + 40, 8)
    path = tmp_path / "x.ptu"
    path.write_bytes(fields.with_values(content, (place, mark)))
    with ptufile.PtuFile(path) as opened, pytest.raises(FileFormatError, match="no number of a"):
        ptu._check_claims(opened, path)


def works_without_end(path: Path) -> tuple[dict[str, Any], dict[str, Any]]:
    while True:
        pass


@pytest.mark.skipif(os.name == "nt", reason="POSIX")
def test_a_reader_that_works_without_end_is_ended(tmp_path, monkeypatch):
    """By its processor's time, in a child that knows no clock of this machine's load."""
    told = [str(Path(__file__).parents[2]), os.environ.get("PYTHONPATH", "")]
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join(filter(None, told)))
    (tmp_path / "x").write_bytes(b"x")
    worked = isolation._cpu_limit_s
    assert worked(tmp_path / "x") == 25
    pid = os.fork()
    if pid == 0:
        isolation._CPU_LIMIT_S = 1
        isolation._LIBRARIES_BYTES = 1 << 40
        isolation._limit_time_and_memory(tmp_path / "x")
        works_without_end(tmp_path)
    _, status = os.waitpid(pid, 0)
    assert os.waitstatus_to_exitcode(status) == -signal.SIGXCPU
    ended = subprocess.CompletedProcess([], -signal.SIGXCPU, "", "")
    monkeypatch.setattr(isolation, "run_module", lambda *_, **__: ended)
    with pytest.raises(FileFormatError, match="did not finish in 25 s of a processor"):
        isolation.run_isolated("x:y", tmp_path / "x", {})


def test_no_sentence_is_longer_than_a_page():
    assert len(str(FileFormatError("x" * 3_000_000, path="y.h5"))) < 1000
    assert str(FileFormatError(np.array2string(np.arange(9)))) == "[0 1 2 3 4 5 6 7 8]"
