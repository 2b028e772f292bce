import pytest
from hypothesis import given, strategies as st

from lightflight.errors import ConfigError
from lightflight.files import toml_tables as config
from lightflight.files.toml_tables import (
    Key,
    checked_sections,
    checked_table,
    nearest_name,
    override_table,
    table_from_toml,
    value_from_text,
)

KEYS = (
    Key("distance_mm", "camera to plane", config.number),
    Key("shape", "rows and columns", config.integers(2)),
    Key("field_of_view_mm", "width and height", config.numbers(2)),
)


def check(table):
    return checked_table(table, KEYS, section="camera", where="lab.toml")


def test_values_come_out_in_the_form_the_records_take():
    table = {"distance_mm": 535, "shape": [32, 32], "field_of_view_mm": [245, 245.5]}
    assert check(table) == {
        "distance_mm": 535.0,
        "shape": (32, 32),
        "field_of_view_mm": (245.0, 245.5),
    }


@pytest.mark.parametrize(
    ("wrong", "meant"),
    [
        ("distance", "distance_mm"),
        ("distance_cm", "distance_mm"),
        ("Shape", "shape"),
        ("fov_mm", "field_of_view_mm"),
    ],
)
def test_an_unknown_key_names_the_nearest_one(wrong, meant):
    with pytest.raises(
        ConfigError, match=rf"lab.toml: unknown key '{wrong}' in \[camera\].*{meant}"
    ):
        check({wrong: 1})


def test_a_key_like_no_other_lists_them_all():
    with pytest.raises(ConfigError, match="distance_mm, shape, field_of_view_mm"):
        check({"zzz": 1})


@pytest.mark.parametrize(
    ("key", "value", "wish"),
    [
        ("distance_mm", "535", "a number"),
        ("distance_mm", True, "a number"),
        ("distance_mm", float("nan"), "a number"),
        ("shape", [32.0, 32.0], "whole number"),
        ("shape", [32], "2 whole numbers"),
        ("field_of_view_mm", 245, "2 numbers"),
        ("field_of_view_mm", [245, "wide"], "2 numbers"),
    ],
)
def test_a_value_of_the_wrong_form_is_named(key, value, wish):
    with pytest.raises(ConfigError, match=rf"lab.toml: \[camera\] {key} must be .*{wish}.*got"):
        check({key: value})


def test_sections():
    sections = {"camera": KEYS, "medium": (Key("path_group_index", "n_p", config.number),)}
    assert checked_sections({"camera": {}}, sections, where="x") == {"camera": {}}
    with pytest.raises(ConfigError, match=r"x: unknown section 'cammera'; did you mean 'camera'"):
        checked_sections({"cammera": {}}, sections, where="x")
    with pytest.raises(ConfigError, match=r"x: 'distance_mm' must stand under \[camera\]"):
        checked_sections({"distance_mm": 5}, sections, where="x")
    with pytest.raises(ConfigError, match=r"'camera' must be a section"):
        checked_sections({"camera": 5}, sections, where="x")


def test_either_lists_what_is_allowed():
    per_axis = config.either(config.number, config.numbers(3))
    assert per_axis(1) == 1.0
    assert per_axis([1, 2, 3]) == (1.0, 2.0, 3.0)
    with pytest.raises(ValueError, match="must be a number or a list of 3 numbers"):
        per_axis("far")


def test_choice_flag_text_and_tables():
    assert config.choice("a", "b")("a") == "a"
    with pytest.raises(ValueError, match="one of 'a', 'b'"):
        config.choice("a", "b")("c")
    assert config.flag(False) is False
    with pytest.raises(ValueError, match="true or false"):
        config.flag(0)
    with pytest.raises(ValueError, match="text in quotes"):
        config.text(3)
    square = config.table_of_numbers(2, rows=2)
    assert square([[1, 2], [3, 4]]) == ((1.0, 2.0), (3.0, 4.0))
    for wrong in ([[1, 2]], [[1, 2], [3]], 7, [[1, 2], ["a", 4]]):
        with pytest.raises(ValueError, match="2 rows of 2 numbers"):
            square(wrong)


def test_missing_foreign_and_broken_files(tmp_path):
    with pytest.raises(ConfigError, match="no such set-up file"):
        table_from_toml(tmp_path / "lab.toml")
    broken = tmp_path / "broken.toml"
    broken.write_text("[camera]\ndistance_mm 535\n")
    with pytest.raises(ConfigError, match=r"broken.toml: is not valid TOML: .*line 2"):
        table_from_toml(broken)
    binary = tmp_path / "recording.h5"
    binary.write_bytes(b"\x89HDF\r\n\x1a\n\xff\xfe")
    with pytest.raises(ConfigError, match="not a text file"):
        table_from_toml(binary)
    with pytest.raises(ConfigError, match="cannot be read"):
        table_from_toml(tmp_path)


def test_assignments_lie_over_the_file_and_leave_it_alone():
    table = {"source": {"position_mm": [0, 0, 0]}}
    changed = override_table(
        table,
        [
            "source.position_mm=[1.5, 0, 0]",
            "medium.path_group_index = 1.47",
            "timing.dead_codes=lost",
        ],
    )
    assert changed == {
        "source": {"position_mm": [1.5, 0, 0]},
        "medium": {"path_group_index": 1.47},
        "timing": {"dead_codes": "lost"},
    }
    assert table == {"source": {"position_mm": [0, 0, 0]}}


@pytest.mark.parametrize("text", ["source", "source=1", "=1", ".a=1", "source.=1"])
def test_an_assignment_of_another_form_says_how(text):
    with pytest.raises(ConfigError, match=r"write section\.key=value"):
        override_table({}, [text])


def test_an_assignment_cannot_go_under_a_value():
    with pytest.raises(ConfigError, match="not a section"):
        override_table({"a": 1}, ["a.b=2"])


@pytest.mark.parametrize(
    ("text", "value"),
    [("55", 55), ("55.5", 55.5), ("true", True), ("[1, 2]", [1, 2]), ("tyx", "tyx"), ('"a"', "a")],
)
def test_values_on_the_command_line(text, value):
    assert value_from_text(text) == value


@given(st.text(max_size=30))
def test_any_text_is_some_value_or_itself(text):
    value = value_from_text(text)
    assert not isinstance(value, str) or value.strip() == value or value in text


@given(st.text(max_size=12))
def test_the_nearest_name_is_a_valid_one(name):
    assert nearest_name(name, ["distance_mm", "shape"]) in {None, "distance_mm", "shape"}
