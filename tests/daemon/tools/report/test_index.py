"""The index lists every page by kind, newest first, says what the pages say, and overwrites nobody's file."""

from __future__ import annotations

import re
from pathlib import Path

from daemon.tools.report.index import renew_index, write_index
from daemon.tools.report.page import Page, PageVerdict, render


def _page(file: Path, made_at: str, *, kind: str = "backlash", station: str = "bench-1", good: bool = True) -> None:
    """Write a page without plots: the index reads only what a page says of itself."""
    verdict = PageVerdict(good, f"Because of {file.stem} & more.")
    file.write_text(render(Page(kind, "Something", station, made_at, "job-1", verdict, (), ())))


def _pages(folder: Path) -> None:
    _page(folder / "a.html", "2026-01-02T00:00:00+00:00")
    # An hour later in UTC than the one below, though its text sorts before it.
    _page(folder / "b.html", "2026-03-01T23:30:00-05:00")
    _page(folder / "c d#.html", "2026-03-02T03:30:00+00:00", good=False)
    _page(folder / "board.html", "2026-03-04T05:06:07+00:00", kind="alignment", station="<b>&")


def test_pages_are_listed_by_kind_and_newest_first(tmp_path: Path) -> None:
    _pages(tmp_path)
    text = write_index(tmp_path).read_text()
    assert re.findall(r'href="([^"]+)"', text) == ["board.html", "b.html", "c%20d%23.html", "a.html"]
    assert re.findall(r"<h2>(\w+)</h2>", text) == ["alignment", "backlash"]
    assert text.count("not good") == 1
    assert "&lt;b&gt;&amp;" in text
    assert "<b>" not in text


def test_the_index_says_of_a_page_what_the_page_says(tmp_path: Path) -> None:
    _pages(tmp_path)
    page, index = (tmp_path / "a.html").read_text(), write_index(tmp_path).read_text()
    said = re.search(r'name="reprobe-verdict" content="([^"]+)"', page)
    assert said
    assert said[1] in index


def test_files_that_are_no_pages_are_left_out(tmp_path: Path) -> None:
    _pages(tmp_path)
    (tmp_path / "notes.html").write_text("<h1>mine</h1>")
    (tmp_path / "torn.html").write_bytes(b"\xff\xfe<meta name=reprobe-kind")
    undated = (tmp_path / "a.html").read_text().replace('content="2026-01-02T00:00:00+00:00"', 'content="once"')
    (tmp_path / "undated.html").write_text(undated)
    text = write_index(tmp_path).read_text()
    assert text.count("<a href") == 4


def test_a_second_index_replaces_the_first_and_does_not_list_it(tmp_path: Path) -> None:
    _pages(tmp_path)
    first = write_index(tmp_path).read_text()
    assert write_index(tmp_path).read_text() == first


def test_an_index_that_is_not_ours_stays(tmp_path: Path) -> None:
    _pages(tmp_path)
    assert renew_index(tmp_path)
    assert renew_index(tmp_path)
    (tmp_path / "index.html").write_text("<h1>my site</h1>")
    assert not renew_index(tmp_path)
    assert (tmp_path / "index.html").read_text() == "<h1>my site</h1>"


def test_an_empty_folder_has_an_index_that_says_so(tmp_path: Path) -> None:
    assert "No pages yet" in write_index(tmp_path).read_text()
