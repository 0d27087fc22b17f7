"""Page to click the tip on: the image, a magnifier, and the command to run."""

from __future__ import annotations

import base64
from pathlib import Path

from jinja2 import Environment, FileSystemLoader, select_autoescape

from daemon.platform.atomic_file import replace_whole


def write_click_page(picture: Path, page: Path) -> None:
    """Write the page for a stored white picture (JPEG)."""
    environment = Environment(loader=FileSystemLoader(Path(__file__).parent), autoescape=select_autoescape())
    data = base64.b64encode(picture.read_bytes()).decode()
    text = environment.get_template("click_page.html.j2").render(picture=data)
    replace_whole(page, lambda path: path.write_text(text))
