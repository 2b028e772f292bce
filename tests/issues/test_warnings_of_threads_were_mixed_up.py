"""Warnings of recordings that threads worked on at once came out under each other's names."""

import time
import warnings
from concurrent.futures import ThreadPoolExecutor

import pytest

from lightflight.batch import warnings_said
from lightflight.errors import UncalibratedWarning


def test_warnings_of_threads_are_not_mixed_up():
    def speak(name: str) -> list[str]:
        with warnings_said.caught_warnings() as said:
            for _ in range(20):
                warnings.warn(name, UncalibratedWarning, stacklevel=1)
                warnings.warn("of somebody else", UserWarning, stacklevel=1)
                time.sleep(0.0005)
        return said

    filters = list(warnings.filters)
    with ThreadPoolExecutor(4) as pool:
        names = [f"thread {k}" for k in range(8)]
        assert list(pool.map(speak, names)) == [[name] * 20 for name in names]
    assert warnings.filters == filters
    with pytest.warns(UncalibratedWarning, match="again"):
        warnings.warn("again", UncalibratedWarning, stacklevel=1)
