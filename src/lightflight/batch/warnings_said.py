"""What the package warns of while a task runs, as texts for the record of its result."""

from __future__ import annotations

import contextlib
import threading
import warnings
from collections.abc import Iterator
from contextlib import contextmanager

from lightflight.errors import LightflightWarning


class _Said(threading.local):
    """Where the warnings of this thread go."""

    lists: tuple[list[str], ...] = ()


_said = _Said()
_listening = threading.Lock()
_n_listeners = 0
_restore = contextlib.ExitStack()


@contextmanager
def caught_warnings() -> Iterator[list[str]]:
    """Collect the warnings that this package gives in this thread, as texts.

    `warnings.catch_warnings` alone would mix up the threads of a worker that has several.
    """
    global _n_listeners  # noqa: PLW0603  (filters are global to the process, and so is their use)
    said: list[str] = []
    with _listening:
        if _n_listeners == 0:
            _restore.enter_context(warnings.catch_warnings())
            # Always ours, since Python would show each but once in a process; never a library's.
            warnings.simplefilter("ignore")
            warnings.simplefilter("always", LightflightWarning)
            warnings.showwarning = _note
        _n_listeners += 1
    _said.lists = (*_said.lists, said)
    try:
        yield said
    finally:
        _said.lists = _said.lists[:-1]
        with _listening:
            _n_listeners -= 1
            if _n_listeners == 0:
                _restore.close()


def _note(message: Warning | str, *_: object, **__: object) -> None:
    """Take down a warning, where this thread has somebody who listens."""
    if _said.lists:
        _said.lists[-1].append(" ".join(str(message).split()))
