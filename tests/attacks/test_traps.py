"""Modules that lie in a folder of data: nothing of them runs, whoever is started there."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from lightflight.files.children import safe_path
from tests.attacks.traps import lay_traps, run_there, sprung, the_command
from tests.formats.made_by_hand import ptu_bytes, sdt_bytes

SOURCE = Path(__file__).parents[2] / "src" / "lightflight"
STUDIES = SOURCE.parents[1] / "studies"


@pytest.fixture
def trapped(tmp_path) -> Path:
    return lay_traps(tmp_path)


def test_the_traps_work(trapped):
    """What Python itself does there: else the tests below would say nothing."""
    done = run_there(trapped, sys.executable, "-c", "import colorsys")
    assert done.returncode == 1
    assert sprung(trapped) == ["colorsys"]


@pytest.mark.parametrize("name", ["x.ptu", "x.sdt"])
def test_reading_there_runs_none_of_them(trapped, name):
    pytest.importorskip(f"{name[2:]}file")
    content = ptu_bytes(np.arange(200) % 3000) if name == "x.ptu" else sdt_bytes(np.ones((2, 64)))
    (trapped / name).write_bytes(content)
    done = run_there(trapped, *the_command(), "info", name)
    assert (done.returncode, sprung(trapped)) == (0, []), done.stderr


def test_python_m_lightflight_runs_none_of_them_either(tmp_path):
    """All but the few that Python itself loads from there before a line of ours runs."""
    names = ["json", "numpy", "random", "socket", "click", "h5py", "ptufile", "tomllib"]
    lay_traps(tmp_path, names)
    np.savez(tmp_path / "x.npz", cube=np.ones((2, 2, 8), np.uint16), axes="yxt")
    done = run_there(tmp_path, sys.executable, "-m", "lightflight", "info", "x.npz")
    assert (done.returncode, sprung(tmp_path)) == (0, []), done.stderr


def test_a_prompt_there_gives_its_children_none_of_them(trapped):
    """At a prompt the current folder is the first one that Python itself looks into."""
    pytest.importorskip("ptufile")
    (trapped / "x.ptu").write_bytes(ptu_bytes(np.arange(200) % 3000))
    code = (
        "import sys; first = sys.path.pop(0); import lightflight as lf, lightflight.formats.ptu\n"
        "sys.path.insert(0, first); assert first == ''\n"
        "lf.formats.ptu.run_isolated('lightflight.formats.ptu:load',"
        " lf.formats.ptu.Path('x.ptu'), {'channel': None})"
    )
    done = run_there(trapped, sys.executable, "-c", code)
    assert (done.returncode, sprung(trapped)) == (0, []), done.stderr


WORKERS = """
import sys
first = sys.path.pop(0)
from pathlib import Path
import distributed, multiprocessing.forkserver, tempfile, lightflight.batch.cluster as cluster
sys.path.insert(0, first)
def path():
    import colorsys
    return sys.path
with tempfile.TemporaryDirectory() as scratch:
    with cluster.workers(n_workers=1, scratch=Path(scratch)) as client:
        client.run(lambda: __import__("colorsys"))
        found = cluster.submit(client, sys.path.copy, name="a").result()
print(found)
assert sys.path[0] == first
"""


@pytest.mark.slow
def test_workers_of_campaigns_run_none_of_them(trapped):
    """The server they branch off, what watches their resources, and they themselves."""
    pytest.importorskip("distributed")
    done = run_there(trapped, sys.executable, "-c", WORKERS)
    assert (done.returncode, sprung(trapped)) == (0, []), done.stderr
    assert str(trapped) not in done.stdout


def test_settings_that_lie_there_are_not_those_of_libraries(tmp_path):
    """Numba would load pickles from the folder it names, Matplotlib run what it calls LaTeX."""
    (tmp_path / ".numba_config.yaml").write_text(f"cache_dir: {tmp_path}/cache\n")
    (tmp_path / "matplotlibrc").write_text("text.usetex: True\nanimation.ffmpeg_path: ./evil\n")
    asked = (
        "import lightflight.view.style as style, lightflight._kernels.jit as jit, os, sys\n"
        "jit.numba.core.config.reload_config()\n"
        "print(jit.numba.config.CACHE_DIR == os.environ.get('NUMBA_CACHE_DIR', ''))\n"
        "print(style.mpl.rcParams['text.usetex'], style.mpl.rcParams['animation.ffmpeg_path'])\n"
        "print(os.getcwd() == sys.argv[1])"
    )
    done = run_there(tmp_path, sys.executable, "-P", "-c", asked, os.fspath(tmp_path))
    assert done.stdout.split() == ["True", "False", "ffmpeg", "True"], done.stderr


@pytest.mark.skipif(not hasattr(os, "geteuid"), reason="POSIX")
def test_kernels_are_not_taken_from_where_others_can_write(tmp_path, monkeypatch, caplog):
    """They are pickles and machine code: who can put them there can run code."""
    import numba

    from lightflight._kernels import jit

    def kept_in(folder: Path, mode: int) -> bool:
        folder.mkdir(exist_ok=True)
        folder.chmod(mode)
        monkeypatch.setattr(numba.config, "CACHE_DIR", str(folder))
        jit._is_ours.cache_clear()
        kernel: Any = jit.jit(_nothing)
        return kernel.stats.cache_path is not None

    assert kept_in(tmp_path / "own", 0o755)
    assert kept_in(tmp_path / "sticky", 0o1777)
    assert not caplog.records
    assert not kept_in(tmp_path / "open", 0o777)
    assert "other users can write to" in caplog.text
    # A folder in it that somebody made before us, for what is kept of this very file.
    (within,) = (tmp_path / "sticky").iterdir()
    within.chmod(0o777)
    assert not kept_in(tmp_path / "sticky", 0o1777)
    within.chmod(0o755)
    if os.getuid() == 0:  # who alone can give folders away
        os.chown(tmp_path / "own", 12_345, -1)
        assert not kept_in(tmp_path / "own", 0o755)
    jit._is_ours.cache_clear()


def _nothing() -> None:
    pass


UNITS = """
import sys
first = sys.path.pop(0)
import concurrent.futures.process, multiprocessing.popen_spawn_posix, platform
import multiprocessing.resource_tracker
from studies.zheng2020.work import Unit, results_of_units
sys.path.insert(0, first)
if __name__ == "__main__":
    assert first == ""
    units = [Unit(name, platform.python_build) for name in "ab"]
    results_of_units(units, "kept", seed=1, workers=2)
"""


@pytest.mark.slow
def test_workers_of_studies_run_none_of_them(trapped):
    """Their work fails (it takes no seed); what they import before shows."""
    done = run_there(
        trapped, sys.executable, "-c", UNITS, PYTHONPATH=f"{SOURCE.parent}:{STUDIES.parent}"
    )
    assert "unexpected keyword argument" in done.stderr
    assert sprung(trapped) == []


def test_what_is_kept_of_the_path(tmp_path, monkeypatch):
    here, told, other = (tmp_path / name for name in ("here", "told", "other"))
    for folder in (here, told, other):
        folder.mkdir()
    monkeypatch.chdir(here)
    monkeypatch.setenv("PYTHONPATH", f"{told}{os.pathsep}")
    path = ["", ".", str(here), str(told), str(other), str(SOURCE.parent)]
    assert safe_path(path, with_script=False) == [str(told), str(other), str(SOURCE.parent)]
    monkeypatch.setenv("PYTHONPATH", str(here))
    assert str(here) in safe_path(path, with_script=False)


def test_a_script_reaches_its_neighbours_in_workers_and_vendors_readers_do_not(tmp_path):
    (tmp_path / "script.py").write_text(
        "import sys\nfrom lightflight.files.children import safe_path\n"
        "print([sys.path[0] in safe_path(sys.path, with_script=w) for w in (True, False)])\n"
    )
    done = subprocess.run(
        [sys.executable, "script.py"], cwd=tmp_path, capture_output=True, text=True, check=True
    )
    assert done.stdout.strip() == "[True, False]"


def test_processes_are_started_in_one_place():
    """By construction: another module that starts one must be named here, with its reason."""
    starters = ("subprocess", "os.system", "os.exec", "os.spawn", "os.popen", "os.fork", "Popen")
    allowed = {
        "files/children.py": "the place itself",
        "formats/isolation.py": "catches TimeoutExpired",
    }
    assert _files_with(SOURCE, starters) == set(allowed)
    assert _files_with(STUDIES, starters) == set()


def test_pools_of_processes_are_started_with_the_safe_path():
    starters = ("get_context", "ProcessPool", "forkserver", "LocalCluster(")
    for folder in (SOURCE, STUDIES):
        for name in _files_with(folder, starters):
            assert "with safe_children(" in (folder / name).read_text("utf-8"), name


def _files_with(folder: Path, words: tuple[str, ...]) -> set[str]:
    return {
        file.relative_to(folder).as_posix()
        for file in folder.rglob("*.py")
        if any(word in file.read_text("utf-8") for word in words)
    }
