"""Long work tells how far it is to whoever listens, as a rule nobody."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar

Listener = Callable[[int, int], None]
"""Called with (done, in all)."""


def _nobody(_done: int, _total: int) -> None:
    pass


_listener: ContextVar[Listener] = ContextVar("_listener", default=_nobody)


@contextmanager
def heard_by(listener: Listener) -> Iterator[None]:
    """Have work in this context tell `listener` how far it is.

    Parameters
    ----------
    listener : callable
        Called with (done, in all), from the thread that asked for `listener()`.
    """
    token = _listener.set(listener)
    try:
        yield
    finally:
        _listener.reset(token)


def listener() -> Listener:
    """Who listens in this context; asked for once, before a loop.

    Returns
    -------
    callable
        To be called with (done, in all) now and then.
    """
    return _listener.get()
