"""Pages that commands write: of a job, and to click the needle's end on."""

from __future__ import annotations

from pathlib import Path

from daemon.cli.click_page import write_click_page
from daemon.cli.job_page import write_job_page
from daemon.storage.journal_reader import JobRow, Step

LOOK = {"kind": "site", "needle": {"width_px": 42.2, "seen": True}, "target_px": [428.0, 620.5], "sigma_um": None}


def test_the_page_of_a_job_is_for_a_person_and_fits_a_telephone(tmp_path: Path) -> None:
    job = JobRow(
        id="j<1>", op="correct", request={"test_point": "TP7"}, received_at="2026-11-25T22:45:16.513+00:00",
        finished_at=None, ok=None, result=None,
    )  # fmt: skip
    write_job_page(job, [Step(at="2026-11-25T22:45:17.025+00:00", kind="look", body=LOOK)], tmp_path / "job.html")
    text = (tmp_path / "job.html").read_text()
    assert "needle (width px 42.2, seen yes)" in text
    assert not [one for one in ("{&#39;", "[428", "True") if one in text]
    assert "sigma um none" in text
    assert "22:45:17.025" in text
    assert 'name="viewport"' in text
    assert "prefers-color-scheme: dark" in text
    assert "j&lt;1&gt;" in text


def test_the_page_to_click_on_takes_parts_of_pixels(tmp_path: Path) -> None:
    """Chromium tells whole ones of a `click`, and the mean of five is then no better than one."""
    (tmp_path / "white.jpg").write_bytes(b"\xff\xd8\xff\xd9")
    write_click_page(tmp_path / "white.jpg", tmp_path / "click.html")
    text = (tmp_path / "click.html").read_text()
    assert 'addEventListener("pointerup"' in text
    assert 'picture.addEventListener("click"' not in text
    assert "color-scheme: light dark" in text
    assert 'name="viewport"' in text
    assert 'view.addEventListener("keydown"' in text, "who has no mouse points at it by the arrows"
    assert text.index('id="place"') < text.index('id="command"'), "what the set-up asks for comes first"
