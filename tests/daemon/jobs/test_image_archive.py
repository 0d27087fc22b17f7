"""Pictures are a ring with a quota, and a full disk never stops the daemon."""

from __future__ import annotations

import asyncio
import hashlib
import os
import re
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from daemon.domain.point_test import PointRecord, PointVerdict
from daemon.domain.results import JobResult
from daemon.domain.states import State
from daemon.jobs.context import JobContext
from daemon.jobs.image_archive import ImageArchive
from daemon.platform.clock import utc_now
from daemon.station.station import LookResult
from daemon.wire.operations.jobs import Correct, Look
from drivers.deadline import Deadline
from drivers.gantry import Position
from tests.daemon.procedures.fake_station import found_tip
from vision import NotFound, Reason
from vision.annotate import Landing


def _look() -> Any:
    frame = SimpleNamespace(pixels=np.random.default_rng(1).integers(0, 255, (240, 320, 3), dtype=np.uint8), jpeg=None)
    missing = NotFound(Reason.NO_NEEDLE, "nothing looks like it")
    return SimpleNamespace(white=frame, red=frame, tip=missing, seen=None, board=None, landing=None,
                           expected_tip_px=(100.0, 100.0))  # fmt: skip


def _job() -> Any:
    return SimpleNamespace(pictured=lambda **_: (_look(), None))


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


def _record(verdict: PointVerdict, looks: int = 2) -> PointRecord:
    return PointRecord(
        point="U1.14", net="CLK", board_id=None, method="continuity", limits=None, verdict=verdict, looks=looks,
        seconds=1.0, at=utc_now(),
    )  # fmt: skip


@pytest.mark.parametrize(
    ("which", "verdict", "kept"),
    [
        ("all", PointVerdict.PASS_FIRST, True),
        ("failed", PointVerdict.PASS_FIRST, False),
        ("failed", PointVerdict.PASS_RECOVERED, True),
        ("failed", PointVerdict.CONTACT_NOT_MADE, True),
        ("none", PointVerdict.CONTACT_NOT_MADE, False),
    ],
)
def test_which_points_keep_pictures(tmp_path: Path, which: Any, verdict: PointVerdict, kept: bool) -> None:
    pictures = ImageArchive(tmp_path, which, 10.0)
    assert (pictures.folder_for_point("run-1", _record(verdict)) is not None) == kept
    assert pictures.folder_for_point("run-1", _record(verdict, looks=0)) is None


async def test_each_point_of_a_job_has_a_folder_of_its_own_that_goes_with_the_quota(tmp_path: Path) -> None:
    pictures, record = ImageArchive(tmp_path, "all", 0.1), _record(PointVerdict.PASS_RECOVERED)
    first = pictures.folder_for_point("run-1", record)
    second = pictures.folder_for_point("run-2", record)
    assert first is not None
    assert second is not None
    await pictures.keep_point(first, "run-1", (_look(), _look()), record)
    names = {file.name for file in first.iterdir()}
    assert {"before-white.jpg", "before-red.jpg", "after-white.jpg", "after-red.jpg", "result.json"} <= names
    os.utime(first, (1.0, 1.0))
    await pictures.keep_point(second, "run-2", (_look(), None), record)
    assert not first.exists()
    assert second.exists()


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


async def test_a_frame_is_kept_as_the_camera_coded_it(tmp_path: Path) -> None:
    """Coded a second time it would not be what was judged."""
    archive, look = ImageArchive(tmp_path, "all", 10.0), _look()
    look.white.jpeg = b"as it came"
    folder = archive.folder_for(_request(), failed=False)
    assert folder is not None
    job: Any = SimpleNamespace(pictured=lambda **_: (look, None))
    await archive.keep(folder, job, _result("a"))
    assert (folder / "before-white.jpg").read_bytes() == b"as it came"


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


async def test_kept_pictures_are_listed_and_read_by_job_and_name_alone(tmp_path: Path) -> None:
    archive = ImageArchive(tmp_path / "pictures", "all", 10.0)
    folder = archive.folder_for(_request("board/7"), failed=False)
    assert folder is not None
    await archive.keep(folder, _job(), _result("board/7"))
    assert list(await archive.hashes_of("board/7")) == ["before-white", "before-red", "before-tip"]
    white = await archive.picture("board/7", "before-white")
    assert white is not None
    assert white[:2] == b"\xff\xd8"
    assert (await archive.hashes_of("board/7"))["before-white"] == hashlib.sha256(white).hexdigest()
    assert await archive.hashes_of("nobody") == {}
    for which in ("after-white", "result", "../board_7/before-white", "before-white.jpg", "before-white/", ""):
        assert await archive.picture("board/7", which) is None, which


async def test_a_link_in_the_place_of_a_picture_or_its_folder_is_not_followed(tmp_path: Path) -> None:
    archive = ImageArchive(tmp_path / "pictures", "all", 10.0)
    folder = archive.folder_for(_request("a"), failed=False)
    assert folder is not None
    await archive.keep(folder, _job(), _result("a"))
    secret = tmp_path / "secret"
    secret.write_text("secret")
    (folder / "before-white.jpg").unlink()
    (folder / "before-white.jpg").symlink_to(secret)
    assert "before-white" not in await archive.hashes_of("a")
    assert await archive.picture("a", "before-white") is None
    (tmp_path / "pictures" / "b").symlink_to(folder)
    assert await archive.hashes_of("b") == {}
    assert await archive.picture("b", "before-red") is None


async def test_a_pipe_in_the_place_of_a_picture_or_its_numbers_is_not_waited_for(tmp_path: Path) -> None:
    archive = ImageArchive(tmp_path / "pictures", "all", 10.0)
    folder = archive.folder_for(_request("a"), failed=False)
    assert folder is not None
    folder.mkdir(parents=True)
    os.mkfifo(folder / "before-white.jpg")
    async with asyncio.timeout(20.0):
        assert await archive.picture("a", "before-white") is None
        await archive.keep(folder, _job(), _result("a"))
    assert archive.full is not None, "that it was not kept is told"


async def test_looks_that_found_the_target_leave_a_picture_of_where_the_needle_comes_down(tmp_path: Path) -> None:
    job = _context()
    for off_um in (287.0, 4.0):
        look = _seen()
        job.saw(look)
        job.aimed(replace(look, landing=_landing(off_um)))
    job.saw(_seen())
    assert job.first_look is not None
    assert job.first_look.landing is not None
    assert job.first_look.landing.off_um == 287.0
    await ImageArchive(tmp_path, "all", 10.0).keep(tmp_path / "job", job, _result("job"))
    assert {file.name for file in (tmp_path / "job").glob("*landing*")} == {"before-landing.jpg"}
    job.forget_looks()
    assert (job.first_look, job.last_look, job.pictured()) == (None, None, (None, None))


async def test_a_look_at_the_tip_before_a_touch_leaves_the_picture_of_where_the_needle_comes_down(
    tmp_path: Path,
) -> None:
    job = _context()
    for off_um in (287.0, 4.0):
        look = _seen()
        job.saw(look)
        job.aimed(replace(look, landing=_landing(off_um)))
    hovering = replace(_seen(), red=None, tip=found_tip(100.0, 100.0))
    job.saw(hovering)
    assert job.pictured(failed=True)[1] is hovering
    well = _result("job").model_copy(update={"ok": True})
    await ImageArchive(tmp_path, "all", 10.0).keep(tmp_path / "job", job, well)
    assert {file.name for file in (tmp_path / "job").glob("*landing*")} == {"before-landing.jpg", "after-landing.jpg"}


async def test_a_last_look_that_did_not_find_the_tip_is_pictured(tmp_path: Path) -> None:
    job = _context()
    job.saw(_seen())
    lost = replace(_seen(), red=None, tip=NotFound(Reason.NO_NEEDLE, "nothing looks like it"))
    job.saw(lost)
    assert job.pictured()[1] is lost


async def test_what_is_seen_elsewhere_is_not_pictured() -> None:
    job = _context()
    own = _seen()
    job.saw(own)
    with job.looks_elsewhere():
        job.saw(_seen())
    assert (job.last_look, job.pictured(), job.looks) == (own, (own, None), 2)


def _context() -> JobContext:
    async def keep(_kind: str, _body: dict[str, Any]) -> None:
        return None

    return JobContext(_request(), Deadline(1e9), lambda _event: State.LOOK, keep, lambda *_: None)


def _landing(off_um: float) -> Landing:
    return Landing((100.0, 100.0), (104.0, 108.0), (120.0, 110.0), None, off_um)


def _seen() -> LookResult:
    frame: Any = SimpleNamespace(pixels=np.full((240, 320, 3), 120, dtype=np.uint8), jpeg=None)
    return LookResult(frame, frame, Position(0.0, 0.0, 0.0, 0.0), None, None)
