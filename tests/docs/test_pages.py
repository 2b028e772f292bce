"""What the documentation shows, runs: every file, command and line of Python on its pages."""

from __future__ import annotations

import re
import shutil
from pathlib import Path

import pytest

import lightflight
from tests.docs.pages import DOCS, ROOT, Page, run_console, run_session

TUTORIAL = DOCS / "tutorial" / "first-path.md"
PAGES = sorted(
    page
    for folder in ("how-to", "explanation", "start")
    for page in (DOCS / folder).glob("*.md")
    if page.name != "index.md"
)


@pytest.fixture(scope="session")
def tutorial_folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder in which the tutorial was followed to its end."""
    folder = tmp_path_factory.mktemp("tutorial")
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        assert Page(TUTORIAL).run() > 8
    return folder


def test_the_tutorial_leads_to_what_it_says(tutorial_folder: Path) -> None:
    import lightflight as lf

    path = lf.LightPath.load(tutorial_folder / "path.h5")
    error = lf.path_error(path, path.truth, path.camera)
    assert error.position_rms_mm < 0.3
    for name in re.findall(r"-o ([\w.-]+)", TUTORIAL.read_text(encoding="utf-8")):
        assert (tutorial_folder / name).stat().st_size > 100


@pytest.mark.parametrize("page", PAGES, ids=lambda page: f"{page.parent.name}/{page.stem}")
@pytest.mark.filterwarnings("ignore:the clock is nominal:UserWarning")
@pytest.mark.filterwarnings("ignore:.*the light was out of the picture:UserWarning")
def test_a_page_does_what_it_shows(
    page: Path, tutorial_folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    if not any(b.kind in ("console", "python", "pycon") for b in Page(page).blocks()):
        return
    for file in tutorial_folder.iterdir():
        if file.suffix in (".h5", ".toml"):
            shutil.copy(file, tmp_path)
    monkeypatch.chdir(tmp_path)
    assert Page(page).run() > 0


def test_the_page_on_real_recordings(
    data_dir: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    file = data_dir / "lift-fiber" / "lift_derived.h5"
    if not file.exists():
        pytest.skip(f"no {file.name} in {file.parent}")
    (tmp_path / file.name).symlink_to(file.resolve())
    monkeypatch.chdir(tmp_path)
    assert Page(DOCS / "tutorial" / "real-recordings.md").run() > 0


def test_every_public_name_is_on_the_page_of_the_api() -> None:
    import lightflight as lf
    from lightflight import view

    text = (DOCS / "reference" / "api.md").read_text(encoding="utf-8")
    listed = set(re.findall(r"^   ~?(?:\w+\.)*(\w+)$", text, re.MULTILINE))
    assert set(lf.__all__) - {"__version__"} <= listed
    assert set(view.__all__) <= listed


def test_no_page_is_empty_and_every_picture_exists() -> None:
    for page in DOCS.rglob("*.md"):
        if "generated" in page.parts or page.name == "index.md":
            continue
        text = page.read_text(encoding="utf-8")
        assert len(text) > 200, page
        for name in re.findall(r"!\[[^\]]*\]\(([^)]+)\)", text):
            assert (page.parent / name).exists(), f"{page}: {name}"


def test_no_word_of_a_scheme_is_cut_off() -> None:
    from tools.schemes import SCHEMES

    for name, draw in SCHEMES.items():
        figure = draw()
        figure.canvas.draw()
        room = figure.bbox
        for text in [*figure.texts, *(text for ax in figure.axes for text in ax.texts)]:
            box = text.get_window_extent()
            inside = (box.x0, room.x1 - box.x1, box.y0, room.y1 - box.y1)
            assert min(inside) >= 0, (name, text.get_text())


def test_a_page_that_lies_is_caught(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    run_console(f"$ lightflight versions\n  lightflight {lightflight.__version__}\n")
    for lie in ("never printed", "  lightflight 9.1.0.dev0"):
        with pytest.raises(AssertionError, match="does not print"):
            run_console(f"$ lightflight versions\n{lie}\n")
    with pytest.raises(AssertionError, match="No such option"):
        run_console("$ lightflight versions --nonsense\n")
    with pytest.raises(AssertionError, match="not tested"):
        run_console("$ rm -rf /\n")
    names = {"n": 3}
    run_session(">>> n + 1\n4\n", names, "page")
    with pytest.raises(AssertionError, match="Expected"):
        run_session(">>> n + 1\n5\n", names, "page")
    assert ROOT.joinpath("pyproject.toml").exists()
