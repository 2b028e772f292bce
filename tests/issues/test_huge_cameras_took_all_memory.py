"""A camera of a damaged file, 2^40 rows high, was given a table of its pixels."""

import numpy as np
import pytest

from lightflight.recording.counting import histogram
from lightflight.recording.recording import Recording


def test_a_camera_too_large_to_look_up_is_refused_in_a_sentence():
    photons = np.zeros(3, np.uint16)
    huge = Recording((2**40, 4), n_codes=8, pixel=photons, code=photons)
    with pytest.raises(ValueError, match="see whether its shape is right"):
        histogram(huge, rows=(0, 1))
