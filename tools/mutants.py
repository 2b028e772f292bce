"""Mistakes put into the package on purpose: for each, the test that stands for a claim must fail.

    python tools/mutants.py                  # all of them, two at a time
    python tools/mutants.py lap verdict      # those with one of these words in name, file or claim
    python tools/mutants.py --check          # run nothing: does every mistake still apply?

A record of `tests/mutants/*.toml` says which text of which file is replaced by which, and by what
test that must be seen; `claims.toml` beside them quotes what README and pages promise. A record
whose text is not found exactly once is an error, never passed over: change it with the code.

Everything is done in copies of the checkout in a temporary folder. The tests are run once without
any mistake, and must pass. Each mistake then has processes of its own; one in compiled code has an
empty cache of Numba's. Exit code 0: every mistake was caught.
"""

from __future__ import annotations

import argparse
import ast
import functools
import os
import queue
import re
import shutil
import subprocess
import sys
import tempfile
import time
import tomllib
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
RECORDS = Path("tests") / "mutants"
CLAIMS = "claims.toml"
COMPILED = "_kernels"

_NOT_COPIED = shutil.ignore_patterns(
    ".*", "out", "build", "dist", "asv", "generated", "node_modules", "*.egg-info"
)
_QUIETLY = ("-q", "-m", "", "-p", "no:cacheprovider")
"""Cases that the suite leaves out run too: which of them notices a mistake is not asked."""
_SECONDS = 600
"""A test of these takes a minute at most: what takes ten is lost in a loop."""


@dataclass(frozen=True)
class Mutation:
    """One mistake.

    Attributes
    ----------
    name : str
        What is wrong then, as a sentence.
    claim : str
        Key of what it breaks in `claims.toml`.
    file : str
        Below src/lightflight.
    before, after : str
        The text, which stands in the file once, and what takes its place.
    test : str
        Id of the test that must fail.
    """

    name: str
    claim: str
    file: str
    before: str
    after: str
    test: str

    @property
    def path(self) -> Path:
        """Of the file, below the checkout."""
        return Path("src") / "lightflight" / self.file

    @property
    def compiled(self) -> bool:
        """Whether Numba compiles the text."""
        return self.file.startswith(COMPILED)


def mutations_of(tree: Path) -> tuple[Mutation, ...]:
    """All records of a checkout, in the order of their files."""
    found = []
    for path in sorted((tree / RECORDS).glob("*.toml")):
        if path.name != CLAIMS:
            for record in tomllib.loads(path.read_text("utf-8"))["mutation"]:
                texts = {key: text.strip("\n") for key, text in record.items()}
                found.append(Mutation(**texts))
    return tuple(found)


def claims_of(tree: Path) -> dict[str, tuple[str, str]]:
    """What is claimed: (page, quotation) by key."""
    records = tomllib.loads((tree / RECORDS / CLAIMS).read_text("utf-8"))
    return {key: (one["page"], one["says"]) for key, one in records.items()}


def problems_of(one: Mutation, tree: Path) -> list[str]:
    """Why a mistake cannot be made in this checkout; empty where it can."""
    path, test = tree / one.path, Path(one.test.partition("::")[0])
    if not path.is_file():
        return [f"there is no {one.path}"]
    text, problems = path.read_text("utf-8"), []
    if (n := text.count(one.before)) != 1:
        problems.append(f"{one.path} holds its text {n} times, not once")
    elif one.before == one.after:
        problems.append("it changes nothing")
    elif not _is_python(text.replace(one.before, one.after)):
        problems.append(f"{one.path} is no Python any more")
    if not (tree / test).is_file() or not _holds(tree / test, one.test.split("::")[1:]):
        problems.append(f"there is no test {one.test}")
    return problems


def _is_python(text: str) -> bool:
    try:
        ast.parse(text)
    except SyntaxError:
        return False
    return True


def _holds(path: Path, names: Sequence[str]) -> bool:
    """Whether a file of tests has a test of this name, after those of its classes."""
    node: ast.AST = _parsed(path)
    for name in names:
        plain = re.sub(r"\[.*", "", name)
        defined = {n.name: n for n in getattr(node, "body", ()) if hasattr(n, "name")}
        if plain not in defined:
            return False
        node = defined[plain]
    return isinstance(node, ast.FunctionDef)


@functools.cache
def _parsed(path: Path) -> ast.Module:
    return ast.parse(path.read_text("utf-8"))


# --- running ------------------------------------------------------------------------------


@dataclass(frozen=True)
class Outcome:
    """What became of a mistake: "caught" or why not, the seconds, and the test's own words."""

    mutation: Mutation
    word: str
    seconds: float
    said: str = ""

    @property
    def line(self) -> str:
        """One line for the terminal."""
        said = f"  [{self.said}]" if self.said else ""
        return f"{self.word:9}{self.seconds:5.0f} s  {self.mutation.name}{said}"


def pytest_in(
    tree: Path, tests: Sequence[str], *options: str, **environment: str
) -> tuple[int, str]:
    """Exit code and output of pytest in a checkout, which imports that checkout's package."""
    found = subprocess.run(
        [sys.executable, "-m", "pytest", *_QUIETLY, *options, *tests],
        cwd=tree,
        env={
            **os.environ,
            "PYTHONPATH": str(tree / "src"),
            "NUMBA_NUM_THREADS": "1",
            "OMP_NUM_THREADS": "1",
            "OPENBLAS_NUM_THREADS": "1",
            "MPLBACKEND": "Agg",
            **environment,
        },
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        timeout=None if environment.get("PYTHONDONTWRITEBYTECODE") is None else _SECONDS,
        check=False,
    )
    return found.returncode, found.stdout


def outcome_in(tree: Path, one: Mutation) -> Outcome:
    """Make one mistake in a copy, run its test, and take the mistake back."""
    path, began = tree / one.path, time.monotonic()
    text, stat = path.read_text("utf-8"), path.stat()
    path.write_text(text.replace(one.before, one.after), "utf-8")
    # Python and Numba take their caches for new where time and size of the file are as before.
    os.utime(path, ns=(stat.st_atime_ns, stat.st_mtime_ns + 3_600_000_000_000))
    try:
        with tempfile.TemporaryDirectory() as empty:
            own = {"NUMBA_CACHE_DIR": empty} if one.compiled else {}
            code, said = pytest_in(tree, [one.test], "-x", PYTHONDONTWRITEBYTECODE="1", **own)
        word = {0: "SURVIVED", 1: "caught"}.get(code, "BROKEN")
    except subprocess.TimeoutExpired:
        word, said = "HANGS", ""
    finally:
        path.write_text(text, "utf-8")
        os.utime(path, ns=(stat.st_atime_ns, stat.st_mtime_ns))
    reasons = re.findall(r"^E +(.+)$", said, re.MULTILINE)
    reason = reasons[0][:90] if reasons else said.strip().splitlines()[-1][:90] if said else ""
    return Outcome(one, word, time.monotonic() - began, reason)


def outcomes(mutations: Sequence[Mutation], folder: Path, jobs: int) -> Iterator[Outcome]:
    """Of all mistakes, as they come, from copies of the checkout under `folder`.

    Raises
    ------
    SystemExit
        Where the tests do not pass, or are not run, without a mistake.
    """
    trees = [folder / str(k) for k in range(jobs)]
    shutil.copytree(ROOT, trees[0], ignore=_NOT_COPIED)
    _say(f"{len(mutations)} mistakes; their tests without any ...")
    tests = sorted({one.test for one in mutations})
    code, said = pytest_in(trees[0], tests, "-n", str(jobs), "--dist", "worksteal")
    summary = said.strip().splitlines()[-1] if said.strip() else ""
    if code or re.search(r"\d+ skipped", summary):
        raise SystemExit(f"{said}\nwithout a mistake not all of these tests pass: {summary}")
    _say(summary)
    for tree in trees[1:]:
        shutil.copytree(trees[0], tree)
    free: queue.SimpleQueue[Path] = queue.SimpleQueue()
    for tree in trees:
        free.put(tree)

    def run(one: Mutation) -> Outcome:
        tree = free.get()
        try:
            return outcome_in(tree, one)
        finally:
            free.put(tree)

    with ThreadPoolExecutor(jobs) as pool:
        yield from pool.map(run, mutations)


def _say(text: str) -> None:
    print(text, file=sys.stderr, flush=True)


def table_of(results: Sequence[Outcome], claims: dict[str, tuple[str, str]]) -> str:
    """Markdown: of each claim, how many mistakes there are and how many were caught."""
    rows = ["| claim | page | mistakes | caught |", "|---|---|---:|---:|"]
    for key, (page, says) in claims.items():
        own = [one.word == "caught" for one in results if one.mutation.claim == key]
        if own:
            rows.append(f"| {says} | {page} | {len(own)} | {sum(own)} |")
    return "\n".join(rows)


def main() -> None:
    """Make the mistakes that were asked for."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("words", nargs="*", help="of name, file or claim; none: all mistakes")
    parser.add_argument("--check", action="store_true", help="say which do not apply; run nothing")
    parser.add_argument("--jobs", type=int, default=2, help="mistakes at a time (2)")
    args = parser.parse_args()
    wanted = [
        one
        for one in mutations_of(ROOT)
        if not args.words or any(w in f"{one.name} {one.file} {one.claim}" for w in args.words)
    ]
    problems = [f"{one.name}: {text}" for one in wanted for text in problems_of(one, ROOT)]
    if problems or args.check or not wanted:
        print("\n".join(problems) or f"{len(wanted)} mistakes apply")
        raise SystemExit(bool(problems) or not wanted)
    began, results = time.monotonic(), []
    with tempfile.TemporaryDirectory(prefix="lightflight-mutants-") as folder:
        for one in outcomes(wanted, Path(folder), args.jobs):
            results.append(one)
            _say(one.line)
    missed = [one for one in results if one.word != "caught"]
    print(table_of(results, claims_of(ROOT)))
    print(f"\n{len(results) - len(missed)} of {len(results)} mistakes were caught", end="")
    print(f" in {(time.monotonic() - began) / 60:.0f} min")
    for one in missed:
        print(f"{one.line}\n    {one.mutation.test}")
    raise SystemExit(bool(missed))


if __name__ == "__main__":
    main()
