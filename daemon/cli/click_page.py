"""Page to click the tip on: the image, a view of its end eight times as large, and the command to run."""

from __future__ import annotations

import base64
import errno
import time
from pathlib import Path

from jinja2 import Environment, FileSystemLoader, select_autoescape

from daemon.platform.atomic_file import replace_whole

WRITTEN_WITHIN_S = 20.0
BEGIN, END = b"\xff\xd8", b"\xff\xd9"
"""Of a JPEG."""


def kept_picture(path: Path) -> Path:
    """Wait until a job's picture is there whole, and return it; FileNotFoundError if it does not come.

    The daemon answers first and writes the pictures then.
    """
    give_up_s = time.monotonic() + WRITTEN_WITHIN_S
    while time.monotonic() < give_up_s:
        content = path.read_bytes() if path.exists() else b""
        if content.startswith(BEGIN) and content.endswith(END):
            return path
        time.sleep(0.02)
    raise FileNotFoundError(errno.ENOENT, "the daemon has not written it", str(path))


def write_click_page(picture: Path, page: Path) -> None:
    """Write the page for a stored white picture (JPEG)."""
    environment = Environment(loader=FileSystemLoader(Path(__file__).parent), autoescape=select_autoescape())
    data = base64.b64encode(picture.read_bytes()).decode()
    text = environment.get_template("click_page.html.j2").render(picture=data)
    replace_whole(page, lambda path: path.write_text(text, encoding="utf-8"))
