"""The page as text: self-contained, safe whatever its metadata hold, readable without scripts."""

from __future__ import annotations

import base64
import gzip
import json
import re
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from lightflight import Histograms
from lightflight.errors import FileFormatError
from lightflight.files.json_values import json_value
from lightflight.path.light_path import LightPath
from lightflight.view.page import build, page_html, parts, write_page
from lightflight.view.page.histograms import histogram_blob
from lightflight.view.page.packing import packed
from lightflight.view.page.payload import json_for_html, payload_from_records
from tests.view import fakes

HOSTILE = (
    "</script><script>window.hacked=1</script>",
    "<img src=x onerror=window.hacked=2>",
    "<!--<script>",
    "--></title><svg onload=window.hacked=3>",
    "\u2028\u2029{{STYLE}}{{PAYLOAD}}&lt;b&gt; \" ' ` ${window.hacked=4}",
)


class Reader(HTMLParser):
    """Tags, attributes and text of a page, scripts apart."""

    def __init__(self) -> None:
        super().__init__()
        self.tags: list[tuple[str, dict[str, str | None]]] = []
        self.words: list[str] = []
        self.scripts: list[str] = []
        self._in_script = False

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append((tag, dict(attrs)))
        self._in_script = tag == "script"

    def handle_endtag(self, tag: str) -> None:
        if tag == "script":
            self._in_script = False

    def handle_data(self, data: str) -> None:
        (self.scripts if self._in_script else self.words).append(data)


def read(text: str) -> Reader:
    reader = Reader()
    reader.feed(text)
    return reader


def unpacked(part: dict[str, Any]) -> Any:
    raw = base64.b64decode(part["base64"])
    return np.frombuffer(raw, dtype=f"<{part['kind']}").reshape(part["shape"])


def hostile_path() -> Any:
    return replace(
        fakes.fake_path(),
        prior=HOSTILE[0],
        statements=HOSTILE,
        provenance={HOSTILE[0]: list(HOSTILE), "nested": {HOSTILE[1]: HOSTILE[3]}},
        method=HOSTILE[1],
    )


@pytest.fixture(scope="module")
def paper_page() -> str:
    return page_html(fakes.fake_path())


def test_the_page_of_the_papers_scene_is_small_and_asks_for_nothing(paper_page: str) -> None:
    assert len(paper_page.encode()) < 300_000
    reader = read(paper_page)
    for tag, attributes in reader.tags:
        assert tag not in ("link", "iframe", "object", "embed", "base", "img"), tag
        for name in ("src", "href", "action", "data"):
            assert (attributes.get(name) or "#").startswith("#"), (tag, attributes)
    policy = next(a["content"] for t, a in reader.tags if t == "meta" and "http-equiv" in a)
    assert str(policy).startswith("default-src 'none'")


def test_it_needs_neither_webgl_nor_evaluated_text(paper_page: str) -> None:
    for word in ("webgl", "eval(", "new Function", "innerHTML"):
        assert word not in paper_page


def test_where_it_comes_from_is_said_in_words() -> None:
    path = replace(
        fakes.fake_path(),
        provenance={
            "made_utc": "2026-01-02",
            "inputs": [{"name": "run.h5", "bytes": 12}],
            "settings": {"camera": {"matrix": [[34.5, 0.0], [0.0, 1.0]]}, "dark_rate_hz": 50.0},
            "seed": None,
        },
    )
    text = page_html(path)
    words = " ".join(" ".join(read(text).words).split())
    section = words[words.index("Where this comes from") :]
    for said in (
        "made (UTC) 2026-01-02", "name run.h5", "size (bytes) 12", "matrix 34.5, 0; 0, 1",
        "dark rate (Hz) 50", "seed none",
    ):  # fmt: skip
        assert said in section
    assert not set('{}[]"') & set(section.partition("Scripts are off")[0])


def test_every_script_that_runs_is_named_by_the_policy(paper_page: str) -> None:
    reader = read(paper_page)
    policy = next(a["content"] for t, a in reader.tags if t == "meta" and "http-equiv" in a)
    scripts = [a for t, a in reader.tags if t == "script"]
    assert [a.get("type") for a in scripts] == ["application/json", None]
    assert "\r" not in "".join(reader.scripts)
    hashes = re.findall(r"'sha256-[^']+'", str(policy))
    assert hashes == [parts.script_hash(reader.scripts[-1])]
    assert "unsafe-eval" not in str(policy)
    assert "script-src 'sha256-" in str(policy)


def test_hostile_metadata_stay_text() -> None:
    text = page_html(hostile_path(), title=HOSTILE[3])
    reader = read(text)
    plain_reader = read(page_html(fakes.fake_path()))
    assert [t for t, _ in reader.tags if t == "script"] == ["script"] * 2
    # Only list items may have been added, and nothing carries a handler.
    kinds = {t for t, _ in reader.tags} - {t for t, _ in plain_reader.tags}
    assert kinds == set()
    assert not any(name.startswith("on") for _, a in reader.tags for name in a)
    words = "".join(reader.words)
    for sentence in HOSTILE:
        assert sentence in words
    payload = json.loads(re.search(r'application/json">(.*?)</script>', text, re.S)[1])  # type: ignore[index]
    assert payload["words"]["statements"] == list(HOSTILE)


@pytest.mark.parametrize("value", HOSTILE)
def test_json_cannot_leave_its_element(value: str) -> None:
    text = json_for_html({value: [value]})
    assert not set("<>&\u2028\u2029") & set(text)
    assert json.loads(text) == {value: [value]}


def test_metadata_of_any_kind_become_json() -> None:
    odd = {
        1: np.float64(np.nan),
        "a": np.arange(3),
        "b": {np.int64(4): Path("x")},
        "c": (np.inf, True, None, {2.5}),
        "d": complex(1, 2),
    }
    assert json.loads(json.dumps(json_value(odd), allow_nan=False)) == {
        "1": None,
        "a": [0, 1, 2],
        "b": {"4": "x"},
        "c": [None, True, None, [2.5]],
        "d": "(1+2j)",
    }


@pytest.mark.parametrize("kind", ["f4", "f8", "u1", "u2", "u4", "i4"])
def test_packed_arrays_come_back(kind: str) -> None:
    values = np.array([[0, 1], [2, 200]])
    np.testing.assert_array_equal(unpacked(packed(values, kind)), values)


def test_payload_holds_the_path_exactly_and_both_clocks() -> None:
    path = fakes.fake_path()
    payload = json.loads(json_for_html(payload_from_records(path)))
    np.testing.assert_array_equal(payload["path"]["vertices_mm"], path.vertices_mm)
    np.testing.assert_array_equal(payload["path"]["vertex_times_ps"], path.vertex_times_ps)
    np.testing.assert_allclose(payload["path"]["vertex_std"], path.vertex_std, rtol=1e-12)
    event = unpacked(payload["trace"]["event_ps"]).astype(float) + path.emission_time_ps
    place = path.position_at(np.clip(event, path.vertex_times_ps[0], path.vertex_times_ps[-1]))
    np.testing.assert_allclose(unpacked(payload["trace"]["points_mm"]), place, atol=2e-4)
    table = {name: unpacked(part) for name, part in payload["pulses"].items()}
    np.testing.assert_allclose(table["residual_ps"], path.residuals["residual_ps"], rtol=1e-6)


def test_words_can_be_read_without_scripts(paper_page: str) -> None:
    words = " ".join(read(paper_page).words)
    path = fakes.fake_path()
    for text in (path.prior, path.statements[0], "Vertices, with one standard deviation"):
        assert text in words
    corner = f"{path.vertices_mm[1, 0]:.1f}"[:5]
    assert corner in words


@pytest.mark.parametrize(
    ("changes", "sentence"),
    [
        ({"covariance": np.full((16, 16), np.nan)}, "no finite errors"),
        ({"truth": None}, "truth is not known"),
        ({"residuals": fakes.fake_path().residuals[:0]}, "no residuals"),
        ({}, "No recording was given"),
    ],
)
def test_what_is_missing_is_said(changes: dict[str, Any], sentence: str) -> None:
    words = " ".join(read(page_html(replace(fakes.fake_path(), **changes))).words)
    assert sentence in words


@pytest.mark.parametrize("n_vertices", [0, 1])
def test_a_path_without_legs_still_gives_a_page(n_vertices: int) -> None:
    bare = SimpleNamespace(
        vertices_mm=np.zeros((n_vertices, 3)), vertex_times_ps=np.zeros(n_vertices)
    )
    words = " ".join(read(page_html(bare)).words)
    assert "The path has no legs" in words
    assert "No camera" in words


def small_recording(seed: int = 4) -> tuple[Histograms, Any]:
    """A 6 x 8 camera with a pulse in three pixels, one of them across the period's end."""
    rng = np.random.default_rng(seed)
    counts = rng.poisson(0.3, size=(6, 8, 200)).astype(np.uint32)
    for row, col, code in ((1, 2, 60), (3, 3, 120), (5, 7, 199)):
        codes = (code + np.rint(rng.normal(0, 1.3, 4000)).astype(int)) % 200
        np.add.at(counts, (row, col, codes), 1)
    hist = Histograms(counts, bin_width_ps=50.0, laser_period_ps=10_000.0)
    delays = [60 * 50.0 + 25.0, 120 * 50.0 + 25.0, 199 * 50.0 + 25.0]
    pulses = fakes.fake_pulses([1, 3, 5], [2, 3, 7], delays, std_ps=66.0, photons=4000.0)
    return hist, pulses


def test_embedded_histograms_are_the_recordings() -> None:
    hist, pulses = small_recording()
    blob = histogram_blob(hist, pulses=pulses)
    assert blob["left_out"] == 0
    row, col, n, start = (unpacked(blob[k]) for k in ("row", "col", "n", "start"))
    n = n.astype(int)
    raw = gzip.decompress(base64.b64decode(blob["gzip"]))
    total = int(n.sum())
    widths = np.frombuffer(raw, "<u2", total) * blob["width_unit"]
    counts = np.frombuffer(raw, f"<{blob['counts_kind']}", offset=2 * total)
    at = np.concatenate(([0], np.cumsum(n)))
    assert {(int(r), int(c)) for r, c in zip(row[:3], col[:3], strict=True)} == {
        (1, 2),
        (3, 3),
        (5, 7),
    }
    for k, (r, c) in enumerate(zip(row, col, strict=True)):
        mine = slice(at[k], at[k + 1])
        edges = start[k] + np.concatenate(([0.0], np.cumsum(widths[mine])))
        first = int(np.rint(start[k] / 50.0))
        last = int(np.rint(edges[-1] / 50.0))
        own = hist.counts[r, c][np.arange(first, last) % 200]
        assert own.sum() == counts[mine].sum()
        if k < 3:
            np.testing.assert_array_equal(counts[mine], own)
            np.testing.assert_allclose(np.diff(edges), 50.0, atol=blob["width_unit"])


def test_histograms_stay_in_their_budget(monkeypatch: pytest.MonkeyPatch) -> None:
    from lightflight.view.page import histograms

    hist, pulses = small_recording()
    monkeypatch.setattr(histograms, "BUDGET_BYTES", 2000)
    blob = histogram_blob(hist, pulses=pulses)
    kept = len(unpacked(blob["row"]))
    assert 3 <= kept < 48
    assert blob["left_out"] == 48 - kept


def test_the_page_appears_whole_or_not_at_all(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    target = tmp_path / "page.html"
    write_page(fakes.fake_path(), target)
    before = target.read_bytes()
    monkeypatch.setattr(parts, "SCRIPTS", ("no_such.js",))
    with pytest.raises(FileNotFoundError):
        write_page(fakes.fake_path(), target)
    assert target.read_bytes() == before
    assert list(tmp_path.iterdir()) == [target]


def test_pages_of_a_campaign_share_their_parts(tmp_path: Path) -> None:
    from lightflight.view.page.campaign import write_campaign

    fakes.fake_path().save(tmp_path / "a.h5")
    write_campaign([tmp_path / "a.h5"] * 2, tmp_path / "index.html")
    folder = tmp_path / "index_pages"
    names = sorted(one.name for one in folder.iterdir())
    assert names == ["0001.html", "0002.html", "page.css", "page.js"]
    page = (folder / "0001.html").read_text("utf-8")
    reader = read(page)
    asked = [a.get("src") or a.get("href") for t, a in reader.tags if t in ("link", "script")]
    assert asked == ["page.css", None, "page.js"]
    policy = next(a["content"] for t, a in reader.tags if t == "meta" and "http-equiv" in a)
    assert "script-src 'self' file:;" in str(policy)
    assert "unsafe" not in str(policy)
    whole = parts.whole_html(folder / "0001.html")
    title = "Three legs of light in space and time: a.h5"
    assert whole == page_html(LightPath.load(tmp_path / "a.h5"), title=title)
    (tmp_path / "whole.html").write_text(whole, "utf-8")
    assert parts.whole_html(tmp_path / "whole.html") == whole  # nothing left to do


def test_what_cannot_be_made_whole_is_refused(tmp_path: Path) -> None:
    page = tmp_path / "0001.html"
    page.write_text("<!DOCTYPE html><title>another</title>", "utf-8")
    with pytest.raises(FileFormatError, match="is no page of a path"):
        parts.whole_html(page)
    page.write_bytes(b"\xff\xfe\x00")
    with pytest.raises(FileFormatError, match="is no page of a path"):
        parts.whole_html(page)
    page.write_text(build.framed_page(fakes.fake_path(), parts.SHARED), "utf-8")
    with pytest.raises(FileFormatError, match=r"needs page\.css beside it"):
        parts.whole_html(page)


def test_a_campaigns_index_names_files_without_their_folders(tmp_path: Path) -> None:
    from lightflight.view.page.campaign import campaign_html

    path = fakes.fake_path()
    entries = [
        ("/home/somebody/a/run.h5", path, "p/0001.html"),
        ("/home/somebody/b/run.h5", path, "p/0002.html"),
        ("/home/somebody/b/other.h5", "is empty", ""),
    ]
    text = campaign_html(entries, title="<Tuesday>")
    words = " ".join(read(text).words)
    assert "somebody" not in text
    assert "a/run.h5" in words
    assert "is empty" in words
    assert "<Tuesday>" in words
    assert text.count("<svg") == 2
    assert campaign_html([]).count("<li>") == 0
