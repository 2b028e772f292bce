"""Run a page of the documentation: its files, commands and Python, in the order of the page."""

from __future__ import annotations

import contextlib
import doctest
import io
import os
import re
import shlex
import subprocess
import sys
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from click.testing import CliRunner

from lightflight.cli import main

ROOT = Path(__file__).resolve().parents[2]
DOCS = ROOT / "docs"

_FENCE = re.compile(
    r"^(?P<fence>```+)(?:\{code-block\} *)?(?P<kind>\w+)[^\n]*\n"
    r"(?::caption: (?P<caption>[^\n]+)\n\n?)?(?P<body>.*?)^(?P=fence)[ ]*$",
    re.MULTILINE | re.DOTALL,
)

NOT_RUN = ("pip ", "make ", "git ", "python -m pip ", "cd ", "source ")
"""Commands that set a machine up: what they do is tested by the continuous integration."""


@dataclass
class Block:
    """A fenced block: its language, its file name where it has one, its text."""

    kind: str
    caption: str
    body: str


@dataclass
class Page:
    """A page that can be run in a folder."""

    file: Path
    names: dict[str, Any] = field(default_factory=lambda: {"__name__": "__page__"})

    def blocks(self) -> list[Block]:
        """Fenced blocks in order."""
        text = self.file.read_text(encoding="utf-8")
        return [
            Block(m["kind"], (m["caption"] or "").strip(), m["body"]) for m in _FENCE.finditer(text)
        ]

    def run(self) -> int:
        """Run everything in the present folder; gives how many blocks did something."""
        done = 0
        for block in self.blocks():
            if block.kind == "toml" and block.caption:
                Path(block.caption).write_text(block.body, encoding="utf-8")
            elif block.kind == "console":
                run_console(block.body)
            elif block.kind == "python":
                with contextlib.redirect_stdout(io.StringIO()):
                    exec(compile(block.body, str(self.file), "exec"), self.names)
            elif block.kind == "pycon":
                run_session(block.body, self.names, str(self.file))
            else:
                continue
            done += 1
        return done


def run_session(text: str, names: dict[str, Any], where: str) -> None:
    """Check a Python session: what it prints must be what the page shows."""
    flags = doctest.ELLIPSIS | doctest.NORMALIZE_WHITESPACE
    test = doctest.DocTestParser().get_doctest(text, names, where, where, 0)
    said = io.StringIO()
    doctest.DocTestRunner(optionflags=flags).run(test, out=said.write, clear_globs=False)
    names.update(test.globs)
    assert not said.getvalue(), said.getvalue()


def run_console(text: str) -> None:
    """Run the commands after `$`; lines the page shows below them must be among what is printed."""
    command = ""
    shown: list[str] = []
    for line in [*text.splitlines(), "$ "]:
        if line.startswith("$ "):
            if command:
                _run_command(command, shown)
            command, shown = line[2:], []
        elif command.endswith("\\"):
            command = command[:-1] + line.strip()
        elif line.strip() not in ("", "..."):
            shown.append(line)


def _run_command(command: str, shown: list[str]) -> None:
    if command.startswith(NOT_RUN):
        return
    words = shlex.split(command)
    if words[0] == "lightflight":
        done = CliRunner().invoke(main, words[1:], prog_name="lightflight")
        assert done.exit_code == 0, f"{command}\n{done.stderr}"
        printed = done.stdout + done.stderr
    elif words[0] == "python":
        words = [sys.executable, str(ROOT / words[1]), *words[2:]]
        run = subprocess.run(words, capture_output=True, text=True, check=False, env=os.environ)
        assert run.returncode == 0, f"{command}\n{run.stderr}"
        printed = run.stdout + run.stderr
    else:
        raise AssertionError(f"a page shows a command that is not tested: {command}")
    for line in not_printed(shown, printed):
        raise AssertionError(f"{command} does not print:\n{line}\nbut:\n{printed}")


_NUMBER = re.compile(r"[-\u2212+]?\d[\d,]*(?:\.\d+)?(?:e[+-]?\d+)?")


def not_printed(shown: list[str], printed: str) -> list[str]:
    """Lines that a page shows and a command did not print."""
    lines = printed.splitlines()
    return [line for line in shown if not any(_alike(line, other) for other in lines)]


def _alike(shown: str, printed: str) -> bool:
    """Whether lines have the same words, and numbers to 5 % and one of the last digit shown.

    Sums are taken in another order on another machine, and a fit stops a little elsewhere.
    """
    if _words(shown) != _words(printed):
        return False
    return all(map(_close, _NUMBER.findall(shown), _NUMBER.findall(printed)))


def _words(line: str) -> str:
    return " ".join(_NUMBER.sub("#", line).split())


def _close(shown: str, printed: str) -> bool:
    value, other = (float(n.replace(",", "").replace("\u2212", "-")) for n in (shown, printed))
    digits = len(shown.partition("e")[0].partition(".")[2])
    return abs(value - other) <= 0.05 * abs(value) + 1.01 * 10.0**-digits
