"""Mistakes on purpose (`tools/mutants.py`): that each can still be made, and that it is noticed."""

from pathlib import Path

import pytest

from tools.mutants import (
    CLAIMS,
    Mutation,
    Outcome,
    claims_of,
    mutations_of,
    outcome_in,
    problems_of,
    table_of,
)

ROOT = Path(__file__).parents[2]
MUTATIONS = mutations_of(ROOT)


def test_every_mistake_can_still_be_made():
    """Where it cannot: change its record in `tests/mutants` with the code, or make another."""
    assert [(one.name, problem) for one in MUTATIONS for problem in problems_of(one, ROOT)] == []


def test_every_claim_has_a_mistake_that_breaks_it():
    claims = claims_of(ROOT)
    assert {one.claim for one in MUTATIONS} == claims.keys()
    for page, says in claims.values():
        assert says in (ROOT / page).read_text("utf-8"), f"{CLAIMS}: {page} does not say: {says}"
    assert len(MUTATIONS) >= 60
    assert len({one.name for one in MUTATIONS}) == len(MUTATIONS)


@pytest.fixture
def tree(tmp_path):
    """A checkout of one function and its test."""
    for name, text in {
        "src/lightflight/__init__.py": "",
        "src/lightflight/law.py": "def twice(x):\n    return 2 * x\n",
        "tests/test_law.py": "from lightflight.law import twice\n\n\n"
        "class TestLaw:\n    def test_twice(self):\n        assert twice(3) == 6\n\n"
        "    def test_of_nothing(self):\n        assert twice(0) == 0\n",
    }.items():
        path = tmp_path / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
    return tmp_path


def mistake(before="2 * x", after="3 * x", test="TestLaw::test_twice", file="law.py"):
    return Mutation("thrice", "law", file, before, after, f"tests/test_law.py::{test}")


@pytest.mark.parametrize(
    ("one", "problem"),
    [
        (mistake(file="lore.py"), "there is no src/lightflight/lore.py"),
        (mistake(before="4 * x"), "holds its text 0 times"),
        (mistake(before="x"), "holds its text 2 times"),
        (mistake(after="2 * x"), "changes nothing"),
        (mistake(after="2 *"), "no Python"),
        (mistake(test="test_twice"), "there is no test"),
        (mistake(test="TestLaw"), "there is no test"),
    ],
)
def test_what_can_not_be_done_is_said(tree, one, problem):
    [said] = problems_of(one, tree)
    assert problem in said


def test_a_mistake_is_caught_or_survives_and_is_taken_back(tree):
    law = tree / "src" / "lightflight" / "law.py"
    text, time = law.read_text(), law.stat().st_mtime_ns
    caught = outcome_in(tree, mistake())
    assert (caught.word, caught.said) == ("caught", "assert 9 == 6")
    assert outcome_in(tree, mistake(test="TestLaw::test_of_nothing")).word == "SURVIVED"
    assert outcome_in(tree, mistake(after="2 * x)[", test="TestLaw::test_twice")).word == "BROKEN"
    assert (law.read_text(), law.stat().st_mtime_ns) == (text, time)


def test_the_table_counts_by_claim():
    done = [Outcome(mistake(), word, 1.0) for word in ("caught", "caught", "SURVIVED")]
    assert table_of(done, {"law": ("README.md", "twice is twice")}).endswith(
        "| twice is twice | README.md | 3 | 2 |"
    )
