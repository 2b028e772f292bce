"""`check` of a set-up in metres found nothing on a nominal clock: legs seem swift by chance."""

import pytest

import lightflight as lf
from lightflight.path.verdict import FindingName
from lightflight.reconstruct.legs.plausible import implausible

SOURCE, AIR = lf.Source((0.0, 0.0, 0.0)), lf.Medium()


def camera_in(unit_mm):
    return lf.Camera.facing_plane(
        distance_mm=535.0 * unit_mm,
        field_of_view_mm=(245.0 * unit_mm, 245.0 * unit_mm),
        center_mm=(187.5 * unit_mm, 37.5 * unit_mm),
    )


def test_a_picture_that_light_crosses_within_a_hundredth_of_a_code_is_in_metres():
    (found,) = implausible(camera_in(1e-3), SOURCE, AIR, [], code_ps=55.0)
    assert found.name is FindingName.UNITS
    assert "light crosses the whole picture in 0.82 ps" in found.sentence
    assert "0.535 mm from the camera, or 535?" in found.remedy


@pytest.mark.parametrize(("unit_mm", "code_ps"), [(1.0, 55.0), (0.1, 55.0), (1.0, 1500.0),
                                                  (1e-3, 1.5), (1e-3, None)])  # fmt: skip
def test_what_a_clock_can_tell_is_no_slip(unit_mm, code_ps):
    assert not implausible(camera_in(unit_mm), SOURCE, AIR, [], code_ps=code_ps)
