"""The page to click the needle's end on, in a real browser: a mouse there goes by whole pixels of the screen."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from daemon.cli.click_page import write_click_page

SIZE_PX = (1600, 1200)
END_PX = (549.3, 726.6)
"""Of a disc that is drawn for the needle's end; parts of a pixel."""
OFF_PX = ((0, 0), (1, 0), (0, -1), (-1, 1), (0, 0))
"""What a hand is off at each click, whole pixels of the screen."""


@pytest.fixture
def teaching(tmp_path: Path) -> Path:
    """The page of a picture of the usual size."""
    picture = np.full((SIZE_PX[1], SIZE_PX[0]), 30, np.uint8)
    centre = (round(END_PX[0] * 256), round(END_PX[1] * 256))
    cv2.circle(picture, centre, 6 * 256, 200, cv2.FILLED, cv2.LINE_AA, 8)
    cv2.imwrite(str(tmp_path / "white.jpg"), picture)
    write_click_page(tmp_path / "white.jpg", tmp_path / "tip.html")
    return tmp_path / "tip.html"


def opened(browser: Any, page: Path, **options: Any) -> Any:
    tab = browser.new_context(**options).new_page()
    tab.goto(page.as_uri())
    tab.evaluate("document.getElementById('picture').decode()")
    return tab


def look_closer(tab: Any, hit: Any) -> tuple[int, int]:
    """Click the picture, and return where on the screen the end then is, to the nearest pixel."""
    tab.locator("#picture").scroll_into_view_if_needed()
    box = tab.locator("#picture").bounding_box()
    scale = box["width"] / SIZE_PX[0]
    hit(round(box["x"] + (END_PX[0] + 0.5) * scale), round(box["y"] + (END_PX[1] + 0.5) * scale))
    x, y, zoom = tab.evaluate(
        """([x, y]) => { const box = view.getBoundingClientRect();
             return [box.left + box.width / 2 + (x - centre[0]) * ZOOM,
                     box.top + box.height / 2 + (y - centre[1]) * ZOOM, ZOOM]; }""",
        list(END_PX),
    )
    assert zoom >= 4
    return round(x), round(y)


@pytest.fixture
def tab(browser: Any, teaching: Path) -> Any:
    return opened(browser, teaching, viewport={"width": 1280, "height": 800})


def held(tab: Any) -> tuple[float, float]:
    """Where the keyboard's cross is."""
    x, y = tab.evaluate("held")
    return x, y


def to(tab: Any, x: float, y: float) -> None:
    """Move the cross there by the arrows of the view, whole pixels first."""
    for axis, there, keys in ((0, x, ("ArrowRight", "ArrowLeft")), (1, y, ("ArrowDown", "ArrowUp"))):
        for shift, step in (("Shift+", 1.0), ("", 0.1)):
            off = there - held(tab)[axis]
            for _ in range(round(abs(off) / step)):
                tab.keyboard.press(f"{shift}{keys[off < 0]}")


def test_the_end_is_pointed_at_by_the_keyboard_alone(tab: Any) -> None:
    tab.keyboard.press("Tab")
    assert tab.evaluate("document.activeElement.id") == "coarse"
    for key, times in (("Shift+ArrowLeft", 1), ("ArrowLeft", 3), ("ArrowDown", 6)):
        for _ in range(times):
            tab.keyboard.press(key)
    tab.keyboard.press("Enter")
    assert tab.evaluate("document.activeElement.id") == "view"
    for _ in range(5):
        to(tab, *END_PX)
        before = held(tab)
        tab.keyboard.press("Enter")
        assert held(tab) != before, "a cross that stays would be set by one look for all five"
    assert "5 of 5" in tab.inner_text("#scatter")
    assert place_of(tab) == pytest.approx(END_PX, abs=0.06)
    tab.keyboard.press("Tab")
    tab.keyboard.press("Enter")
    assert "4 of 5" in tab.inner_text("#scatter"), "what is set is taken back by the keyboard, too"


def test_the_cross_stays_in_the_picture_and_in_the_view(tab: Any) -> None:
    tab.keyboard.press("Tab")
    for _ in range(12):
        tab.keyboard.press("Shift+ArrowLeft")
    tab.keyboard.press("Enter")
    assert held(tab)[0] == 0
    for _ in range(60):
        tab.keyboard.press("Shift+ArrowRight")
    assert tab.evaluate("Math.abs(held[0] - centre[0]) * ZOOM <= view.clientWidth / 2")


def test_the_place_that_is_typed_stands_before_the_command(tab: Any) -> None:
    before = "document.getElementById('place').compareDocumentPosition(document.getElementById('command'))"
    assert tab.evaluate(before) & 4, "the command follows"


def place_of(tab: Any) -> tuple[float, float]:
    x, y = tab.inner_text("#place").split(",")
    assert tab.inner_text("#command").endswith(f"--tip {x},{y}")
    return float(x), float(y)


@pytest.mark.parametrize(
    "options",
    [
        {"viewport": {"width": 1280, "height": 800}},
        {"viewport": {"width": 390, "height": 844}, "has_touch": True},
    ],
    ids=["mouse", "telephone"],
)
def test_five_clicks_by_whole_pixels_of_the_screen_tell_a_part_of_the_pictures(
    browser: Any, teaching: Path, options: dict[str, Any]
) -> None:
    tab = opened(browser, teaching, **options)
    hit = tab.touchscreen.tap if "has_touch" in options else tab.mouse.click
    at = look_closer(tab, hit)
    before = tab.locator("#view").bounding_box()
    for dx, dy in OFF_PX:
        hit(at[0] + dx, at[1] + dy)
        assert tab.locator("#view").bounding_box() == before, "what is clicked on moved between two clicks"
    assert place_of(tab) == pytest.approx(END_PX, abs=0.15)
    said = re.fullmatch(
        r"5 of 5 clicks: one scatters by ([0-9.]+) px, their mean \(red\) is good to ([0-9.]+) px\.",
        tab.inner_text("#scatter"),
    )
    assert said is not None
    assert 0.0 < float(said[2]) < float(said[1]) < 0.3
    assert tab.evaluate("document.documentElement.scrollWidth <= innerWidth")


def test_a_click_that_went_astray_is_said_and_taken_back(browser: Any, teaching: Path) -> None:
    tab = opened(browser, teaching, viewport={"width": 1280, "height": 800})
    x, y = look_closer(tab, tab.mouse.click)
    for off in (0, 1, 120):
        tab.mouse.click(x + off, y)
    assert "14.9 px from the others: take it back" in tab.inner_text("#scatter")
    tab.locator("#back").click()
    assert "2 of 5" in tab.inner_text("#scatter")
    assert place_of(tab) == pytest.approx(END_PX, abs=0.2)
    tab.locator("#again").click()
    assert tab.inner_text("#place") == "X,Y"


def test_a_click_beside_the_picture_is_none(browser: Any, teaching: Path) -> None:
    """Near its corner the view shows what is not in the picture."""
    tab = opened(browser, teaching, viewport={"width": 1280, "height": 800})
    picture, view = (tab.locator(one).bounding_box() for one in ("#picture", "#view"))
    tab.mouse.click(picture["x"] + 1, picture["y"] + 1)
    tab.mouse.click(view["x"] + 5, view["y"] + 5)
    assert tab.inner_text("#place") == "X,Y"
    tab.mouse.click(view["x"] + view["width"] - 5, view["y"] + view["height"] - 5)
    assert "1 of 5" in tab.inner_text("#scatter")
