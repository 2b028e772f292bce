"""Fixtures shared by all tests, and the one place that knows where real recordings lie."""

from __future__ import annotations

import gc
import importlib
import os
import signal
from pathlib import Path

import hypothesis
import numpy as np
import pytest

hypothesis.settings.register_profile("ci", derandomize=True, deadline=None, database=None)
hypothesis.settings.register_profile("dev", deadline=None)
hypothesis.settings.register_profile("fuzz", deadline=None, max_examples=3000)
hypothesis.settings.load_profile(os.environ.get("HYPOTHESIS_PROFILE", "ci"))

# A shell lets its background jobs ignore Ctrl-C, and with them the children that tests interrupt.
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)

collect_ignore_glob = ["data/*"]  # files of earlier versions, programs among them

_REPOSITORY = Path(__file__).resolve().parents[1]


@pytest.fixture(scope="session")
def data_dir() -> Path:
    """Folder of real recordings made by others: LIGHTFLIGHT_DATA, or ../shared/data.

    They are not part of this repository; a test that asks for them is skipped without them.
    """
    named = os.environ.get("LIGHTFLIGHT_DATA")
    folder = Path(named) if named else _REPOSITORY.parent / "shared" / "data"
    if not folder.is_dir():
        pytest.skip(f"no real recordings at {folder}: set LIGHTFLIGHT_DATA to the folder of them")
    return folder


@pytest.fixture
def rng() -> np.random.Generator:
    """Random numbers, the same in every run."""
    return np.random.default_rng(20200520)


@pytest.fixture
def unexamined(monkeypatch: pytest.MonkeyPatch) -> None:
    """No verdict: it takes half the time of a path, and is proved elsewhere."""
    from tests.labs import without_verdict

    without_verdict(monkeypatch)


@pytest.fixture
def nothing_twice(monkeypatch: pytest.MonkeyPatch) -> None:
    """No mirror and no second pulse is looked for: where all else errs by nothing but the model."""
    from tests.labs import without_second_light

    without_second_light(monkeypatch)


@pytest.fixture
def as_found(monkeypatch: pytest.MonkeyPatch) -> None:
    """No detours, bends and arms instead of a path that the counts contradict, proved elsewhere.

    Most of the time of such a recording goes to them.
    """
    answer = importlib.import_module("lightflight.reconstruct.answer")
    monkeypatch.setattr(answer, "_reconsidered", lambda path, *_: path)


_MANY_TESTS = 1000


def pytest_collection_finish(session: pytest.Session) -> None:
    """Let no collection of garbage look at five thousand tests, hundreds of times.

    A campaign asks for one after each recording: they were a fifth of its tests' time. Not where
    there are few tests: Hypothesis 6.100, the lowest allowed, calls one of them flaky then.
    """
    if len(session.items) > _MANY_TESTS:
        gc.collect()
        gc.freeze()


def pytest_collection_modifyitems() -> None:
    """Give the names of two rooms back to the functions.

    To look for doctests, pytest imports a package by hand and binds it in the one above, which
    Python itself does only once, before `lightflight` frees the name.
    """
    import lightflight

    for name in ("reconstruct", "simulate"):
        vars(lightflight).pop(name, None)
