"""Units of work: kept whole, used again only where they fit, in any number of processes."""

import json
import threading

import numpy as np
import pytest

from lightflight.path.light_path import LightPath
from studies.zheng2020 import work
from studies.zheng2020.work import Unit, results_of_units
from tests.studies.zheng2020 import fakes


@pytest.fixture(autouse=True)
def no_calls_yet():
    fakes.CALLS.clear()


def unit(name, maker=fakes.squared, **settings):
    return Unit(name, maker, settings)


def test_results_come_by_name(tmp_path):
    found = results_of_units([unit("a", value=3), unit("b", value=4)], tmp_path, seed=1)
    assert found["a"]["square"] == 9
    assert found["b"] == {"square": 16, "seed": 1, "paths": {}}


def test_what_is_there_is_not_done_again(tmp_path):
    units = [unit("a", value=3), unit("b", value=4)]
    results_of_units(units[:1], tmp_path, seed=1)
    found = results_of_units(units, tmp_path, seed=1)
    assert fakes.CALLS == [3, 4]
    assert found["a"]["square"] == 9


@pytest.mark.parametrize("change", ["seed", "settings", "fresh", "version"])
def test_what_does_not_fit_is_done_again(tmp_path, change, monkeypatch):
    results_of_units([unit("a", value=3)], tmp_path, seed=1)
    if change == "version":
        monkeypatch.setattr(work, "__version__", "another")
    wanted = unit("a", value=5 if change == "settings" else 3)
    results_of_units([wanted], tmp_path, seed=2 if change == "seed" else 1, fresh=change == "fresh")
    assert len(fakes.CALLS) == 2


def test_a_damaged_file_is_done_again(tmp_path):
    results_of_units([unit("a", value=3)], tmp_path, seed=1)
    file = tmp_path / "a.json"
    file.write_text(file.read_text()[:40])
    assert results_of_units([unit("a", value=3)], tmp_path, seed=1)["a"]["square"] == 9
    assert len(fakes.CALLS) == 2


def test_a_unit_that_fails_leaves_nothing_and_the_others_stay(tmp_path):
    units = [unit("a", value=3), unit("bad", fakes.failing), unit("c", value=5)]
    with pytest.raises(RuntimeError, match="on purpose"):
        results_of_units(units, tmp_path, seed=1)
    assert sorted(p.name for p in tmp_path.iterdir()) == ["a.json"]


def test_a_worker_that_heard_ctrl_c_does_no_other_unit(tmp_path, monkeypatch):
    monkeypatch.setattr(work, "_stopped", threading.Event())
    work._do_unless_stopped(unit("a", value=3), tmp_path, 1)
    for again in (unit("b", fakes.interrupted), unit("c", value=5)):
        with pytest.raises(KeyboardInterrupt):
            work._do_unless_stopped(again, tmp_path, 1)
    assert fakes.CALLS == [3, "interrupted"]
    assert [file.name for file in tmp_path.iterdir()] == ["a.json"]


def test_progress_counts_kept_and_new_units(tmp_path):
    seen = []
    results_of_units([unit("a", value=3)], tmp_path, seed=1)
    results_of_units(
        [unit("a", value=3), unit("b", value=4)],
        tmp_path,
        seed=1,
        progress=lambda *args: seen.append(args),
    )
    assert seen == [("a", 1, 2), ("b", 2, 2)]


def test_paths_come_back(tmp_path):
    for _ in range(2):
        found = results_of_units([unit("p", fakes.with_path)], tmp_path, seed=1)
        path = found["p"]["paths"]["straight"]
        assert isinstance(path, LightPath)
        np.testing.assert_allclose(path.vertices_mm[-1], [100.0, 0.0, 10.0])
    assert fakes.CALLS == ["path"]


def test_results_are_plain_json(tmp_path):
    results_of_units([unit("a", value=3)], tmp_path, seed=7)
    record = json.loads((tmp_path / "a.json").read_text())
    assert record["seed"] == 7
    assert record["settings"] == {"value": 3}
    assert record["maker"] == "fakes:squared"


def test_processes_give_the_same(tmp_path):
    units = [unit(f"square{value}", value=value) for value in (3, 4)]
    one = results_of_units(units, tmp_path / "one", seed=1)
    two = results_of_units(units, tmp_path / "two", seed=1, workers=2)
    assert one == two
    assert one["square4"]["square"] == 16
    assert fakes.CALLS == [3, 4]  # the second time elsewhere
