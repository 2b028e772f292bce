"""`lightflight view` and `plot`: what they write, and what they refuse."""

from __future__ import annotations

import json
import re

import numpy as np
import pytest

from lightflight.path.light_path import LightPath
from tests.cli.conftest import lines_said
from tests.files.unsealed import unsealed
from tests.view import fakes


@pytest.fixture(scope="session")
def path_file(tmp_path_factory):
    file = tmp_path_factory.mktemp("paths") / "path.h5"
    fakes.fake_path().save(file)
    return file


def payload_of(page):
    text = page.read_text(encoding="utf-8")
    return json.loads(re.search(r'application/json">(.*?)</script>', text, re.S)[1])


def test_view_writes_the_page_beside_the_path(run, path_file):
    done = run("view", path_file, "--title", "My <beam>")
    assert done.exit_code == 0, done.stderr
    page = path_file.with_suffix(".html")
    payload = payload_of(page)
    assert payload["title"] == "My <beam>"
    np.testing.assert_array_equal(
        payload["path"]["vertices_mm"], LightPath.load(path_file).vertices_mm
    )


def test_view_takes_recording_and_clock(run, lab_folder, path_file, tmp_path):
    done = run(
        "view", path_file, "--recording", lab_folder / "recording.h5",
        "--timing", lab_folder / "calibration.h5", "-o", tmp_path / "page.html",
    )  # fmt: skip
    assert done.exit_code == 0, done.stderr
    payload = payload_of(tmp_path / "page.html")
    assert payload["histograms"]["left_out"] == 0
    assert payload["clock"]["reversed_codes"] is True


@pytest.fixture
def newer_file(path_file, tmp_path):
    """A path as a version of the future might write it: a schema that nobody here knows."""
    newer = tmp_path / "newer.h5"
    newer.write_bytes(path_file.read_bytes())
    with unsealed(newer) as file:
        file.attrs["schema_version"] = 99
        file["something_new"] = [1.0, 2.0]
    return newer


def test_numbers_of_a_newer_version_are_refused_in_a_sentence(run, newer_file):
    done = run("export", newer_file, "-o", newer_file.with_suffix(".csv"))
    assert done.exit_code == 3
    assert "newer lightflight (schema 99" in done.stderr
    assert [file.name for file in newer_file.parent.iterdir()] == ["newer.h5"]


def test_the_page_of_a_newer_version_opens_and_says_so(run, newer_file):
    page = newer_file.with_suffix(".html")
    done = run("view", newer_file, "-o", page)
    assert done.exit_code == 0, done.stderr
    assert "newer lightflight (schema 99" in page.read_text(encoding="utf-8")


@pytest.mark.parametrize(
    ("words", "suffix"),
    [(("movie", "--pace", 9000, "--fps", 10, "--size", "320x240"), ".gif"), (("plot",), ".png")],
)
def test_pictures_of_a_newer_version_are_drawn(run, newer_file, words, suffix):
    command, *options = words
    output = newer_file.with_suffix(suffix)
    done = run(command, newer_file, *options, "-o", output)
    assert done.exit_code == 0, done.stderr
    assert output.stat().st_size > 1000


def test_a_campaign_with_a_path_of_a_newer_version_shows_the_others(run, path_file, tmp_path):
    newer = tmp_path / "newer.h5"
    newer.write_bytes(path_file.read_bytes())
    with unsealed(newer) as file:
        file.attrs["schema_version"] = 99
    done = run("view", path_file, newer, "-o", tmp_path / "index.html")
    assert done.exit_code == 0, done.stderr
    text = (tmp_path / "index.html").read_text()
    assert text.count("<svg") == 1
    assert "schema 99" in text


def test_view_and_movie_take_a_second_viewpoint(run, path_file, tmp_path):
    done = run("view", path_file, "--viewpoint", 900, 40, 30, "-o", tmp_path / "page.html")
    assert done.exit_code == 0, done.stderr
    second = payload_of(tmp_path / "page.html")["second"]
    assert second["camera"]["center_mm"] == [900.0, 40.0, 30.0]
    small = ("--pace", 9000, "--fps", 10, "--size", "320x240")
    for name, words in (("own", ()), ("other", ("--viewpoint", 900, 40, 30))):
        done = run("movie", path_file, *small, *words, "-o", tmp_path / f"{name}.gif")
        assert done.exit_code == 0, done.stderr
    assert (tmp_path / "own.gif").read_bytes() != (tmp_path / "other.gif").read_bytes()


@pytest.mark.parametrize("command", ["view", "movie"])
def test_a_viewpoint_in_the_path_or_two_at_once_is_refused(run, path_file, tmp_path, command):
    output = tmp_path / ("a.html" if command == "view" else "a.gif")
    done = run(command, path_file, "--viewpoint", 187, 37, 25, "-o", output)
    assert done.exit_code == 5
    assert "further away" in done.stderr
    lab = tmp_path / "lab.toml"
    lab.write_text("[camera]\ndistance_mm = 535.0\nfield_of_view_mm = [245.0, 245.0]\n")
    both = ("--viewpoint", 900, 40, 30, "--from-lab-camera", "--lab", lab)
    done = run(command, path_file, *both, "-o", output)
    assert done.exit_code == 2
    assert "exclude" in done.stderr
    assert not output.exists()


def test_view_of_many_gives_an_index_that_survives_a_bad_file(run, path_file, tmp_path):
    bad = tmp_path / "<b>bad.h5"
    bad.write_bytes(b"nothing")
    other = tmp_path / "other.h5"
    fakes.fake_path(seed=2).save(other)
    done = run("view", path_file, bad, other, "-o", tmp_path / "index.html")
    assert done.exit_code == 0, done.stderr
    text = (tmp_path / "index.html").read_text()
    assert text.count("<svg") == 2
    assert "&lt;b&gt;bad.h5" in text
    assert "<b>" not in text
    for link in re.findall(r'href="([^"]+)"', text):
        assert (tmp_path / link).exists()


def test_a_page_of_a_campaign_is_made_whole(run, path_file, tmp_path):
    done = run("view", path_file, path_file, "-o", tmp_path / "index.html")
    assert done.exit_code == 0, done.stderr
    page = tmp_path / "index_pages" / "0002.html"
    done = run("view", page, "-o", tmp_path / "whole.html")
    assert done.exit_code == 0, done.stderr
    assert payload_of(tmp_path / "whole.html") == payload_of(page)
    assert "page.js" not in (tmp_path / "whole.html").read_text("utf-8")
    run("view", page)
    assert page.with_name("0002_whole.html").read_bytes() == (tmp_path / "whole.html").read_bytes()
    for words, sentence in (
        ((page, page), "made whole alone"),
        ((page, "--title", "x"), "no options but -o and --open"),
        ((tmp_path / "index.html",), "is no page of a path"),
    ):
        done = run("view", *words, "-o", tmp_path / "no.html")
        assert done.exit_code != 0
        assert sentence in done.stderr
        assert not (tmp_path / "no.html").exists()


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (("view", "{path}", "-o", "page.pdf"), "must end in .html"),
        (("plot", "{path}", "--what", "gain", "-o", "a.png"), "holds a path"),
        (("plot", "{path}", "-o", "a.txt"), "must end in"),
        (("plot", "{recording}", "--what", "pixel", "-o", "a.png"), "--pixel ROW COLUMN"),
        (
            ("plot", "{recording}", "--what", "pixel", "--pixel", "3", "99", "-o", "a.png"),
            "32 x 32",
        ),
    ],
)
def test_wrong_calls_are_refused_in_a_sentence(run, path_file, lab_folder, words, sentence):
    given = {"path": path_file, "recording": lab_folder / "recording.h5"}
    done = run(*(word.format(**given) for word in words))
    assert done.exit_code == 2
    assert sentence in done.stderr
    assert len(lines_said(done)) == 1


@pytest.mark.parametrize("what", ["summary", "space", "times", "errors", "residuals", "pulls"])
def test_plot_draws_figures_of_a_path(run, path_file, tmp_path, what):
    done = run("plot", path_file, "--what", what, "-o", tmp_path / "f.png", "--dpi", 60)
    assert done.exit_code == 0, done.stderr
    assert (tmp_path / "f.png").read_bytes().startswith(b"\x89PNG")


def test_plot_draws_a_calibration_and_a_recording(run, lab_folder, tmp_path):
    done = run("plot", lab_folder / "calibration.h5", "-o", tmp_path / "clock.svg")
    assert done.exit_code == 0, done.stderr
    assert "phases" in (tmp_path / "clock.svg").read_text()
    timing = lab_folder / "calibration.h5"
    for what in ("picture", "cases"):
        done = run(
            "plot", lab_folder / "recording.h5", "--timing", timing, "--what", what,
            "-o", tmp_path / f"{what}.pdf",
        )  # fmt: skip
        assert done.exit_code == 0, done.stderr
        assert (tmp_path / f"{what}.pdf").read_bytes().startswith(b"%PDF")


def test_movie_films_a_path_and_a_recording(run, path_file, lab_folder, tmp_path):
    done = run(
        "movie", path_file, "--pace", 9000, "--fps", 10, "--size", "320x240",
        "-o", tmp_path / "flight.gif",
    )  # fmt: skip
    assert done.exit_code == 0, done.stderr
    assert (tmp_path / "flight.gif").read_bytes().startswith(b"GIF89a")
    done = run(
        "movie", lab_folder / "recording.h5", "--slice-codes", 12, "--size", "320x240",
        "-o", tmp_path / "recording.gif",
    )  # fmt: skip
    assert done.exit_code == 0, done.stderr
    assert (tmp_path / "recording.gif").read_bytes().startswith(b"GIF89a")


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (("--size", "320*240"), "WIDTHxHEIGHT"),
        (("--size", "321x240"), "even"),
        (("--from-lab-camera",), "--lab with [camera]"),
    ],
)
def test_films_that_cannot_be_made_are_refused(run, path_file, tmp_path, words, sentence):
    done = run("movie", path_file, *words, "-o", tmp_path / "a.gif")
    assert done.exit_code == 2
    assert sentence in done.stderr
    assert list(tmp_path.iterdir()) == []


def test_export_writes_every_format(run, path_file, tmp_path):
    pytest.importorskip("pyarrow")
    files = [tmp_path / f"path.{kind}" for kind in ("csv", "parquet", "mat", "vtu", "glb")]
    done = run("export", path_file, *(word for file in files for word in ("-o", file)))
    assert done.exit_code == 0, done.stderr
    assert all(file.stat().st_size > 1000 for file in files)


def test_export_of_something_else_is_refused(run, tmp_path):
    (tmp_path / "a.h5").write_bytes(b"nothing")
    done = run("export", tmp_path / "a.h5", "-o", tmp_path / "a.csv")
    assert done.exit_code == 3
    assert "a.h5" in done.stderr
    done = run("export", tmp_path / "a.h5", "-o", tmp_path / "a.xlsx")
    assert done.exit_code == 2
    assert [file.name for file in tmp_path.iterdir()] == ["a.h5"]
