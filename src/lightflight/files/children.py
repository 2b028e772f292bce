"""Where processes of this package get their words: none runs code that lies in a folder of data.

Python puts the current folder on the path of what it may import (`-m`, `-c`, a prompt), or that
of the script. A `json.py` or `random.py` lying beside a recording would then run in place of
Python's own. Every Python child is started with what this module says, and with nothing else.
"""

from __future__ import annotations

import contextlib
import os
import subprocess
import sys
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

SAFE_ENVIRONMENT = {"PYTHONSAFEPATH": "1"}
"""What keeps the folder that Python itself would add from the path of a child and its children."""

_HOME = Path(__file__).parents[2]
"""The folder that this package was imported from: that one is always needed."""


def safe_path(path: Sequence[str], *, with_script: bool, needed: Sequence[Path] = ()) -> list[str]:
    """Folders to import from, without those that only the place of the call has added.

    Parameters
    ----------
    path : sequence of str
        `sys.path`.
    with_script : bool
        Keep the folder of the script that runs; a child that imports the script needs it.
    needed : sequence of Path, optional
        Folders of code that the caller itself was imported from: kept wherever they lie.

    Returns
    -------
    list of str
        Without the current folder, unless PYTHONPATH names it or this package lies in it.
    """
    told = [Path(one) for one in os.environ.get("PYTHONPATH", "").split(os.pathsep) if one]
    script = _folder_of_script()
    unsafe = [Path.cwd()] if script is None else [Path.cwd(), script]
    kept = [_HOME, *needed, *told, *([script] if with_script and script is not None else [])]

    def is_safe(entry: str) -> bool:
        # "" and "." mean wherever a child happens to be.
        lies_fixed = Path(entry).is_absolute()
        return lies_fixed and (_is_among(entry, kept) or not _is_among(entry, unsafe))

    return [entry for entry in path if is_safe(entry)]


def _folder_of_script() -> Path | None:
    """Folder of the script that runs; None at a prompt and for `python -m`."""
    main = sys.modules.get("__main__")
    file = getattr(main, "__file__", None)
    if file is None or getattr(main, "__spec__", None) is not None:
        return None
    return Path(file).absolute().parent


def _is_among(entry: str, folders: Sequence[Path]) -> bool:
    """Whether an entry of the path is one of these folders, whatever they are called."""
    return os.path.realpath(entry) in {os.path.realpath(folder) for folder in folders}


@contextlib.contextmanager
def safe_children(*needed: Path) -> Iterator[None]:
    """Let `multiprocessing` start safe children meanwhile: they take over path and environment.

    Parameters
    ----------
    *needed : Path
        See `safe_path`.
    """
    path = list(sys.path)
    # "" stands for the current folder, which a child would not find by it.
    absolute = [entry or str(Path.cwd()) for entry in path]
    sys.path[:] = safe_path(absolute, with_script=True, needed=needed)
    # An empty entry of PYTHONPATH (":/opt/lab") means the current folder to Python.
    told = os.pathsep.join(filter(None, os.environ.get("PYTHONPATH", "").split(os.pathsep)))
    try:
        with environment({**SAFE_ENVIRONMENT, "PYTHONPATH": told}):
            yield
    finally:
        # What was added meanwhile stays.
        sys.path[:] = path + [entry for entry in sys.path if entry not in path]


@contextlib.contextmanager
def environment(values: Mapping[str, str]) -> Iterator[None]:
    """Environment variables for the processes that are started meanwhile."""
    before = {name: os.environ.get(name) for name in values}
    os.environ.update(values)
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value


def run_module(
    module: str, words: Sequence[str], *, told: str, time_limit_s: float
) -> subprocess.CompletedProcess[str]:
    """Run a module of ours as a program in a process of its own, without a shell.

    Parameters
    ----------
    module : str
        Its name; the child can import what this process can, but for `safe_path`.
    words : sequence of str
        Arguments.
    told : str
        What the child reads from stdin.
    time_limit_s : float
        Seconds it may take.

    Returns
    -------
    subprocess.CompletedProcess
        Exit code, stdout and stderr.

    Raises
    ------
    subprocess.TimeoutExpired
        Where it takes longer; it has been ended then.
    """
    environment = {
        **os.environ,
        **SAFE_ENVIRONMENT,
        "PYTHONPATH": os.pathsep.join(safe_path(sys.path, with_script=False)),
        "OPENBLAS_NUM_THREADS": "1",  # each thread takes memory, on a large machine too much
    }
    return subprocess.run(  # noqa: S603  (our own module, no shell)
        [sys.executable, "-P", "-m", module, *words],
        input=told,
        capture_output=True,
        text=True,
        errors="replace",
        timeout=time_limit_s,
        env=environment,
        check=False,
    )
