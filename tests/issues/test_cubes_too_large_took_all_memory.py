"""Counts that do not fit into memory were begun all the same."""

import numpy as np
import pytest

from lightflight.recording.counting import histogram
from lightflight.recording.recording import Recording


def test_a_cube_that_does_not_fit_is_refused_before_memory_is_taken(monkeypatch):
    frames = np.zeros((3, 2, 2), np.uint16)
    monkeypatch.setattr("lightflight.files.filecheck.free_memory_bytes", lambda: 1200)
    with pytest.raises(ValueError, match=r"2 x 2 pixels and 64 codes needs 1.02e-06 GB.*codes="):
        histogram(Recording.from_frames(frames, n_codes=64))
    cut = histogram(Recording.from_frames(frames, n_codes=64), codes=(0, 32))
    assert cut.counts.shape == (2, 2, 32)
