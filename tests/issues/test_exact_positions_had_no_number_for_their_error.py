"""Variances of exact positions came out a hair below zero, and their errors as NaN."""

import numpy as np

from tests.path_fakes import PAPER_VERTICES, make_path


def test_exact_positions_have_no_error_rather_than_nan():
    """A corner known to slide along its leg as its time does leaves positions exact."""
    step = PAPER_VERTICES[1] - PAPER_VERTICES[0]
    root = np.zeros((16, 1))
    root[4:7, 0] = step / np.linalg.norm(step) * 0.299792458 / 1.00027
    root[7] = 1.0
    path = make_path(covariance=root @ root.T)
    table = path.sample(4001)
    for name in ("x_std_mm", "y_std_mm", "z_std_mm", "event_time_std_ps"):
        assert np.isfinite(table[name]).all(), name
    on_first_leg = table["leg"] == 0
    assert table["x_std_mm"][on_first_leg].max() < 1e-6
    assert np.isfinite(path.vertex_std).all()
