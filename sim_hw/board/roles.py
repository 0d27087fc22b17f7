"""Roles of files, as a board folder's `reprobe-roles.json` gives them, and how its drill files are written.

`{"format": "reprobe-roles-1", "roles": {file: role}, "drills": {file: {unit, integers, decimals, zeros_kept}}}`
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from sim_hw.board.drills import DrillFormat

ROLES_FILE = "reprobe-roles.json"
ROLES_FORMAT = "reprobe-roles-1"

_SIDES = ("top", "bottom")
_USES = ("copper", "mask", "silk", "paste", "courtyard", "fabrication")


@dataclass(frozen=True)
class Roles:
    """What a folder's roles file says; `of` holds None for files that are of no use here."""

    of: Mapping[str, str | None] = field(default_factory=dict)
    drills: Mapping[str, DrillFormat] = field(default_factory=dict)


def read_roles(folder: Path) -> Roles:
    """Return what the folder's roles file says, in this reader's words (`top copper`, `drill`, `netlist`, ...).

    Raises:
        ValueError: the file is there and is not what it should be.

    """
    path = folder / ROLES_FILE
    if not path.is_file():
        return Roles()
    try:
        said = json.loads(path.read_text(encoding="utf-8-sig"))
    except (ValueError, OSError) as error:
        raise ValueError(f"{path} is not JSON: {error}; mend it or delete it") from error
    roles, drills = (said.get(k, {}) if isinstance(said, dict) else None for k in ("roles", "drills"))
    if not isinstance(roles, dict) or not isinstance(drills, dict) or said.get("format") != ROLES_FORMAT:
        raise ValueError(f"{path} is not of the format {ROLES_FORMAT}; mend it or delete it")
    formats = {str(name): _format(value) for name, value in drills.items() if isinstance(value, dict)}
    return Roles({str(name): _role(str(role)) for name, role in roles.items()}, formats)


def _role(said: str) -> str | None:
    """Return a role in this reader's words; None for what it has no use for."""
    words = said.lower().replace("_", " ").replace("-", " ").split()
    if not words:
        return None
    if words[0] in ("netlist", "outline"):
        return words[0]
    if words[0] == "drill":
        return "capped drill" if "capped" in words else "drill"
    side = next((side for side in _SIDES if side in words), None)
    use = next((use for use in _USES if use in words), None)
    return f"{side} {use}" if side and use else None


def _format(said: dict[str, Any]) -> DrillFormat:
    digits = [value if isinstance(value := said.get(key), int) else None for key in ("integers", "decimals")]
    return DrillFormat(str(said.get("unit")), digits[0], digits[1], said.get("zeros_kept"))
