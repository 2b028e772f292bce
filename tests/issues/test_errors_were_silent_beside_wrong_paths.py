"""Wrong paths with small stated errors: the verdict must name each, or the path be right."""

import warnings

import numpy as np
import pytest

import lightflight as lf
from lightflight.errors import GeometryError, NothingFoundError, SuspectDataWarning
from lightflight.simulate.presets import ideal
from tests.labs import three_legs

CENTRE = np.array([187.5, 37.5, 535.0])
CAMERA = lf.Camera.facing_plane(center_mm=(187.5, 37.5))


def path_of(vertices, seed, **told):
    source = lf.Source(vertices[0], emission_time_ps=2000.0, pulse_fwhm_ps=68.0)
    detector = ideal(psf_std_px=0.35, active_width_px=0.122)
    scene = lf.Scene(vertices, camera=CAMERA, source=source, detector=detector)
    hist = lf.simulate(scene, photons_per_pixel=40_000, seed=seed)
    clock = lf.TimingCalibration.nominal(hist)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", SuspectDataWarning)
        try:
            return lf.reconstruct(hist, camera=CAMERA, source=source, timing=clock, **told)
        except (GeometryError, NothingFoundError):
            return None


def along_the_line_of_sight(seed):
    """Three legs, the middle one within 3 degrees of the line of sight."""
    rng = np.random.default_rng([9, seed])
    first = np.array([*(CENTRE[:2] + rng.uniform(-80, 80, 2)), rng.uniform(-60, 20)])
    ray = (CENTRE - first) / np.linalg.norm(CENTRE - first)
    off = np.radians(rng.uniform(1.0, 3.0))
    aside = np.cross(ray, rng.normal(size=3))
    towards = np.cos(off) * ray + np.sin(off) * aside / np.linalg.norm(aside)
    second = first + (1 if seed % 2 else -1) * rng.uniform(80, 150) * towards
    start, end = (0, rng.uniform(-20, 60), 0), (375, rng.uniform(-30, 100), 30)
    return np.array([start, first, second, end], dtype=float)


@pytest.mark.parametrize(
    ("seed", "n_legs"),
    [
        pytest.param(0, None, marks=pytest.mark.long),
        *(pytest.param(n, 3, marks=pytest.mark.long) for n in (1, 2)),
        (13, 3),
    ],
)
def test_a_leg_along_the_line_of_sight_is_right_or_named(seed, n_legs):
    """It was once 110 mm off, stated 0.08. Where three legs are told and two show, all counts may
    pass (seeds 1 and 13 of 24: 99 and 170 mm off): the number itself is then to be checked."""
    vertices = along_the_line_of_sight(seed)
    path = path_of(vertices, seed, n_legs=n_legs)
    if path is None or path.verdict.level != "trust":
        return
    assert path.n_legs == 3
    miss = np.linalg.norm((path.vertices_mm - vertices)[1:-1], axis=1)
    assert (miss < 5.0 * np.linalg.norm(path.vertex_std[1:-1, :3], axis=1)).all()


def test_a_leg_out_of_the_picture_is_never_trusted():
    """It gave six legs, 253 mm off, stated 0.2 to 2.4."""
    vertices = [(0, 0, 0), (375, 20, 50), (370, 230, 0), (0, 220, 20), (-10, 50, 10), (375, 60, 40)]
    path = path_of(np.array(vertices, dtype=float), 3)
    assert path is None or path.verdict.level != "trust"


@pytest.mark.long
def test_one_leg_told_for_three_says_what_it_leaves_out():
    """143 of 222 pulses were ignored without a word."""
    lab = three_legs()
    with pytest.warns(SuspectDataWarning):
        path = lf.reconstruct(
            lab.recording(4, 4_000.0),
            camera=lab.camera,
            source=lab.known,
            timing=lab.timing,
            n_legs=1,
        )
    assert path.verdict.level == "contradicted"
    assert path.explained.n_pulses < 0.5 * path.explained.n_found


@pytest.mark.filterwarnings("ignore::lightflight.errors.UncalibratedWarning")
def test_statements_of_an_unknown_source_are_the_errors_of_the_file():
    """A statement of +-4,712 mm stood beside a file that said +-1.85."""
    lab = three_legs()
    hist = lab.recording(4)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", SuspectDataWarning)
        path = lf.reconstruct(hist, camera=lab.camera)
    largest = np.sqrt([np.linalg.eigvalsh(path.covariance[k : k + 3, k : k + 3])[-1]
                       for k in range(0, 4 * len(path.vertices_mm), 4)])  # fmt: skip
    hardly = [line for line in path.statements if "hardly fixed" in line and "mm)" in line]
    for line in hardly:
        stated = float(line.partition("± ")[2].partition(" mm")[0].replace(",", ""))
        assert stated < 1.5 * largest.max()
