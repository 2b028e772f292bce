"""Reads files in a process that notes what Python itself is asked to do meanwhile (PEP 578).

`python -m tests.attacks.watched`: tasks as JSON lines on stdin, answers on stdout. A task is
read once without a watch (lazy imports and compiled kernels are then in place), and again with it.
"""

from __future__ import annotations

import functools
import json
import os
import sys
import tempfile
import warnings
from pathlib import Path
from typing import Any

FORBIDDEN = (
    "import",
    "exec",
    "marshal.",
    "pickle.",
    "socket.",
    "subprocess.Popen",
    "os.system",
    "os.exec",
    "os.posix_spawn",
    "os.spawn",
    "os.fork",
    "os.remove",
    "os.rename",
    "os.mkdir",
    "os.rmdir",
    "os.link",
    "os.symlink",
    "os.chmod",
    "os.putenv",
    "shutil.",
    "ctypes.",
    "compile",
    "open",
)


class _Watch:
    """What has been seen; None: nobody looks."""

    seen: list[str] | None = None


watch = _Watch()

# Asked once, and not in the hook: finding it tries whether files can be written.
_OWN = (f"{tempfile.gettempdir()}{os.sep}lightflight-", os.devnull)


def _hook(event: str, arguments: tuple[Any, ...]) -> None:
    if watch.seen is None or not event.startswith(FORBIDDEN):
        return
    text = _what(event, arguments)
    # A compiled kernel may be fetched: of our own code, for another layout of arrays.
    if text and not _is_called_by(f"{os.sep}numba{os.sep}core{os.sep}"):
        watch.seen.append(text)


def _is_called_by(caller: str) -> bool:
    """Whether a function of this name, or in such a file, stands above."""
    frame: Any = sys._getframe()
    while frame is not None:
        if frame.f_code.co_name == caller or caller in frame.f_code.co_filename:
            return True
        frame = frame.f_back
    return False


def _what(event: str, arguments: tuple[Any, ...]) -> str | None:
    """The event in words; None where it is one that reading may raise."""
    if event == "open":
        path, _, flags = arguments
        writes = isinstance(flags, int) and flags & (os.O_WRONLY | os.O_RDWR | os.O_CREAT)
        # A number is a descriptor that is open already: of pipes to a child.
        is_new = writes and not isinstance(path, int)
        return f"open {path} to write" if is_new and not _is_own(path) else None
    if event in ("os.mkdir", "os.rmdir", "os.remove", "os.chmod", "shutil.rmtree"):
        # `remove` and `rmdir` may name an entry of an open folder.
        inside = len(arguments) > 1 and arguments[-1] not in (-1, None)
        return None if inside or _is_own(arguments[0]) else f"{event} {arguments[0]}"
    if event == "subprocess.Popen":
        ours = [sys.executable, "-P", "-m", "lightflight.formats.isolation"]
        return None if list(arguments[1][:4]) == ours else f"{event} {arguments[1]}"
    if event in ("os.posix_spawn", "os.fork") or event.startswith("os.exec"):
        return event
    if event == "compile":
        # NumPy reads the header of a .npy as a literal.
        return None if _is_called_by("literal_eval") else f"compile {str(arguments[0])[:80]}"
    return f"{event} {str(arguments)[:80]}"


def _is_own(path: Any) -> bool:
    """Whether a path lies in a temporary folder of ours."""
    if not isinstance(path, str | bytes | os.PathLike):
        return False
    return os.fsdecode(path).startswith(_OWN)


def _read(path: str, hints: dict[str, Any], reads: str) -> str:
    from tests.fuzz_process import _try_to_read

    return _try_to_read(path, hints, reads)


@functools.cache
def _homes() -> tuple[str, ...]:
    """Folders of the environment, of this package and its tests."""
    import sysconfig

    roots = [Path(value) for value in sysconfig.get_paths().values()]
    roots += [Path(__file__).parents[2], Path(sys.base_prefix), Path(sys.prefix)]
    roots += [Path(p) for p in os.environ.get("LIGHTFLIGHT_HOMES", "").split(os.pathsep) if p]
    return tuple(os.path.realpath(root) + os.sep for root in roots)


@functools.cache
def _is_at_home(file: str) -> bool:
    return os.path.realpath(file).startswith(_homes())


def _modules_from_elsewhere() -> list[str]:
    """Imported modules that lie elsewhere."""
    files = {name: getattr(module, "__file__", None) for name, module in sys.modules.items()}
    return [f"{name} {file}" for name, file in files.items() if file and not _is_at_home(file)]


def main() -> None:
    """Answer until stdin ends."""
    warnings.simplefilter("ignore")
    sys.addaudithook(_hook)
    for line in sys.stdin:
        task = json.loads(line)
        if task.get("sound"):
            outcome, seen = _read(task["sound"], task["hints"], task["reads"]), []
            if outcome != "read":
                seen.append(f"the sound file: {outcome}")
        else:
            watch.seen = []
            outcome = _read(task["path"], task["hints"], task["reads"])
            seen, watch.seen = watch.seen, None
        answer = {"outcome": outcome, "seen": seen, "elsewhere": _modules_from_elsewhere()}
        sys.stdout.write(json.dumps(answer) + "\n")
        sys.stdout.flush()


if __name__ == "__main__":
    main()
