"""A client that was refused stopped its loop at any later collection: a hang of its successor.

Collected while the next client started its own loop, it waited for the lock that this one held: a
deadlock of one thread, or of two until `assert loop is not None` after ten seconds.
"""

from __future__ import annotations

import gc
import threading

import pytest

from lightflight.batch import cluster
from lightflight.errors import ConfigError

distributed = pytest.importorskip("distributed")


def _clients() -> list[object]:
    return [one for one in gc.get_objects() if type(one) is distributed.Client]


def test_a_refused_client_is_gone_before_the_next_one_starts(tmp_path):
    threads, clients = threading.active_count(), len(_clients())
    gc.disable()  # so that no other collection does it
    try:
        for _ in range(3):
            with (
                pytest.raises(ConfigError, match="see --tls"),
                cluster.workers(scheduler="tls://127.0.0.1:9", scratch=tmp_path),
            ):
                pytest.fail("must not get here")
            assert len(_clients()) == clients
            assert threading.active_count() == threads
    finally:
        gc.enable()
