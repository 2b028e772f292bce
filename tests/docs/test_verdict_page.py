"""The page about the verdict lists every name once, and the sizes the code judges by."""

from __future__ import annotations

import re

from lightflight.cli.errors import EXIT_CODES, NotTrustedError
from lightflight.path.verdict import FindingName, Level
from lightflight.reconstruct.model.sizes import PLAUSIBLE
from tests.docs.pages import DOCS, ROOT

TEXT = (DOCS / "explanation" / "verdict.md").read_text(encoding="utf-8")
ROWS = {
    cells[0].strip("` "): [cell.strip() for cell in cells[1:]]
    for cells in (line.strip("|").split("|") for line in re.findall(r"^\| `.*\|$", TEXT, re.M))
}


FOUND_AS = {
    "aspect": "focal_length", "axis": "pose", "decentering": "distortion", "codes": "calibration",
    "jump": "calibration",
}  # fmt: skip
"""Names of findings that have more than one kind of size."""


def test_every_name_has_a_row_and_every_row_a_name() -> None:
    assert set(ROWS) == {*map(str, FindingName), *map(str, Level)}
    assert len(re.findall(r"^\| `", TEXT, re.M)) == len(ROWS)


def test_every_row_says_what_it_means_looks_like_and_what_cures_it() -> None:
    for name in FindingName:
        assert len(ROWS[name]) == 4, name
        assert all(ROWS[name]), name


def test_sizes_are_those_of_the_code() -> None:
    for kind, plausible in PLAUSIBLE.items():
        size = f"{plausible.size:g} {plausible.unit}".strip()
        name = FOUND_AS.get(kind, kind.split()[0])
        assert size in ROWS[name][2].split(", "), (kind, size)


def test_the_exit_code_is_that_of_the_command() -> None:
    code = NotTrustedError.exit_code
    assert code in EXIT_CODES
    for level in ("check", "contradicted"):
        assert f"exit code {code} under `--strict`" in ROWS[level][1]
    for page in ("how-to/campaigns.md", "reference/compatibility.md"):
        assert f"code {code}" in (DOCS / page).read_text(encoding="utf-8")


def test_names_that_nothing_finds_are_told_as_such() -> None:
    source = "\n".join(
        file.read_text(encoding="utf-8") for file in (ROOT / "src").rglob("*.py")
        if file.name != "verdict.py"
    )  # fmt: skip
    silent = {name for name in FindingName if f"FindingName.{name.name}" not in source}
    told = re.search(r"^No test finds ([^:]+) yet", TEXT, re.M)
    said = set(re.findall(r"`(\w+)`", told[1] if told else ""))
    assert silent == said, "correct the sentence 'No test finds ... yet' of explanation/verdict.md"
