"""A pseudo terminal that cannot be had is told with what to do; nothing stays behind of one that was closed."""

from __future__ import annotations

import errno
import os
from pathlib import Path

import pytest

from sim_hw.linked_pty import LinkedPty


def _open() -> int:
    return sum(1 for _ in Path("/proc/self/fd").iterdir())


def test_where_there_are_no_pseudo_terminals_it_says_what_for_and_what_to_look_at(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def none_left() -> tuple[int, int]:
        raise OSError(errno.ENODEV, "No such device")

    monkeypatch.setattr(os, "openpty", none_left)
    with pytest.raises(OSError, match="no pseudo terminal for the line: No such device; is /dev/pts mounted"):
        LinkedPty(None, "line")


def test_a_link_that_cannot_be_made_leaves_nothing_open(tmp_path: Path) -> None:
    before = _open()
    with pytest.raises(FileNotFoundError):
        LinkedPty(tmp_path / "nowhere" / "bus", "line")
    assert _open() == before


def test_both_ends_are_one_wire_and_the_link_goes_with_it(tmp_path: Path) -> None:
    link = tmp_path / "bus"
    terminal = LinkedPty(link, "line")
    with link.open("r+b", buffering=0) as port:
        port.write(b"\x01\x03\r\n")
        assert terminal.read(10) == b"\x01\x03\r\n"
        assert terminal.write(b"\x04") == 1
        assert port.read(1) == b"\x04"
        with pytest.raises(BlockingIOError):
            terminal.read(10)
    terminal.close()
    assert not link.is_symlink()
