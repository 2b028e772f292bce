"""A straight fibre of a real recording was parted into two legs, 80 degrees apart.

Its times scatter by seven times what their errors say. The longer path took 572 of 838 pulses, and
explained worse those that both took (chi-square 1,960 for 1,652): it won by what the others had
cost, which it dropped.
"""

from __future__ import annotations

from types import SimpleNamespace

import h5py
import numpy as np
import pytest

import lightflight as lf
from lightflight.reconstruct.trials import revise


def fit_of(sighting_of, index, residual_ps, chi2):
    n = len(index)
    return SimpleNamespace(
        sighting_of=np.array(sighting_of),
        times=SimpleNamespace(index=np.array(index), weight=np.ones(n), weights=lambda _: 1.0),
        solution=SimpleNamespace(residual_ps=np.array(residual_ps), chi2=chi2),
        kinks_chi2=0.0,
        floor_ps=0.0,
    )


def test_what_is_dropped_is_no_gain():
    """Two recordings of three pulses; the longer path drops one, of cost 100, for no gain."""
    residual_ps = [1.0, 10.0, 1.0, 2.0, 1.0, 1.0]
    shorter = fit_of([0, 0, 0, 1, 1, 1], [0, 1, 2, 0, 1, 2], residual_ps, 108.0)
    longer = fit_of([0, 0, 1, 1, 1], [0, 2, 0, 1, 2], np.delete(residual_ps, 1), 8.0)
    assert revise._worth(shorter, longer) == -1.0
    better = fit_of([0, 0, 1, 1, 1], [0, 2, 0, 1, 2], np.ones(5), 5.0)
    assert revise._worth(shorter, better) == 2.0


@pytest.mark.long
@pytest.mark.filterwarnings("ignore::lightflight.errors.LightflightWarning")
def test_a_straight_fibre_is_one_leg(data_dir):
    file = data_dir / "lift-fiber" / "lift_derived.h5"
    if not file.is_file():
        pytest.skip(f"{file} is not there")
    with h5py.File(file) as whole:
        cube = whole["LinearFiber/cube_t_y_x"][()]
    # Fits of rows without light take a third of the time.
    cube[:, :10] = 0
    cube[:, 56:] = 0
    hist = lf.Histograms(np.moveaxis(cube, 0, 2), bin_width_ps=1.5, poisson=False)
    camera = lf.Camera.facing_plane(
        shape=hist.shape, distance_mm=400.0, field_of_view_mm=(60.0, 60.0)
    )
    path = lf.reconstruct(hist, camera=camera, source=lf.Source(), medium=lf.Medium(1.47, 1.00027))
    assert path.n_legs == 1
    assert str(path.verdict.level) == "contradicted"
