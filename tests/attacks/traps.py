"""A folder in which every name that Python could import is a trap, and processes run in it."""

from __future__ import annotations

import os
import subprocess
import sys
from importlib.metadata import packages_distributions
from pathlib import Path

SPRUNG = "sprung.log"

_TRAP = """
import os
with open({log!r}, "a") as file:
    file.write(__name__ + "\\n")
raise RuntimeError("a trap was imported: " + __name__)
"""


def module_names() -> list[str]:
    """Top names of Python's own modules and of every installed package."""
    installed = {name for name in packages_distributions() if name.isidentifier()}
    names = (sys.stdlib_module_names | installed) - {"lightflight"}
    # The suite measures itself with some of these; they are no part of what is tried.
    return sorted(name for name in names if not name.startswith("_distutils"))


def lay_traps(folder: Path, names: list[str] | None = None) -> Path:
    """Put a module of each name into a folder; importing one is noted in its `sprung.log`."""
    for name in names or module_names():
        (folder / f"{name}.py").write_text(_TRAP.format(log=os.fspath(folder / SPRUNG)))
    return folder


def sprung(folder: Path) -> list[str]:
    """Names of the traps that were imported."""
    log = folder / SPRUNG
    return log.read_text().split() if log.exists() else []


def run_there(
    folder: Path, *words: str, limit_s: float = 120, **environment: str
) -> subprocess.CompletedProcess[str]:
    """Run a program with a folder as the current one."""
    inherited = {k: v for k, v in os.environ.items() if k != "PYTHONSAFEPATH"}
    return subprocess.run(
        words, cwd=folder, capture_output=True, text=True, timeout=limit_s, check=False,
        env={**inherited, **environment},
    )  # fmt: skip


def the_command() -> list[str]:
    """Words that start `lightflight` as its installed script does: its folder first on the path."""
    script = Path(sys.executable).with_name("lightflight")
    return (
        [sys.executable, os.fspath(script)]
        if script.exists()
        else [str(sys.executable), "-P", "-m", "lightflight"]
    )
