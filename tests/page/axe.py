"""Accessibility of what a tab shows, judged by axe-core.

It goes in by `evaluate`, for the page's policy lets no script in.
"""

from __future__ import annotations

from importlib.resources import files
from typing import Any

_RUN = "() => axe.run(document, {resultTypes: ['violations']}).then(found => found.violations)"


def violations(tab: Any) -> list[str]:
    """Return what is wrong for somebody who cannot see, hear or point well, each with the elements it is about."""
    tab.evaluate((files("axe_playwright_python") / "axe.min.js").read_text() + "\n;undefined")
    found: list[dict[str, Any]] = tab.evaluate(_RUN)
    return [f"{one['id']}: {[node['target'] for node in one['nodes']][:5]}" for one in found]
