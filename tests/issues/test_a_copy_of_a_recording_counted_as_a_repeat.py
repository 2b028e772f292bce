"""A recording given twice, by a pattern and by its name, was two repeats: its errors shrank."""

import shutil
from typing import Any

import pytest
from click.testing import CliRunner

import lightflight as lf
from lightflight.cli import main
from tests.oracles.worlds.border import record, what_the_user_tells
from tests.oracles.worlds.random_worlds import random_world


@pytest.mark.parametrize("second", ["one.h5", "copy.h5"])
def test_the_same_counts_are_refused(second, rng, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    lf.write(lf.Histograms(rng.poisson(3.0, (8, 16, 64)), bin_width_ps=55.0), "one.h5")
    shutil.copy("one.h5", "copy.h5")
    done = CliRunner().invoke(main, ["reconstruct", "one.h5", second])
    assert done.exit_code == 2
    assert f"{second}: holds the same counts as one.h5: give each recording once" in done.stderr


def test_python_refuses_them_too():
    world = random_world(1, 1, 4_000.0, "known")
    repeats: list[Any] = [record(world, seed) for seed in (1, 2, 1)]
    with pytest.raises(ValueError, match="recordings 1 and 3 hold the same counts"):
        lf.reconstruct(repeats, **what_the_user_tells(world))
