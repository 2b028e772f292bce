"""The names outside code relies on, loaded lazily, in any order."""

import importlib
import inspect
import pkgutil
import subprocess
import sys

import pytest

import lightflight as lf

CONTRACT = (
    "Histograms", "Recording", "read", "write", "histogram", "calibrate_timing",
    "TimingCalibration", "calibrate_camera", "Camera", "Source", "Medium", "fit_pulses",
    "find_arrivals", "Arrivals", "Pulses", "find_legs", "reconstruct", "LightPath", "Scene",
    "Detector", "simulate", "bounds", "Bounds", "path_error",
)  # fmt: skip


@pytest.mark.parametrize("name", CONTRACT)
def test_every_contract_name_is_there_and_listed(name):
    thing = getattr(lf, name)
    assert callable(thing)
    assert name in dir(lf)
    assert name in lf.__all__
    assert inspect.isclass(thing) == name[0].isupper()


def test_names_can_be_called_after_every_submodule_is_imported():
    for module in pkgutil.walk_packages(lf.__path__, "lightflight."):
        if not module.name.endswith("__main__"):
            importlib.import_module(module.name)
    for name in CONTRACT:
        assert callable(getattr(lf, name)), name


def test_no_file_is_private_by_its_name_but_those_that_no_list_could_name():
    modules = [module.name for module in pkgutil.walk_packages(lf.__path__, "lightflight.")]
    marked = {part for name in modules for part in name.split(".") if part.startswith("_")}
    assert marked - {"__main__"} == {"_kernels", "_lazy", "_moved", "_version"}


def test_a_submodule_of_the_same_name_passes_calls_on():
    from lightflight.simulate import presets

    assert inspect.ismodule(presets)
    from lightflight.recording.counting import histogram

    assert inspect.signature(lf.histogram) == inspect.signature(histogram)
    with pytest.raises(TypeError, match="histogram"):
        lf.histogram()  # type: ignore[call-arg]


@pytest.mark.parametrize("name", ["simulate", "reconstruct"])
@pytest.mark.parametrize(
    "first",
    [
        "import lightflight.{}",
        pytest.param("from lightflight import {}", marks=pytest.mark.long),
        "pass",
    ],
)
def test_same_name_in_a_fresh_interpreter(name, first):
    code = f"{first.format(name)}\nimport lightflight as lf\nassert callable(lf.{name})"
    subprocess.run([sys.executable, "-c", code], check=True)


def test_an_unknown_name_is_an_attribute_error():
    with pytest.raises(AttributeError, match="no attribute 'reconstuct'"):
        lf.reconstuct  # noqa: B018


def test_version_is_the_installed_one():
    from importlib.metadata import version

    assert lf.__version__ == version("lightflight")


def test_options_are_keyword_only():
    for name in ("simulate", "reconstruct", "calibrate_timing", "fit_pulses", "find_arrivals"):
        function = inspect.unwrap(getattr(lf, name))
        kinds = [p.kind for p in inspect.signature(function).parameters.values()]
        positional = [k for k in kinds if k is inspect.Parameter.POSITIONAL_OR_KEYWORD]
        assert len(positional) <= 1, name
