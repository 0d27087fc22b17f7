"""A support bundle holds what helps and no secret, wherever one was planted."""

from __future__ import annotations

import json
import tarfile
from pathlib import Path
from typing import Annotated

import pytest
from pydantic import BaseModel, Field, SecretStr
from typer.testing import CliRunner

from daemon.cli.app import app
from daemon.domain.results import ErrorBody, JobResult
from daemon.platform.clock import utc_now
from daemon.storage.journal import Journal
from daemon.tools.demo.settings import Places, write_settings
from daemon.tools.support_bundle import Bundle, collect, without_secrets
from daemon.wire.curve_keys import new_server

PLANTED = "planted-Zz9-secret"
JPEG = b"\xff\xd8\xff\xe0 a picture \xff\xd9"
ROOM = 1_000_000


@pytest.fixture
def station(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A configuration of a station whose daemon does not run."""
    monkeypatch.setattr("daemon.tools.support_bundle.ASK_WITHIN_S", 0.02)
    return write_settings(Places(tmp_path, tmp_path))


async def _fill(folder: Path, message: str = "not there") -> Path:
    pictures = folder / "pictures" / "j1"
    pictures.mkdir(parents=True)
    journal = await Journal.open(folder / "journal.sqlite")
    result = JobResult(
        id="j1", op="correct", ok=False, seq=1, station="demo", finished_at=utc_now(), outcome="failed",
        pictures=str(pictures), error=ErrorBody(code=2101, name="tip_not_found", message=message, advice="look"),
    )  # fmt: skip
    await journal.add_job("j1", "correct", '{"op": "correct"}')
    await journal.finish_job(result)
    await journal.close()
    (pictures / "before-white.jpg").write_bytes(JPEG)
    (pictures / "result.json").write_text(result.model_dump_json())
    return pictures


def _contents(bundle: Bundle) -> bytes:
    return (
        b"\n".join(name.encode() + data for name, data in bundle.parts.items()) + json.dumps(bundle.left_out).encode()
    )


async def test_it_holds_configuration_journal_and_the_pictures_of_what_failed(station: Path) -> None:
    await _fill(station.parent / "station")
    bundle, name = collect(station, pictures_bytes=ROOM, unit="no-such.service")
    assert name == "demo"
    assert {"config.json", "versions.json", "journal.jsonl", "pictures/j1/before-white.jpg"} <= bundle.parts.keys()
    assert json.loads(bundle.parts["journal.jsonl"])["result"]["error"]["name"] == "tip_not_found"
    assert json.loads(bundle.parts["config.json"])["gantry"]["safe_z_um"] == 12000.0
    assert {"metrics.txt", "snapshot.json", "log.txt"} <= bundle.left_out.keys()


async def test_no_planted_secret_gets_in(station: Path) -> None:
    folder = station.parent / "station"
    pictures = await _fill(folder)
    key = station.parent / "server.secret"
    key.write_bytes(JPEG + PLANTED.encode())
    (pictures / "before-red.jpg").symlink_to(key)
    (pictures / "notes.txt").write_text(PLANTED)
    (pictures / "after-white.jpg").write_text(PLANTED)
    (pictures / "more.json").write_text(f'{{"id": "{PLANTED}"}}')
    (folder / "calibration").mkdir()
    (folder / "calibration" / "map.json").write_text(f'{{"what": "{PLANTED}"}}')
    (folder / "calibration" / "key.json").symlink_to(key)
    (folder / "client.key").write_text(PLANTED)
    station.write_text(f"# {PLANTED}\n" + station.read_text())
    bundle, _ = collect(station, pictures_bytes=ROOM, unit="no-such.service")
    assert PLANTED.encode() not in _contents(bundle)
    assert set(bundle.parts) >= {"pictures/j1/before-white.jpg", "config.json"}
    assert bundle.left_out["pictures/j1/before-red.jpg"] == "it is a link"


async def test_the_stations_own_key_is_looked_for_in_every_part(station: Path) -> None:
    """A secret that found its way into a message keeps that part out."""
    folder = station.parent / "station"
    secret = new_server(folder / "keys").secret
    await _fill(folder, message=f"refused {secret}")
    bundle, _ = collect(station, pictures_bytes=ROOM, unit="no-such.service")
    assert secret.encode() not in _contents(bundle)
    assert bundle.left_out["journal.jsonl"] == "it holds a secret of this station"


def test_of_a_bad_configuration_only_the_places_are_told(station: Path) -> None:
    station.write_text(station.read_text() + f'\n[api2]\npassword = "{PLANTED}"\n')
    bundle, _ = collect(station, pictures_bytes=ROOM, unit="no-such.service")
    assert PLANTED.encode() not in _contents(bundle)
    assert json.loads(bundle.parts["config-problems.json"]) == ["api2"]


class _Inner(BaseModel):
    token: SecretStr = SecretStr(PLANTED)
    marked: Annotated[str, Field(json_schema_extra={"secret": True})] = PLANTED
    plain: int = 3


class _Outer(BaseModel):
    inner: _Inner = _Inner()
    many: dict[str, _Inner] = {"a": _Inner()}
    some: tuple[_Inner, ...] = (_Inner(),)


def test_what_the_model_calls_secret_is_removed_at_any_depth() -> None:
    shown = without_secrets(_Outer())
    assert PLANTED not in json.dumps(shown)
    assert shown["many"]["a"] == {"token": "(removed)", "marked": "(removed)", "plain": 3}


async def test_pictures_stay_within_their_room(station: Path) -> None:
    await _fill(station.parent / "station")
    bundle, _ = collect(station, pictures_bytes=10, unit="no-such.service")
    assert not [name for name in bundle.parts if name.startswith("pictures/")]
    assert "more than there is room for" in bundle.left_out["pictures/j1"]


async def test_the_command_writes_an_archive_that_only_its_owner_reads(station: Path) -> None:
    await _fill(station.parent / "station")
    archive = station.parent / "b.tar.gz"
    done = CliRunner().invoke(app, ["bundle", "--config", str(station), "-o", str(archive)])
    assert done.exit_code == 0, done.output
    assert archive.stat().st_mode & 0o077 == 0
    with tarfile.open(archive) as parts:
        listed = parts.extractfile("reprobe-bundle/manifest.json")
        assert listed is not None
        manifest = json.load(listed)
        names = {name.removeprefix("reprobe-bundle/") for name in parts.getnames()}
    assert names == {*manifest["parts"], "manifest.json"}
