"""A file is the old one or the new one, on disk before it is named, and nothing is left beside it."""

from pathlib import Path

import pytest

from daemon.platform.atomic_file import replace_whole, written_beside
from tests.daemon.storage.disk_steps import Steps, disk_full


def _write(path: Path) -> None:
    path.write_text("new")


def test_a_file_is_replaced_in_folders_that_are_made_for_it(tmp_path: Path) -> None:
    file = tmp_path / "a" / "b" / "file.txt"
    replace_whole(file, _write)
    assert file.read_text() == "new"
    assert list(file.parent.iterdir()) == [file]


def test_the_content_is_flushed_before_the_name_and_the_name_after(tmp_path: Path) -> None:
    steps = Steps(0, lambda: None)
    with steps.watched():
        replace_whole(tmp_path / "file.txt", _write)
    order = [name for name in steps.taken if name in ("write", "fsync", "replace")]
    assert order == ["write", "fsync", "replace", "fsync"]


def test_a_folder_that_is_made_has_its_name_flushed_too(tmp_path: Path) -> None:
    steps = Steps(0, lambda: None)
    with steps.watched():
        replace_whole(tmp_path / "a" / "b" / "file.txt", _write)
    order = [name for name in steps.taken if name in ("mkdir", "fsync")]
    assert order[:4] == ["mkdir", "fsync", "mkdir", "fsync"]


@pytest.mark.parametrize("fails", ["writing", "flushing", "renaming"])
def test_a_file_that_cannot_be_written_leaves_the_old_one_and_nothing_beside(tmp_path: Path, fails: str) -> None:
    file = tmp_path / "file.txt"
    file.write_text("old")
    at = {"writing": "write", "flushing": "fsync", "renaming": "replace"}[fails]
    counted = Steps(0, lambda: None)
    with counted.watched():
        replace_whole(tmp_path / "other.txt", _write)
    steps = Steps(counted.taken.index(at) + 1, disk_full)
    with steps.watched(), pytest.raises(OSError, match="No space"):
        replace_whole(file, _write)
    assert file.read_text() == "old"
    assert {one.name for one in tmp_path.iterdir()} == {"file.txt", "other.txt"}


def test_a_new_file_that_is_not_moved_is_removed(tmp_path: Path) -> None:
    with written_beside(tmp_path / "file.txt", _write) as beside:
        assert beside.read_text() == "new"
        assert beside.parent == tmp_path
    assert list(tmp_path.iterdir()) == []
