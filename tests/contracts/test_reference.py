"""Pages that are made from the code say what the code says; the README's commands exist."""

import re
import subprocess
import sys
from pathlib import Path

import pytest

REPOSITORY = Path(__file__).resolve().parents[2]


def test_reference_pages_are_up_to_date():
    done = subprocess.run(
        [sys.executable, REPOSITORY / "tools" / "write_reference.py", "--check"],
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr


def test_the_readme_keeps_its_measured_block():
    subprocess.run(
        [sys.executable, REPOSITORY / "tools" / "update_readme.py", "--check"], check=True
    )


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
