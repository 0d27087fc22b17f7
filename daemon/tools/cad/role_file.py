"""Roles file of a board folder: what was found out about its files, kept so that it is learned once.

See this folder's README for the format. People may edit it; it wins over guesses, and options win over it.
"""

from __future__ import annotations

import json
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from daemon.platform.atomic_file import replace_whole
from daemon.tools.cad.excellon import DrillFormat

ROLE_FILE = "reprobe-roles.json"
FORMAT = "reprobe-roles-1"
FOR_ALL = 0o644
"""Mode of a roles file: all who may read the folder may read it."""
SIDED = tuple(
    f"{side} {use}"
    for side in ("top", "bottom")
    for use in ("copper", "mask", "silk", "paste", "courtyard", "fabrication")
)
ROLES = (
    *SIDED, "inner copper", "outline", "drill", "drill plated", "drill unplated", "netlist", "points", "board",
    "ignored",
)  # fmt: skip


@dataclass(frozen=True)
class RoleFile:
    """File -> role; drill file -> format."""

    roles: dict[str, str] = field(default_factory=dict)
    drills: dict[str, DrillFormat] = field(default_factory=dict)


def parse_role(text: str) -> str:
    """Return the role meant by `top_mask`, `top-mask` or `Top Mask`; raise ValueError naming all."""
    role = " ".join(text.replace("_", " ").replace("-", " ").lower().split())
    if role not in ROLES:
        raise ValueError(f"{text!r} is no layer; one of {', '.join(r.replace(' ', '_') for r in ROLES)}")
    return role


def read_role_file(text: str) -> RoleFile:
    """Read a roles file; raise ValueError saying what is wrong in it."""
    try:
        said: Any = json.loads(text)
    except json.JSONDecodeError as exc:
        raise ValueError(f"{ROLE_FILE}, line {exc.lineno}: {exc.msg}; mend it or delete it") from exc
    if not isinstance(said, dict) or said.get("format") != FORMAT:
        raise ValueError(f'{ROLE_FILE} has no "format": "{FORMAT}"; mend it or delete it')
    try:
        roles = {str(name): parse_role(str(role)) for name, role in said.get("roles", {}).items()}
        drills = {str(name): _format(f) for name, f in said.get("drills", {}).items()}
    except (ValueError, AttributeError, TypeError) as exc:
        raise ValueError(f"{ROLE_FILE}: {exc}; mend it or delete it") from exc
    return RoleFile(roles, drills)


def _format(said: dict[str, Any]) -> DrillFormat:
    unit, zeros = said.get("unit"), said.get("zeros_kept")
    if unit not in ("mm", "inch") or zeros not in ("leading", "trailing", "all", None):
        raise ValueError('a drill format needs "unit" ("mm" or "inch") and "zeros_kept" ("leading", "trailing", "all")')
    digits = [None if said.get(k) is None else int(said[k]) for k in ("integers", "decimals")]
    return DrillFormat(unit, digits[0], digits[1], zeros)


def write_role_file(folder: Path, kept: RoleFile) -> bool:
    """Keep the roles in the folder; return False where it cannot be written."""
    drills = {
        name: {"unit": f.unit, "integers": f.integers, "decimals": f.decimals, "zeros_kept": f.zeros_kept}
        for name, f in sorted(kept.drills.items())
    }
    text = json.dumps({"format": FORMAT, "roles": dict(sorted(kept.roles.items())), "drills": drills}, indent=1) + "\n"
    target = folder / ROLE_FILE
    try:
        if not target.is_file() or target.read_text(encoding="utf-8") != text:
            # Two that read one folder at once do not see what the other has half written
            replace_whole(target, lambda beside: beside.write_text(text, encoding="utf-8"), FOR_ALL)
    except OSError:
        return False
    return True
