"""A board folder's roles file is whole at any moment, however many read the folder at once."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from daemon.tools.cad.role_file import ROLE_FILE, RoleFile, read_role_file, write_role_file

MINE, OTHERS = RoleFile({"a.gbr": "top copper"}), RoleFile({"b.gbr": "top copper", "c.gbr": "top mask"})


def test_another_who_writes_half_of_it_at_the_same_time_leaves_it_whole(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Two commands that read one board for the first time, as each would do alone."""
    really_replace, really_write = Path.replace, Path.write_text
    others: list[bool] = []

    def half(path: Path, text: str, **rest: Any) -> int:
        really_write(path, text[: len(text) // 2], **rest)
        raise OSError("no space left")

    def replace(path: Path, target: Path) -> Path:
        if not others:
            others.append(True)
            with monkeypatch.context() as meanwhile:
                meanwhile.setattr(Path, "write_text", half)
                others.append(write_role_file(tmp_path, OTHERS))
        return really_replace(path, target)

    monkeypatch.setattr(Path, "replace", replace)
    assert write_role_file(tmp_path, MINE)
    assert others == [True, False]
    target = tmp_path / ROLE_FILE
    assert read_role_file(target.read_text(encoding="utf-8")) == MINE
    assert [path.name for path in tmp_path.iterdir()] == [ROLE_FILE]
    assert target.stat().st_mode & 0o777 == 0o644
