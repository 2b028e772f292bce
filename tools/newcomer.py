"""A newcomer's log: what README, tutorial and how-tos print, typed into empty folders.

    .venv/bin/python tools/newcomer.py -o out/newcomer.log

The tutorial is followed in an empty folder; README and every other page begin in a copy of that
folder, as their readers do. Files that a page shows are written, commands run in a shell of their
own with the checkout's `lightflight`, Python runs page by page. Lines that a page shows below a
command must be among what it prints, numbers to 5 % and one of their last digit. What is not typed
is listed with its reason. Exit code 1 where anything was otherwise than printed.
"""

from __future__ import annotations

import argparse
import contextlib
import io
import os
import re
import shlex
import shutil
import subprocess
import sys
import tempfile
import time
import traceback
from collections.abc import Iterator
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path
from typing import Any, TextIO

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))

from tests.docs.pages import NOT_RUN, Page, not_printed, run_session  # noqa: E402

TUTORIAL = ROOT / "docs" / "tutorial" / "first-path.md"
LONGEST_S = 600


@dataclass
class Log:
    """What was typed, and how it went."""

    out: TextIO
    counts: dict[str, int] = field(
        default_factory=lambda: dict.fromkeys(("as printed", "otherwise", "not typed"), 0)
    )

    def note(self, result: str, what: str, detail: str = "") -> None:
        """One line for one thing typed, and its output where it went otherwise."""
        self.counts[result] += 1
        self.out.write(f"  [{result}] {what}\n")
        if detail:
            self.out.write("".join(f"      {line}\n" for line in detail.splitlines()))
        self.out.flush()


def commands_of(text: str) -> Iterator[tuple[str, list[str]]]:
    """Commands of a console block, and the lines shown below each."""
    command, shown = "", []  # type: str, list[str]
    for line in [*text.splitlines(), "$ "]:
        if line.startswith("$ "):
            if command:
                yield command, shown
            command, shown = line[2:], []
        elif command.endswith("\\"):
            command = command[:-1] + line.strip()
        elif line.strip() not in ("", "..."):
            shown.append(line)


def environment() -> dict[str, str]:
    """A shell in which the checkout's `lightflight` is installed."""
    beside = str(Path(sys.executable).parent)
    paths = [str(ROOT / "src"), os.environ.get("PYTHONPATH", "")]
    return {
        **os.environ,
        "PATH": f"{beside}{os.pathsep}{os.environ['PATH']}",
        "PYTHONPATH": os.pathsep.join(path for path in paths if path),
    }


def missing_file(command: str, folder: Path) -> str:
    """A file that a command reads and nobody has made; "" where there is none."""
    words = shlex.split(command, comments=True)
    read = [word for before, word in pairwise(words) if before != "-o"]
    names = [word for word in read if re.fullmatch(r"[\w./-]+\.(h5|toml|csv|npy)", word)]
    return next((name for name in names if not (folder / name).exists()), "")


def type_command(command: str, shown: list[str], folder: Path, log: Log) -> None:
    """Type one command, and hold what it prints against what the page shows."""
    if command.startswith(NOT_RUN):
        log.note("not typed", command, "sets a machine up: see .ci/run")
        return
    lacking = missing_file(command, folder)
    if lacking:
        log.note("not typed", command, f"{lacking} is the reader's own")
        return
    start = time.monotonic()
    typed = command.replace("python examples/", f"python {ROOT}/examples/")
    done = subprocess.run(
        typed, shell=True, cwd=folder, env=environment(), capture_output=True, text=True,
        check=False, timeout=LONGEST_S,
    )  # fmt: skip
    printed = done.stdout + done.stderr
    absent = not_printed(shown, printed)
    took = f"{command}   ({time.monotonic() - start:.1f} s)"
    if done.returncode:
        log.note("otherwise", took, f"exit code {done.returncode}\n{printed}")
    elif absent:
        log.note("otherwise", took, "\n".join(["not printed:", *absent, "but:", printed]))
    else:
        log.note("as printed", took)


def run_python(kind: str, body: str, names: dict[str, Any], where: str, log: Log) -> None:
    """Run a block of Python in the present folder."""
    first = next((line for line in body.splitlines() if line.strip()), "")
    try:
        with contextlib.redirect_stdout(io.StringIO()):
            if kind == "pycon":
                run_session(body, names, where)
            else:
                exec(compile(body, where, "exec"), names)
    except Exception:  # noqa: BLE001  # whatever it is goes into the log
        log.note("otherwise", f"Python: {first} ...", traceback.format_exc())
    else:
        log.note("as printed", f"Python: {first} ...")


def follow(file: Path, folder: Path, log: Log) -> None:
    """Do all that a page shows, in its order, in a folder."""
    log.out.write(f"\n{file.relative_to(ROOT)}\n")
    page = Page(file)
    indented = re.findall(r"^    (lightflight .+|make \S+.*)$", file.read_text("utf-8"), re.M)
    for command in indented:
        type_command(command, [], folder, log)
    with contextlib.chdir(folder):
        for block in page.blocks():
            if block.kind == "toml" and block.caption:
                Path(block.caption).write_text(block.body, encoding="utf-8")
            elif block.kind == "console":
                for command, shown in commands_of(block.body):
                    type_command(command, shown, folder, log)
            elif block.kind in ("python", "pycon"):
                run_python(block.kind, block.body, page.names, str(file), log)
            elif block.kind in ("py", "text", "bash"):
                log.note(
                    "not typed",
                    block.body.splitlines()[0] + " ...",
                    "asks for workers of Dask: see tests/batch and tests/attacks",
                )


def pages() -> list[Path]:
    """README, the pages by kind of user, and the how-tos; the tutorial goes before them."""
    folders = (ROOT / "docs" / name for name in ("start", "how-to"))
    return [ROOT / "README.md", *(p for folder in folders for p in sorted(folder.glob("*.md")))]


def main() -> None:
    """Write the log; exit code 1 where anything was otherwise than printed."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("-o", "--output", type=Path, help="file to write; without: the terminal")
    args = parser.parse_args()
    if args.output:
        args.output.parent.mkdir(parents=True, exist_ok=True)
    with (
        (
            args.output.open("w", encoding="utf-8")
            if args.output
            else contextlib.nullcontext(sys.stdout)
        ) as out,
        tempfile.TemporaryDirectory() as made,
    ):
        log = Log(out)
        first = Path(made) / "tutorial"
        first.mkdir()
        follow(TUTORIAL, first, log)
        for number, file in enumerate(pages()):
            folder = Path(made) / f"{number}-{file.stem}"
            shutil.copytree(first, folder)
            follow(file, folder, log)
        said = ", ".join(f"{n} {result}" for result, n in log.counts.items())
        out.write(f"\n{said}\n")
    print(said, file=sys.stderr)
    sys.exit(log.counts["otherwise"] > 0)


if __name__ == "__main__":
    main()
