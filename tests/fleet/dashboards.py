"""The shipped dashboards of Grafana: their files, and a query as Grafana sends it."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

GRAFANA = Path(__file__).parents[2] / "systemd" / "grafana"
FILES = sorted((GRAFANA / "dashboards").glob("*.json"))


def dashboards() -> list[dict[str, Any]]:
    """Return all of them."""
    return [json.loads(file.read_text()) for file in FILES]


def filled_in(query: str, variables: Mapping[str, str]) -> str:
    """Return a query with macros and variables replaced."""
    query = re.sub(r"\$__timeFilter\((\w+)\)", r"\1 BETWEEN now() - interval '7 days' AND now()", query)
    query = query.replace("$__rate_interval", "1m")
    for name in sorted(variables, key=len, reverse=True):
        query = query.replace(f"${name}", variables[name])
    return query
