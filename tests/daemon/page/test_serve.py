"""The page is not served where a password would go in clear, or where its keys are open to others."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from daemon.page.people import USERS_FILE, Users
from daemon.page.serve import CREDENTIALS, KEY_NAMES, BadServing, Serving, read_keys, refuse_unsafe
from daemon.wire.curve_keys import KeyTrouble, new_client


def _serving(tmp_path: Path, **fields: Any) -> Serving:
    return Serving("tcp://127.0.0.1:5555", None, tmp_path, **fields)


@pytest.mark.parametrize("host", ["0.0.0.0", "192.168.1.5", "::", "station-1"])  # noqa: S104  # nothing is bound
def test_an_address_that_others_reach_is_refused_without_tls(tmp_path: Path, host: str) -> None:
    with pytest.raises(BadServing, match="in clear") as caught:
        refuse_unsafe(_serving(tmp_path, host=host), Users(tmp_path / USERS_FILE))
    assert "--certificate" in caught.value.advice


@pytest.mark.parametrize("host", ["127.0.0.1", "localhost", "::1", "127.0.0.2"])
def test_loopback_needs_neither_tls_nor_users(tmp_path: Path, host: str) -> None:
    refuse_unsafe(_serving(tmp_path, host=host), Users(tmp_path / USERS_FILE))


def test_with_tls_somebody_has_to_be_able_to_log_in(tmp_path: Path) -> None:
    users = Users(tmp_path / USERS_FILE)
    serving = _serving(tmp_path, host="192.168.1.5", certificate=Path("c"), certificate_key=Path("k"))
    with pytest.raises(BadServing, match="nobody could log in"):
        refuse_unsafe(serving, users)
    users.add("Kim", "operate", "a long secret")
    refuse_unsafe(serving, users)


def test_a_certificate_alone_is_refused(tmp_path: Path) -> None:
    with pytest.raises(BadServing, match="needs its key"):
        refuse_unsafe(_serving(tmp_path, certificate=Path("c")), Users(tmp_path / USERS_FILE))


def test_the_page_is_called_by_the_names_of_the_machine_and_those_given(tmp_path: Path) -> None:
    names = _serving(tmp_path, names=("page.factory.lan",)).all_names()
    assert set(names) == {
        "localhost:8460", "127.0.0.1:8460", "[::1]:8460", "page.factory.lan", "page.factory.lan:8460",
    }  # fmt: skip


def test_each_role_has_a_key_of_its_own_and_an_open_one_is_refused(tmp_path: Path) -> None:
    for role, name in KEY_NAMES.items():
        new_client(tmp_path / "keys", name, role, tmp_path / f"{name}.key")
    keys = read_keys(tmp_path)
    assert keys is not None
    assert {role: key.name for role, key in keys.items()} == {role: f"page-{role}" for role in KEY_NAMES}
    (tmp_path / "page-maintain.key").chmod(0o644)
    with pytest.raises(KeyTrouble, match="open to others"):
        read_keys(tmp_path)
    assert read_keys(None) is None


def test_keys_that_systemd_hands_over_are_read_and_one_that_is_missing_is_said(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    handed = tmp_path / "handed"
    handed.mkdir()
    monkeypatch.setenv(CREDENTIALS, str(handed))
    assert read_keys(handed) is None, "the daemon asks for no keys"
    for role, name in KEY_NAMES.items():
        new_client(tmp_path / "keys", name, role, handed / f"page_{name}.key")
    keys = read_keys(handed)
    assert keys is not None
    assert keys["observe"].name == "page-observe"
    (handed / "page_page-operate.key").unlink()
    with pytest.raises(KeyTrouble, match="page-operate"):
        read_keys(handed)
