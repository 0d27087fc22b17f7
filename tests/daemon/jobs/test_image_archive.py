"""Pictures are a ring with a quota, and a full disk never stops the daemon."""

from __future__ import annotations

import os
import re
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from daemon.domain.results import JobResult
from daemon.jobs.image_archive import ImageArchive
from daemon.platform.clock import utc_now
from daemon.wire.operations.jobs import Correct, Look
from vision import NotFound, Reason


def _look() -> Any:
    frame = SimpleNamespace(pixels=np.random.default_rng(1).integers(0, 255, (240, 320, 3), dtype=np.uint8))
    missing = NotFound(Reason.NO_NEEDLE, "nothing looks like it")
    return SimpleNamespace(white=frame, red=frame, tip=missing, seen=None, expected_tip_px=(100.0, 100.0))


def _job() -> Any:
    return SimpleNamespace(first_look=_look(), last_look=None, looks=1)


def _result(job_id: str) -> JobResult:
    return JobResult(id=job_id, op="correct", ok=False, seq=1, station="s", finished_at=utc_now(), outcome="failed")


def _request(job_id: str = "a") -> Correct:
    return Correct(op="correct", id=job_id, test_point="TP1")


@pytest.mark.parametrize(
    ("which", "failed", "kept"),
    [("all", False, True), ("failed", False, False), ("failed", True, True), ("none", True, False)],
)
def test_which_jobs_keep_pictures(tmp_path: Path, which: Any, failed: bool, kept: bool) -> None:
    folder = ImageArchive(tmp_path, which, 10.0).folder_for(_request(), failed=failed)
    assert (folder is not None) == kept


def test_a_look_that_asks_for_pictures_gets_them(tmp_path: Path) -> None:
    assert ImageArchive(tmp_path, "none", 10.0).folder_for(Look(op="look", id="a", pictures=True), failed=False)


@pytest.mark.parametrize("job_id", ["../../etc/passwd", "a/b", ".", "..", "ä ö", "x" * 128])
def test_no_id_leaves_the_folder(tmp_path: Path, job_id: str) -> None:
    folder = ImageArchive(tmp_path, "all", 10.0).folder_for(_request(job_id), failed=False)
    assert folder is not None
    assert folder.resolve().parent == tmp_path.resolve()
    assert folder.resolve() != tmp_path.resolve()


def test_ids_that_look_alike_keep_apart(tmp_path: Path) -> None:
    pictures = ImageArchive(tmp_path, "all", 10.0)
    assert pictures.folder_for(_request("a/b"), failed=False) != pictures.folder_for(_request("a_b"), failed=False)


HOSTILE = [
    "..", ".", "...", "../../etc/passwd", "/etc/passwd", "a/../b", "a\\b", "C:\\x", "nul\x00byte", "line\nbreak",
    "\u202egpj", "~root", "$(reboot)", "`x`", "; rm -rf /", "a" * 128, "\U0001f600" * 128, "\u00e4\u0308" * 64, " ",
    "-rf", "a_b", "a/b",
]  # fmt: skip


def test_no_id_reaches_beyond_its_own_folder(tmp_path: Path) -> None:
    pictures = ImageArchive(tmp_path, "all", 10.0)
    folders = [pictures.folder_for(_request(job_id), failed=False) for job_id in HOSTILE]
    for folder in folders:
        assert folder is not None
        assert folder.parent == tmp_path
        assert re.fullmatch(r"[A-Za-z0-9_~-][A-Za-z0-9._~-]{0,80}", folder.name)
        folder.mkdir()
        assert folder.resolve().parent == tmp_path.resolve()
    assert len(set(folders)) == len(HOSTILE)
    made = folders[HOSTILE.index("a/b")]
    assert made is not None
    assert pictures.folder_for(_request(made.name), failed=False) != made, "an id that looks like another's folder"


async def test_the_oldest_go_beyond_the_quota(tmp_path: Path) -> None:
    pictures = ImageArchive(tmp_path, "all", 0.4)
    names = [f"job{n}" for n in range(8)]
    for n, name in enumerate(names):
        await pictures.keep(tmp_path / name, _job(), _result(name))
        if (tmp_path / name).exists():
            os.utime(tmp_path / name, (n, n))
    left = sorted(folder.name for folder in tmp_path.iterdir())
    assert left == names[-len(left) :]
    assert 1 <= len(left) < len(names)
    assert {"before-white.jpg", "before-red.jpg", "before-tip.jpg", "result.json"} == {
        file.name for file in (tmp_path / names[-1]).iterdir()
    }


async def test_a_disk_that_takes_nothing_is_told_and_left_again(tmp_path: Path) -> None:
    pictures = ImageArchive(tmp_path, "all", 10.0)
    (tmp_path / "job").write_text("a file where the folder should be")
    await pictures.keep(tmp_path / "job", _job(), _result("job"))
    assert pictures.full is not None
    await pictures.keep(tmp_path / "job2", _job(), _result("job2"))
    assert pictures.full is None


async def test_the_quota_removes_only_what_the_daemon_made(tmp_path: Path) -> None:
    folder, elsewhere = tmp_path / "pictures", tmp_path / "elsewhere"
    elsewhere.mkdir()
    (elsewhere / "before-white.jpg").write_bytes(b"x" * 100_000)
    (elsewhere / "result.json").write_text('{"id": "link"}')
    foreign = folder / "holiday"
    foreign.mkdir(parents=True)
    (foreign / "beach.jpg").write_bytes(b"x" * 1_000_000)
    copied = folder / "keep-these"
    copied.mkdir()
    (copied / "before-white.jpg").write_bytes(b"x" * 100_000)
    (copied / "result.json").write_text('{"id": "job0"}')
    (folder / "link").symlink_to(elsewhere)
    (folder / "note.txt").write_text("mine")
    pictures = ImageArchive(folder, "all", 0.001)
    await pictures.keep(folder / "job0", _job(), _result("job0"))
    (folder / "job0" / "remark.txt").write_text("a person's")
    (folder / "job0" / "after-white.jpg").symlink_to(elsewhere / "before-white.jpg")
    os.utime(folder / "job0", (1, 1))
    await pictures.keep(folder / "job1", _job(), _result("job1"))
    os.utime(folder / "job1", (2, 2))
    await pictures.keep(folder / "job2", _job(), _result("job2"))
    assert pictures.full is None
    assert sorted(f.name for f in folder.iterdir()) == ["holiday", "job0", "job2", "keep-these", "link", "note.txt"]
    assert sorted(f.name for f in (folder / "job0").iterdir()) == ["after-white.jpg", "remark.txt"]
    assert (foreign / "beach.jpg").exists()
    assert (copied / "before-white.jpg").exists()
    assert sorted(f.name for f in elsewhere.iterdir()) == ["before-white.jpg", "result.json"]


async def test_nothing_is_written_through_a_link(tmp_path: Path) -> None:
    folder, elsewhere = tmp_path / "pictures", tmp_path / "elsewhere"
    elsewhere.mkdir()
    folder.mkdir()
    (folder / "job").symlink_to(elsewhere)
    pictures = ImageArchive(folder, "all", 10.0)
    await pictures.keep(folder / "job", _job(), _result("job"))
    assert pictures.full is not None
    assert list(elsewhere.iterdir()) == []
    victim = tmp_path / "victim"
    victim.write_text("untouched")
    (folder / "job2").mkdir()
    (folder / "job2" / "before-white.jpg").symlink_to(victim)
    await pictures.keep(folder / "job2", _job(), _result("job2"))
    assert victim.read_text() == "untouched"
