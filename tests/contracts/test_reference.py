"""Pages that are made from the code say what the code says; the README's commands exist."""

import re
import runpy
import subprocess
import sys
from fnmatch import fnmatch
from pathlib import Path

import pytest

from lightflight.files.store import load_record
from lightflight.reconstruct.estimators import ESTIMATORS
from tools.make_schema_files import (
    known_path,
    known_path_that_forks,
    known_path_with_an_alternative,
)

REPOSITORY = Path(__file__).resolve().parents[2]


def test_reference_pages_are_up_to_date():
    done = subprocess.run(
        [sys.executable, REPOSITORY / "tools" / "write_reference.py", "--check"],
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr


def test_the_page_of_formats_knows_every_array_of_a_path(monkeypatch, tmp_path):
    monkeypatch.syspath_prepend(REPOSITORY / "tools")
    arrays = runpy.run_path(str(REPOSITORY / "tools" / "write_reference.py"))["PATH_ARRAYS"]
    listed = [name for name, _, _ in arrays]
    told = {name: meaning for name, _, meaning in arrays}
    for made in (known_path(), known_path_that_forks(), known_path_with_an_alternative()):
        made.save(tmp_path / "path.h5")
        for name in load_record(tmp_path / "path.h5", kind="path")[0]:
            pattern = next((one for one in listed if fnmatch(name, one)), None)
            assert pattern is not None, name
            if pattern in ("residuals_*", "covariance_*"):
                assert f"`{name.removeprefix(pattern[:-1])}`" in told[pattern], name


def test_the_readme_keeps_its_measured_block():
    subprocess.run(
        [sys.executable, REPOSITORY / "tools" / "update_readme.py", "--check"], check=True
    )


def test_tables_of_the_limits_page_are_written_by_their_tool(monkeypatch):
    monkeypatch.syspath_prepend(REPOSITORY / "tools")
    tool = runpy.run_path(str(REPOSITORY / "tools" / "update_limits_page.py"))
    text = tool["PAGE"].read_text("utf-8")
    for name in tool["TABLES"]:
        assert "a new table" in tool["with_block"](text, name, "a new table")
    leg = {
        "photons": 3.0, "prior": "known", "method": "joint", "elevation_deg": -80.0,
        "degrees": 0.1234, "in_bounds": 1.056, "own": 0.02, "pull": 0.98, "failed": 0,
    }  # fmt: skip
    nothing = {**leg, "degrees": None, "failed": 1}
    steep = [{**leg, "prior": p, "method": m} for p in tool["PRIORS"] for m in ("joint", "photon")]
    share = {"clock": "perfect", "photons": 1000.0, "in_68": 0.681, "in_95": 0.954, "n": 9}
    results = {
        "lightflight": "1.2",
        "runs": 7,
        "made_utc": "2026-01-01",
        "tables": {
            "legs": [leg],
            "starved": [leg, nothing],
            "steep": steep,
            "coverage": [{**share, "quantity": quantity} for quantity in tool["QUANTITIES"]],
        },
    }
    lines = {name: tool["block_of_table"](name, results).splitlines() for name in tool["TABLES"]}
    assert lines["legs"][2:] == [
        "| source and emission time known | `joint` | 0.1234° | 1.056 | 0.98 |",
        "",
        "`benchmarks/accuracy_limits.py --only legs --runs 7`, 1.2, 2026-01-01.",
    ]
    assert lines["starved"][2:4] == [
        "| 3 | `joint` | 0.123° | 1.06 | 0.98 |",
        "| 3 | `joint` | finds nothing | | |",
    ]
    assert lines["steep"][2] == "| \u221280° | 0.12° | 1.06 | 1.06 | 0.98 | 1.06 |"
    assert lines["coverage"][2] == "| perfect | 1,000 | 68.1 / 95.4 | 68.1 / 95.4 | 68.1 / 95.4 |"


@pytest.mark.parametrize("estimator", ESTIMATORS, ids=lambda estimator: estimator.name)
def test_every_estimator_stands_in_the_table_of_estimators(estimator):
    page = (REPOSITORY / "docs" / "how-to" / "choose-estimator.md").read_text("utf-8")
    assert f"\n| `{estimator.name}` | {estimator.summary} | " in page


@pytest.mark.parametrize("page", ["README.md", "CONTRIBUTING.md"])
def test_every_make_target_that_is_named_exists(page):
    named = set(
        re.findall(r"(?:`|^ +)make ([a-z-]+)", (REPOSITORY / page).read_text("utf-8"), re.M)
    )
    targets = set(re.findall(r"^([a-z-]+):", (REPOSITORY / "Makefile").read_text("utf-8"), re.M))
    assert named
    assert named <= targets


@pytest.mark.parametrize("page", ["README.md", "CONTRIBUTING.md"])
def test_every_file_that_is_linked_exists(page):
    links = re.findall(r"\]\(([^)#:]+)\)", (REPOSITORY / page).read_text("utf-8"))
    missing = [link for link in links if not (REPOSITORY / link).exists()]
    assert not missing


def test_every_decision_has_its_number_once():
    names = sorted(path.name for path in (REPOSITORY / "docs" / "decisions").glob("[0-9]*.md"))
    numbers = [name[:4] for name in names]
    assert numbers == [f"{i + 1:04d}" for i in range(len(names))]
