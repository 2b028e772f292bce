"""An infinite width of the pulse was taken like any other."""

import numpy as np
import pytest

from lightflight.flight import Source


def test_a_pulse_has_a_finite_width():
    with pytest.raises(ValueError, match=r"pulse_fwhm_ps must be .*, got inf"):
        Source(pulse_fwhm_ps=np.inf)
