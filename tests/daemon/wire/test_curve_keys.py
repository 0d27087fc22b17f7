"""Keys are made, listed and taken back; what others could read or change is refused with what to do."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from daemon.server.keyring import Keyring
from daemon.wire.curve_keys import (
    CLIENTS,
    REVOKED,
    KeyTrouble,
    clients,
    new_client,
    new_server,
    read_client,
    read_private,
    revoke,
)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    return tmp_path / "keys"


def _mode(path: Path) -> int:
    return path.stat().st_mode & 0o777


def test_a_new_client_gets_a_private_file_and_the_station_keeps_no_secret_of_it(folder: Path, tmp_path: Path) -> None:
    listed = new_client(folder, "tester-1", "operate", tmp_path / "tester-1.key")
    private = read_private(tmp_path / "tester-1.key")
    assert (private.name, private.public, private.server) == ("tester-1", listed.public, new_server(folder).public)
    kept = "".join(path.read_text() for path in folder.rglob("*") if path.is_file())
    assert private.secret not in kept
    assert private.secret not in repr(private)
    assert _mode(folder) == _mode(folder / CLIENTS) == 0o700
    assert _mode(tmp_path / "tester-1.key") == _mode(folder / "server.key") == 0o600


def test_the_station_keeps_its_key_when_another_client_comes(folder: Path, tmp_path: Path) -> None:
    new_client(folder, "a", "observe", tmp_path / "a.key")
    first = new_server(folder)
    new_client(folder, "b", "maintain", tmp_path / "b.key")
    assert new_server(folder) == first
    assert [(key.name, key.role) for key in clients(folder)] == [("a", "observe"), ("b", "maintain")]


@pytest.mark.parametrize("name", ["", "../up", "a/b", ".hidden", "a b", "x" * 65, 'a"', "a\n"])
def test_a_name_that_is_no_file_name_is_refused(folder: Path, tmp_path: Path, name: str) -> None:
    with pytest.raises(KeyTrouble, match="no name"):
        new_client(folder, name, "observe", tmp_path / "x.key")
    with pytest.raises(KeyTrouble, match="no key of the name"):
        revoke(folder, name)
    assert not folder.exists()


def test_neither_a_name_nor_a_file_is_taken_twice(folder: Path, tmp_path: Path) -> None:
    new_client(folder, "a", "observe", tmp_path / "a.key")
    with pytest.raises(KeyTrouble, match="there is a key"):
        new_client(folder, "a", "maintain", tmp_path / "other.key")
    with pytest.raises(KeyTrouble, match="exists already"):
        new_client(folder, "b", "observe", tmp_path / "a.key")


def test_a_revoked_key_is_still_told_of(folder: Path, tmp_path: Path) -> None:
    new_client(folder, "a", "observe", tmp_path / "a.key")
    revoke(folder, "a")
    assert clients(folder) == []
    assert [key.name for key in clients(folder, REVOKED)] == ["a"]
    new_client(folder, "a", "observe", tmp_path / "again.key")
    revoke(folder, "a")
    assert [key.name for key in clients(folder, REVOKED)] == ["a", "a"]


@pytest.mark.parametrize(
    ("part", "mode", "advice"),
    [
        ("server.key", 0o640, "chmod 0600"),
        (".", 0o750, "chmod 0700"),
        ("clients", 0o777, "chmod 0755"),
        ("clients/a.toml", 0o666, "chmod 0644"),
    ],
)
def test_what_is_too_open_is_refused_at_start_with_what_to_do(
    folder: Path, tmp_path: Path, part: str, mode: int, advice: str
) -> None:
    new_client(folder, "a", "observe", tmp_path / "a.key")
    (folder / part).chmod(mode)
    with pytest.raises(KeyTrouble, match="open to others") as caught:
        Keyring(folder, {})
    assert caught.value.advice.startswith(advice)


def test_a_private_key_that_others_can_read_is_not_used(folder: Path, tmp_path: Path) -> None:
    new_client(folder, "a", "observe", tmp_path / "a.key")
    (tmp_path / "a.key").chmod(0o644)
    with pytest.raises(KeyTrouble, match="open to others"):
        read_private(tmp_path / "a.key")


@pytest.mark.parametrize(
    "text", ["", "name = 3", "not toml", 'name = "a"\nrole = "king"', 'name="a"\nrole="observe"\npublic="short"']
)
def test_a_damaged_file_says_so(tmp_path: Path, text: str) -> None:
    path = tmp_path / "a.toml"
    path.write_text(text)
    path.chmod(0o600)
    for read in (read_client, read_private):
        with pytest.raises(KeyTrouble):
            read(path)


def test_the_list_is_followed_while_it_changes(folder: Path, tmp_path: Path) -> None:
    a = new_client(folder, "a", "observe", tmp_path / "a.key")
    ring = Keyring(folder, {})
    assert ring.find(a.public) == a
    b = new_client(folder, "b", "maintain", tmp_path / "b.key")
    assert ring.find(b.public) == b
    assert ring.removals == 0
    revoke(folder, "a")
    assert ring.find(a.public) is None
    assert ring.find(b.public) == b
    assert ring.removals == 1


def test_a_running_daemon_lets_nobody_in_by_a_file_that_others_could_change(folder: Path, tmp_path: Path) -> None:
    a = new_client(folder, "a", "observe", tmp_path / "a.key")
    ring = Keyring(folder, {})
    b = new_client(folder, "b", "maintain", tmp_path / "b.key")
    (folder / CLIENTS / "b.toml").chmod(0o666)
    assert ring.find(b.public) is None
    assert ring.find(a.public) == a
    (folder / CLIENTS).chmod(0o777)
    os.utime(folder / CLIENTS)
    assert ring.find(a.public) is None


def test_a_list_that_is_gone_lets_nobody_in(folder: Path, tmp_path: Path) -> None:
    a = new_client(folder, "a", "observe", tmp_path / "a.key")
    ring = Keyring(folder, {})
    (folder / CLIENTS).rename(folder / "elsewhere")
    assert ring.find(a.public) is None
    assert ring.removals == 1


def test_credentials_stand_in_for_the_folder(folder: Path, tmp_path: Path) -> None:
    a = new_client(folder, "a", "observe", tmp_path / "a.key")
    given = tmp_path / "credentials"
    given.mkdir()
    (given / "server.key").write_text((folder / "server.key").read_text())
    (given / "clients_a.toml").write_text((folder / CLIENTS / "a.toml").read_text())
    ring = Keyring(tmp_path / "nowhere", {"CREDENTIALS_DIRECTORY": str(given)})
    assert ring.server == new_server(folder)
    assert ring.find(a.public) == a
