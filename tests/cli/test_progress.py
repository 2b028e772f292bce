"""cli.progress: what a terminal and a file are told while a command works."""

from __future__ import annotations

import io
import re
import time
from contextlib import redirect_stderr
from pathlib import Path

import click
import numpy as np
import pytest

from lightflight import Histograms, fit_pulses
from lightflight.cli import progress
from lightflight.cli.errors import sentence_and_code
from lightflight.cli.progress import forget_written, interrupted, say, step, writing
from lightflight.news import heard_by
from lightflight.timing.pulses import fits


class Terminal(io.StringIO):
    """A stream that says it is one."""

    def isatty(self) -> bool:
        return True


@pytest.fixture
def terminal(monkeypatch):
    monkeypatch.setenv("TERM", "xterm")
    monkeypatch.setenv("COLUMNS", "100")
    return Terminal()


def plain_lines(stream: io.StringIO) -> list[str]:
    """What was written, without what moves the cursor or colours."""
    return re.sub(r"\x1b\[[0-9;?]*[A-Za-z]", "", stream.getvalue()).replace("\r", "\n").split("\n")


def test_a_terminal_is_told_what_how_far_and_how_long_still(terminal, monkeypatch):
    monkeypatch.setattr(progress, "_QUIET_S", 0.1)
    with redirect_stderr(terminal), step("counting a.h5") as report:
        report(1, 4)
        time.sleep(0.4)
    lines = [line for line in plain_lines(terminal) if "counting a.h5" in line]
    assert re.search(r"25 %, about \d+ s left", lines[-1])


def test_news_stand_above_the_bar_and_do_not_cut_it(terminal):
    with redirect_stderr(terminal), step("fitting"):
        say("compiling a kernel ...")
        time.sleep(0.2)
    lines = plain_lines(terminal)
    assert "compiling a kernel ..." in [line.strip() for line in lines]
    assert not [line for line in lines if "compiling" in line and "fitting" in line]
    with redirect_stderr(terminal):
        say("done")
    assert terminal.getvalue().endswith("done\n")


def test_fits_of_pulses_say_how_far_they_are(monkeypatch):
    """Whoever listens in the same context; nobody else does."""
    monkeypatch.setattr(fits, "TILE_CODES", 2_000)
    counts = np.random.default_rng(1).poisson(5.0, (8, 10, 100)).astype(np.uint32)
    counts[:, :, 50:53] += 200
    hist = Histograms(counts, bin_width_ps=50.0)
    for threads in (1, 2):
        heard = []
        with heard_by(lambda done, total: heard.append((done, total))):  # noqa: B023
            fit_pulses(hist, threads=threads)
        assert max(total for _, total in heard) == 80
        assert heard[0][0] < 80
        assert (80, 80) in heard
        n = len(heard)
        fit_pulses(hist, threads=threads)
        assert len(heard) == n


def test_no_guess_is_made_from_the_first_moments():
    assert progress._how_far(1, 100, 0.5) == "1 %"
    assert progress._how_far(0, None, 0.2) == ""
    assert progress._how_far(0, None, 7.0) == "7 s"
    assert progress._how_far(50, 100, 600.0) == "50 %, about 10 min left"


def test_ctrl_c_says_what_was_broken_off_and_what_is_kept():
    forget_written()
    with writing(Path("a.mp4"), verb="filming"):
        pass
    with pytest.raises(KeyboardInterrupt) as caught, writing(Path("b.gif"), verb="filming"):
        raise KeyboardInterrupt
    sentence = "interrupted while filming b.gif: a.mp4 is kept, no half-written file remains"
    assert sentence_and_code(caught.value) == (sentence, 130)
    # As click passes it on.
    aborted = click.Abort()
    aborted.__cause__ = caught.value
    assert interrupted(aborted) == sentence
    forget_written()
    assert interrupted(KeyboardInterrupt()) == "interrupted: no half-written file remains"


def test_the_innermost_step_is_named():
    interruption = pytest.raises(KeyboardInterrupt, match=r"^counting a.h5$")
    with interruption, step("all"), step("counting a.h5"):
        raise KeyboardInterrupt
