"""How many files a newcomer touches: the recipes of CONTRIBUTING.md, done in a copy of the package.

Nothing may know the newcomer beforehand, so the copy differs from the package by its files alone.
"""

from __future__ import annotations

import filecmp
import os
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import lightflight

PACKAGE = Path(lightflight.__file__).parent
GOLDEN = Path(__file__).parents[1] / "data" / "golden"

READER = '''\
"""Text of my laboratory: a mark, rows and columns, then one line of counts per pixel."""

import numpy as np

from lightflight.formats.cubes import record_from_array
from lightflight.formats.registry import Format


def read(path, clock, *, gain=1):
    """Read counts; `gain` is what each was multiplied by."""
    with path.open(encoding="ascii") as lines:
        next(lines)
        shape = tuple(int(word) for word in next(lines).split())
        counts = np.loadtxt(lines, dtype=np.uint32, ndmin=2)
    return record_from_array(counts // gain, "pt", clock, path=path, shape=shape)


FORMAT = Format(
    name="mylab-text",
    summary="text of my laboratory",
    suffixes=(".mylab",),
    matches=lambda path, start: start.startswith(b"# mylab"),
    read=read,
)
FORMATS = (FORMAT,)
'''

ASK_READER = """\
import sys
import lightflight as lf
from lightflight.cli import main
from lightflight.errors import ConfigError
from lightflight.formats.registry import own_formats
plain = lf.read("counts.txt", bin_width_ps=50.0)    # by its content
assert (plain.shape, plain.n_codes, plain.bin_width_ps) == ((2, 3), 8, 50.0), plain
assert lf.read("counts.mylab", gain=2).counts.sum() == plain.counts.sum() // 2
try:
    lf.read("counts.txt", gian=2)
except ConfigError as error:
    assert "did you mean 'gain'" in str(error), error
print(*(found.name for found in own_formats()))
main(["info", "counts.txt"])
"""


@pytest.fixture
def counts(tmp_path):
    """A folder with two files of that laboratory."""
    table = 2 * np.random.default_rng(0).integers(0, 9, (6, 8))
    text = "# mylab\n2 3\n" + "\n".join(" ".join(map(str, row)) for row in table)
    for name in ("counts.txt", "counts.mylab"):
        (tmp_path / name).write_text(text, "ascii")
    return tmp_path


def printed_by(script: str, folder: Path, *path: Path) -> list[str]:
    """What a script prints in a folder, with these folders before all others on the path."""
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(map(str, path))}
    done = subprocess.run(
        [sys.executable, "-c", script],
        cwd=folder, env=environment, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    return done.stdout.splitlines()


@pytest.fixture
def home(tmp_path):
    """A folder with a copy of the package, compiled code included."""
    shutil.copytree(PACKAGE, tmp_path / "home" / PACKAGE.name)
    return tmp_path / "home"


def write_into(home: Path, name: str, text: str) -> None:
    """A new file of the copy."""
    (home / PACKAGE.name / name).write_text(text, "utf-8")


def insert_into(home: Path, name: str, *insertions: tuple[str, str]) -> None:
    """Texts put behind lines that a file of the copy holds once."""
    file = home / PACKAGE.name / name
    text = file.read_text("utf-8")
    for line, more in insertions:
        assert text.count(line) == 1, line
        text = text.replace(line, line + more)
    file.write_text(text, "utf-8")


def touched_in(home: Path) -> set[str]:
    """Files of the copy that are new or differ from the package's own."""
    copy = home / PACKAGE.name
    names = {
        file.relative_to(copy)
        for file in copy.rglob("*")
        if file.is_file() and "__pycache__" not in file.parts
    }
    same = [name for name in names if (PACKAGE / name).is_file()]
    _, differing, unread = filecmp.cmpfiles(PACKAGE, copy, same, shallow=False)
    assert not unread
    touched: set[Path] = {*map(Path, differing), *(names - {*same})}
    return {name.as_posix() for name in touched}


def test_a_reader_is_one_file(counts, home):
    """Beside it, its test and what `tools/write_reference.py` writes."""
    write_into(home, "formats/mylab_text.py", READER)
    assert touched_in(home) == {"formats/mylab_text.py"}
    names, *card = printed_by(ASK_READER, counts, home)
    # Those that know their content come before those that do not, whoever they are.
    assert names.split().index("matlab") < names.split().index("mylab-text")
    assert names.split().index("mylab-text") < names.split().index("hdf5")
    assert any("2 x 3" in line or "2 × 3" in line for line in card), card


def test_a_reader_of_another_package_is_one_file(counts):
    """As a plug-in: beside it the line in its own package that names it."""
    home = counts / "home"
    meta = home / "mylab-1.0.dist-info"
    meta.mkdir(parents=True)
    (home / "mylab_text.py").write_text(READER, "utf-8")
    (meta / "METADATA").write_text("Metadata-Version: 2.1\nName: mylab\nVersion: 1.0\n")
    (meta / "entry_points.txt").write_text("[lightflight.formats]\nmylab = mylab_text:FORMAT\n")
    names, *card = printed_by(ASK_READER, counts, home, PACKAGE.parent)
    assert "mylab-text" not in names.split()
    assert any("2 x 3" in line or "2 × 3" in line for line in card), card


ESTIMATOR = '''\
"""`rough`: the start of all other fits, unrefined."""

import numpy as np

from lightflight.path.light_path import LightPath
from lightflight.path.tables import Goodness
from lightflight.reconstruct.fit.start import state_from_legs
from lightflight.reconstruct.legs.direction import legs_of_straight_light


def path_by_rough(request):
    """Legs in the picture, put into space one by one; no errors are stated."""
    setting = request.setting
    legs = legs_of_straight_light(request.sightings[0], setting, request.n_legs)
    about = {"source": setting.source, "medium": setting.medium}
    state = state_from_legs(legs, camera=setting.camera, **about)
    return LightPath(
        state.vertices_mm, state.vertex_times_ps(setting.medium),
        np.zeros(2 * (4 * len(state.vertices_mm),)),
        camera=setting.camera, method="rough", truth=request.sightings[0].histograms.truth,
        goodness=Goodness(np.nan, 0, 0, 0, np.nan, 0.0, True), **about,
    )
'''

ESTIMATOR_LOADED = """
def _rough(request: Request) -> tuple[LightPath, JointFit | None]:
    from lightflight.reconstruct.ways.rough import path_by_rough

    return path_by_rough(request), None

"""
ESTIMATOR_LINE = """\
    Estimator("rough", "the start, unrefined", _rough, needs_counts=True),
"""

ASK_ESTIMATOR = f"""\
from contextlib import suppress
from dataclasses import replace
import lightflight as lf
from lightflight.cli import main
words = ("--lab", r"{GOLDEN / "lab.toml"}", "--timing", r"{GOLDEN / "calibration_full.h5"}")
recording = r"{GOLDEN / "histograms.h5"}"
with suppress(SystemExit):
    main(["reconstruct", recording, *words, "--method", "rough", "-o", "path.h5"])
path = lf.LightPath.load("path.h5")
assert path.method == "rough"
for bad in ({{"method": "ruogh"}}, {{"method": "rough", "camera": [path.camera] * 2}},
            {{"method": "rough", "poisson": False}}):
    hist = replace(lf.read(recording), poisson=bad.pop("poisson", True))
    several = isinstance(bad.get("camera"), list)
    try:
        lf.reconstruct([hist, hist] if several else hist, **{{"camera": path.camera}} | bad)
    except ValueError as error:
        print(error)
print(lf.path_error(path, path.truth, path.camera).position_rms_mm)
"""


def test_an_estimator_is_two_files(tmp_path, home):
    """Beside them, its test and its line in docs/how-to/choose-estimator.md."""
    write_into(home, "reconstruct/ways/rough.py", ESTIMATOR)
    insert_into(
        home,
        "reconstruct/estimators.py",
        ("    return path_by_photon(request)\n\n", ESTIMATOR_LOADED),
        ("\nESTIMATORS = (\n", ESTIMATOR_LINE),
    )
    assert touched_in(home) == {"reconstruct/ways/rough.py", "reconstruct/estimators.py"}
    *_, unknown, several, scaled, error_mm = printed_by(ASK_ESTIMATOR, tmp_path, home)
    assert unknown == "method must be one of rough, paper, joint, photon, got 'ruogh'"
    assert several.startswith("method='rough' takes one camera")
    assert scaled.startswith("method='rough' needs photon counts")
    assert 0.0 < float(error_mm) < 50.0


SHAPE = '''\
"""A pulse that rises at once and falls evenly."""

import numpy as np

from lightflight.timing.clock.response import Response


def wedge_of_flat(flat, clock):
    """As wide as two codes of the clock."""
    time_ps = np.linspace(-2.0, 4.0, 61) * clock.bin_width_ps
    return Response(time_ps, np.where(time_ps < 0.0, 0.0, 4.0 * clock.bin_width_ps - time_ps))
'''

SHAPE_LOADED = """
def _wedge(flat: Histograms, clock: TimingCalibration) -> Response:
    from lightflight.timing.calibrate.wedge import wedge_of_flat

    return wedge_of_flat(flat, clock)

"""
SHAPE_LINE = """\
    FlatShape("wedge", "a wedge", response=_wedge),
"""

ASK_SHAPE = f"""\
from contextlib import suppress
import lightflight as lf
from lightflight.cli import main
words = ("calibrate", "--lab", r"{GOLDEN / "lab.toml"}", "--flat", r"{GOLDEN / "flat.h5"}")
for more in (("--set", "timing.flat_pulse=wedge", "-o", "set.h5"),
             ("--flat-pulse", "wedge", "-o", "given.h5"), ("--help",)):
    with suppress(SystemExit):
        main([*words, *more])
told = [lf.TimingCalibration.load(name).response_curve for name in ("set.h5", "given.h5")]
assert (told[0] == told[1]).all()
print(len(told[0][0]))
"""


def test_a_shape_of_the_pulse_is_two_files(tmp_path, home):
    """Beside them, its test; its line in the reference is written by a tool."""
    write_into(home, "timing/calibrate/wedge.py", SHAPE)
    registry = "timing/calibrate/flat_shapes.py"
    insert_into(
        home,
        registry,
        ("    return tail_of_flat(flat, timing=clock)\n\n", SHAPE_LOADED),
        ("\nFLAT_SHAPES = (\n", SHAPE_LINE),
    )
    assert touched_in(home) == {"timing/calibrate/wedge.py", registry}
    said = printed_by(ASK_SHAPE, tmp_path, home)
    assert "[wedge|auto|gaussian|tail|mean]" in " ".join(said)
    assert "pulse: a wedge, a Gaussian unless" in " ".join(" ".join(said).split())
    assert int(said[-1]) == 61
