"""What Python is asked to do while a file is read, whatever stands in it."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from tests import fuzz_readers, fuzz_seeds
from tests.attacks.length import at_length

pytestmark = pytest.mark.skipif(os.name == "nt", reason="files are made for POSIX")
_ROOT = Path(__file__).parents[2]


class Watched:
    """The process of `tests.attacks.watched`."""

    def __init__(self, folder: Path) -> None:
        told = [str(_ROOT), *filter(None, sys.path)]
        self._child = subprocess.Popen(
            [sys.executable, "-P", "-m", "tests.attacks.watched"], cwd=folder, text=True,
            stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL,
            env={**os.environ, "PYTHONPATH": os.pathsep.join(told)},
        )  # fmt: skip

    def answer(self, **task) -> dict:
        self._child.stdin.write(json.dumps(task) + "\n")
        self._child.stdin.flush()
        return json.loads(self._child.stdout.readline())

    def close(self) -> None:
        self._child.kill()
        self._child.communicate()


@pytest.fixture(scope="module")
def watched(tmp_path_factory):
    process = Watched(tmp_path_factory.mktemp("elsewhere"))
    yield process
    process.close()


@pytest.mark.timeout(3600)
def test_reading_asks_python_for_nothing_but_to_read(tmp_path, watched):
    """Sound files, and mutants of each; the same in every run (seed 16)."""
    (tmp_path / "made").mkdir()
    rng = np.random.default_rng(16)
    for seed in fuzz_seeds.seeds(tmp_path / "made"):
        sound = fuzz_readers.placed(tmp_path / "sound", seed, seed.content)
        told = {"hints": dict(seed.hints), "reads": seed.reads}
        first = watched.answer(sound=str(sound), **told)
        assert first["seen"] == [], seed.name
        assert first["elsewhere"] == [], seed.name
        again = watched.answer(path=str(sound), **told)
        assert (again["outcome"], again["seen"]) == ("read", []), seed.name
        for _ in range(at_length(1, 5) if seed.isolated else at_length(2, 60)):
            content = fuzz_readers.mutated_file(seed, rng)
            path = fuzz_readers.placed(tmp_path / "now", seed, content)
            if path is not None:
                found = watched.answer(path=str(path), **told)
                assert found["seen"] == [], (seed.name, found["outcome"])


@pytest.mark.parametrize(
    ("what", "code"),
    [
        ("import", "import colorsys"),
        ("subprocess", "import subprocess; subprocess.run(['true'])"),
        ("open", "open('written', 'w')"),
        ("socket", "import socket; socket.socket()"),
        ("compile", "eval('1 + 1')"),
    ],
)
def test_the_watch_sees_what_it_is_there_for(tmp_path, what, code):
    """The same hook, over what a hostile file might bring about."""
    program = (
        "import tests.attacks.watched as w, sys; sys.addaudithook(w._hook)\n"
        "w.watch.seen = seen = []\n"
        f"{code}\nw.watch.seen = None\nprint(seen)"
    )
    done = subprocess.run(
        [sys.executable, "-P", "-c", program], cwd=tmp_path, capture_output=True, text=True,
        check=True, env={**os.environ, "PYTHONPATH": os.pathsep.join([str(_ROOT), *sys.path])},
    )  # fmt: skip
    assert what in done.stdout
