"""Another configuration is taken over whole between two jobs, or refused whole with every reason."""

from __future__ import annotations

import asyncio
import contextlib
import os
from pathlib import Path
from typing import Any, get_args

import pytest

from daemon.config.current import CurrentSettings
from daemon.config.model import Config, ConfigError, load_config
from daemon.config.reload import LIVE, Change, Reloader, differences, read_change
from daemon.domain.board import Board
from daemon.tools.demo.settings import Places, write_settings

BOARD = """{"name": "b", "side": "top", "width_um": 1000.0, "height_um": 1000.0, "points": []}"""


@pytest.fixture
def file(tmp_path: Path) -> Path:
    (tmp_path / "board.json").write_text(BOARD)
    return write_settings(Places(tmp_path, tmp_path))


def _rewrite(file: Path, *changes: tuple[str, str]) -> None:
    text = file.read_text()
    for old, new in changes:
        assert old in text
        text = text.replace(old, new, 1)
    file.write_text(text)


def _refused(file: Path, old: Config) -> dict[str, str]:
    with pytest.raises(ConfigError) as caught:
        read_change(file, old)
    return dict(caught.value.problems)


def test_what_did_not_change_is_no_change(file: Path) -> None:
    old = load_config(file)
    assert read_change(file, old) == Change(old, read_change(file, old).board, ())


@pytest.mark.parametrize(
    ("change", "name"),
    [
        (('pictures = "all"', 'pictures = "none"'), "station.pictures"),
        (("origin_x_um = 60000.0", "origin_x_um = 61000.0"), "board.origin_x_um"),
        (("phase_deg = -3.054", "phase_deg = -3.0"), "head.phase_deg"),
        (("x_um = 30000.0", "x_um = 30001.0"), "control_point.x_um"),
        (("[api]", "[servo]\ntolerance_um = 20.0\n[api]"), "servo.tolerance_um"),
        (("[api]", "[api]\nqueue_length = 3"), "api.queue_length"),
    ],
)
def test_what_jobs_read_changes_live(file: Path, change: tuple[str, str], name: str) -> None:
    old = load_config(file)
    _rewrite(file, change)
    assert read_change(file, old).changed == (name,)


def test_a_section_that_comes_or_goes_is_a_change(file: Path) -> None:
    old = load_config(file)
    _rewrite(file, ("[control_point]", "[control_point_gone]"))
    text = file.read_text()
    start = text.index("[control_point_gone]")
    file.write_text(text[:start] + text[text.index("[board]") :])
    assert read_change(file, old).changed == ("control_point",)


@pytest.mark.parametrize(
    ("change", "name"),
    [
        (('name = "demo"', 'name = "other"'), "station.name"),
        (('data_dir = "station"', 'data_dir = "elsewhere"'), "station.data_dir"),
        (("baudrate = 115200", "baudrate = 19200"), "bus"),
        (("speed = 150000.0", "speed = 140000.0"), "axes.x"),
        (("safe_z_um = 12000.0", "safe_z_um = 11000.0"), "gantry.safe_z_um"),
        (("white = 0", "white = 2"), "lights.white"),
        (('encoding = "mjpg"', 'encoding = "bgr8"'), "camera.encoding"),
        (('control = "ipc', 'control = "ipc:///elsewhere'), "api.control"),
    ],
)
def test_what_was_given_to_a_device_or_a_socket_needs_a_restart_and_says_so(
    file: Path, change: tuple[str, str], name: str
) -> None:
    old = load_config(file)
    _rewrite(file, change, ("phase_deg = -3.054", "phase_deg = -3.0"))
    problems = _refused(file, old)
    assert list(problems) == [name], "the head may change, but not beside that"
    assert "restart" in problems[name]


def test_every_name_that_may_change_live_exists() -> None:
    for name in LIVE:
        section, _, field = name.partition(".")
        assert section in Config.model_fields
        if field:
            annotation: Any = Config.model_fields[section].annotation
            models = [one for one in get_args(annotation) or (annotation,) if one is not type(None)]
            assert all(field in model.model_fields for model in models)


def test_a_torn_file_an_unknown_key_and_a_missing_board_are_refused_with_their_places(file: Path) -> None:
    old = load_config(file)
    good = file.read_text()
    file.write_text(good[: len(good) // 2])
    assert _refused(file, old)
    file.write_text(good.replace("[api]", '[api]\nquick = "yes"'))
    assert list(_refused(file, old)) == ["api.quick"]
    file.write_text(good.replace('file = "board.json"', 'file = "gone.json"'))
    assert list(_refused(file, old)) == ["board.file"]


class Daemon:
    """What a reloader reaches of a daemon."""

    def __init__(self, file: Path | None, config: Config) -> None:
        self.config = config
        self.between = asyncio.Lock()
        self.said: asyncio.Queue[tuple[str, dict[str, object]]] = asyncio.Queue()
        self.reloader = Reloader(file, lambda: self.config, lambda: self.between, self.take, self.tell)

    def take(self, change: Change) -> None:
        assert self.between.locked()
        self.config = change.config

    async def tell(self, what: str, facts: dict[str, object]) -> None:
        self.said.put_nowait((what, facts))

    async def heard(self, count: int) -> list[tuple[str, dict[str, object]]]:
        return [await self.said.get() for _ in range(count)]

    def start(self) -> asyncio.Task[None]:
        return asyncio.create_task(self.reloader.run(busy=self.between.locked))


async def test_a_good_file_is_taken_over_and_a_bad_one_leaves_everything_as_it_was(file: Path) -> None:
    daemon = Daemon(file, load_config(file))
    serving = daemon.start()
    _rewrite(file, ("phase_deg = -3.054", "phase_deg = -3.0"))
    daemon.reloader.ask()
    assert await daemon.heard(2) == [("begun", {}), ("taken", {"changed": ["head.phase_deg"]})]
    assert daemon.config.head.phase_deg == -3.0
    kept = daemon.config
    _rewrite(file, ("phase_deg = -3.0", "phase_deg = nan"))
    daemon.reloader.ask()
    begun, (what, facts) = await daemon.heard(2)
    assert (begun[0], what) == ("begun", "refused")
    assert "head.phase_deg" in str(facts["problems"])
    assert daemon.config is kept
    serving.cancel()


async def test_a_good_file_waits_for_the_job_to_end(file: Path) -> None:
    daemon = Daemon(file, load_config(file))
    serving = daemon.start()
    await daemon.between.acquire()
    _rewrite(file, ("phase_deg = -3.054", "phase_deg = -3.0"))
    daemon.reloader.ask()
    assert [what for what, _ in await daemon.heard(2)] == ["begun", "waits"]
    assert daemon.config.head.phase_deg == -3.054
    _rewrite(file, ("phase_deg = -3.0", "phase_deg = -2.0"))
    daemon.between.release()
    assert [what for what, _ in await daemon.heard(1)] == ["taken"]
    assert daemon.config.head.phase_deg == -2.0, "what is in the file when it is taken over"
    serving.cancel()


async def test_a_daemon_without_a_file_says_so(file: Path) -> None:
    daemon = Daemon(None, load_config(file))
    serving = daemon.start()
    daemon.reloader.ask()
    _, (what, facts) = await daemon.heard(2)
    assert what == "refused"
    assert "without" in str(facts["problems"])
    serving.cancel()


def test_only_sections_are_compared_not_how_the_file_is_written(file: Path) -> None:
    old = load_config(file)
    file.write_text(file.read_text().replace("baudrate = 115200", "baudrate   =   115_200  # as delivered"))
    assert differences(old, load_config(file)) == ()


@pytest.mark.parametrize("spoil", ["nested", "pipe", "huge", "folder", "nested key"])
def test_a_file_of_another_kind_is_refused_whole_and_not_waited_for(file: Path, spoil: str) -> None:
    old = load_config(file)
    _spoil(file, spoil)
    assert set(_refused(file, old)) == {"(file)"}


def _spoil(file: Path, how: str) -> None:
    if how.startswith("nested"):
        file.write_text("a = " + "[" * 5000 if how == "nested" else "a" + ".a" * 50_000 + " = 1")
        return
    file.unlink()
    if how == "pipe":
        os.mkfifo(file)
    elif how == "folder":
        file.mkdir()
    else:
        file.write_text("#" * 2_000_000)


def test_a_board_that_is_a_pipe_is_refused_and_not_waited_for(file: Path) -> None:
    old = load_config(file)
    old.board.file.unlink()
    os.mkfifo(old.board.file)
    assert "no plain file" in _refused(file, old)["board.file"]


async def test_whatever_reading_raises_the_daemon_goes_on_with_what_it_had(
    file: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    said: asyncio.Queue[tuple[str, Any]] = asyncio.Queue()

    async def tell(what: str, facts: dict[str, Any]) -> None:
        await said.put((what, facts))

    def failing(_path: Path, _old: Config) -> Change:
        raise MemoryError("too much")

    monkeypatch.setattr("daemon.config.reload.read_change", failing)
    old = load_config(file)
    reloader = Reloader(file, lambda: old, contextlib.nullcontext, lambda _change: None, tell)  # type: ignore[arg-type]
    serving = asyncio.create_task(reloader.run(busy=lambda: False))
    for _ in range(2):
        reloader.ask()
        assert await said.get() == ("begun", {})
        what, facts = await said.get()
        assert what == "refused"
        assert facts["problems"] == [["(file)", "reading it failed: MemoryError: too much"]]
    serving.cancel()


def test_what_was_refused_stands_with_its_lines_until_a_file_is_taken(file: Path) -> None:
    settings = CurrentSettings(config := load_config(file), Board.load(config.board.file))
    assert settings.refused == ()
    good = file.read_text()
    file.write_text(good.replace("[api]", '[api]\nquick = "yes"'))
    with pytest.raises(ConfigError) as caught:
        read_change(file, config)
    settings.note_reload("refused", {"problems": [list(problem) for problem in caught.value.placed()]})
    settings.note_reload("begun", {})
    settings.note_reload("waits", {})
    line = file.read_text().splitlines().index('quick = "yes"') + 1
    assert len(settings.refused) == 1
    assert settings.refused[0].startswith("api.quick: ")
    assert settings.refused[0].endswith(f"(line {line})")
    settings.note_reload("taken", {"changed": []})
    assert settings.refused == ()
