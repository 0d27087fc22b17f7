"""Tables and plots of written pages in a real browser: nothing is broken in its middle, and what goes on says so."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from jinja2 import Environment, FileSystemLoader

import daemon.tools.report as report

STYLES = Path(report.__file__).parent / "templates"
LONG = "net whole, first touch on mask, 125 um from the nearest pad's middle, " * 2
ROW = ("R", "TP2", "RESET", "500 uohm", "3.3 mohm", "127", "2", "3", "11.41")
NAMES = ("TP2", "RESET")


@pytest.fixture
def written(browser: Any) -> Iterator[Any]:
    """A page with the reports' styles, at a telephone's width."""
    sheets = Environment(loader=FileSystemLoader(STYLES), autoescape=False)  # noqa: S701  # our own style sheets
    style = "".join(sheets.get_template(name).render() for name in ("style.css", "run.css"))
    cells = "".join(f"<td{' class=left' if one in NAMES else ''}>{one}</td>" for one in ROW)
    box = '<svg viewBox="0 0 900 300"><rect width="900" height="300"/></svg>'
    context = browser.new_context(viewport={"width": 390, "height": 844})
    tab = context.new_page()
    tab.set_content(
        f"<!doctype html><style>{style}</style><figure class=plot>{box}</figure>"
        f"<table class=points><tr>{cells}<td class=left>{LONG}</td></tr></table>"
    )
    yield tab
    context.close()


def test_names_and_figures_stay_whole_beside_a_long_column_of_words(written: Any) -> None:
    written.set_viewport_size({"width": 1280, "height": 800})
    high = written.locator("td").evaluate_all(
        "all => all.slice(0, -1).map((one) => { const range = document.createRange(); range.selectNodeContents(one);"
        " return new Set([...range.getClientRects()].map((box) => Math.round(box.top))).size })"
    )
    assert high == [1] * len(ROW)


def test_a_plot_that_goes_on_beside_a_narrow_window_says_so(written: Any) -> None:
    said = "getComputedStyle(document.querySelector('figure'), '::before').content"
    assert "sideways" in written.evaluate(said)
    assert written.evaluate("document.querySelector('figure').scrollWidth > innerWidth")
    written.set_viewport_size({"width": 1280, "height": 800})
    assert written.evaluate(said) == "none"
