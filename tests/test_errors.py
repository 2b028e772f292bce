"""Errors: each is a builtin's child, says its sentence, and has an exit code of its own kind."""

import numpy as np
import pytest

from lightflight import errors

EXIT_CODES = {
    "FileFormatError": (ValueError, 3),
    "ConfigError": (ValueError, 2),
    "LimitError": (ValueError, 3),
    "CalibrationError": (ValueError, 4),
    "GeometryError": (ValueError, 5),
    "NothingFoundError": (ValueError, 5),
    "NotConvergedError": (RuntimeError, 5),
    "MissingExtraError": (ImportError, 2),
}


@pytest.mark.parametrize("name", EXIT_CODES)
def test_callers_need_not_know_us(name):
    parent, code = EXIT_CODES[name]
    error = getattr(errors, name)
    assert issubclass(error, parent)
    assert error.exit_code == code
    assert str(error("what, got, what to do")) == "what, got, what to do"


def test_every_error_is_in_this_table():
    found = {n for n, v in vars(errors).items() if isinstance(v, type) and hasattr(v, "exit_code")}
    assert found == set(EXIT_CODES)


def test_file_error_names_file_and_byte():
    error = errors.FileFormatError("not ours", path="a/b.h5", offset=12)
    assert (error.path, error.offset) == ("a/b.h5", 12)
    assert str(error) == "a/b.h5: not ours (at byte 12)"
    assert str(errors.FileFormatError("not ours")) == "not ours"


def test_geometry_error_carries_the_offenders():
    mask = np.array([True, False])
    assert errors.GeometryError("behind the camera", offenders=mask).offenders is mask
    assert errors.GeometryError("behind the camera").offenders is None


def test_all_warnings_can_be_silenced_at_once():
    for name in ("UncalibratedWarning", "SuspectDataWarning"):
        assert issubclass(getattr(errors, name), errors.LightflightWarning)
    assert issubclass(errors.LightflightWarning, UserWarning)
