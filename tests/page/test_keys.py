"""The page's keys taken back while it is open, against a real daemon that asks for keys."""

from __future__ import annotations

import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from daemon.client import Client, NoAnswer
from daemon.domain.roles import ROLES
from daemon.tools.demo.processes import Process
from tests.page.conftest import PageProcess, free_port, state_is, write_people
from tests.station.rig import ROOT, STARTED_WITHIN_S, Rig, running_rig

pytestmark = pytest.mark.timeout(600)


def _keys(*arguments: str) -> None:
    ran = subprocess.run(
        [sys.executable, "-m", "daemon.cli", "keys", *arguments], cwd=ROOT, capture_output=True, text=True, check=False
    )
    assert ran.returncode == 0, ran.stderr


def _answers_to(key: Path) -> Any:
    """Return a wait for a daemon that answers to a key."""

    def wait(process: Process, control: str) -> None:
        give_up_s = time.monotonic() + STARTED_WITHIN_S
        with Client(control, timeout_s=1.0, keys=key) as client:
            while time.monotonic() < give_up_s:
                assert process.alive(), process.last_words()
                try:
                    if client.request("status")["lifecycle"] == "ready":
                        return
                except NoAnswer:
                    continue
        raise AssertionError(process.last_words())

    return wait


@pytest.fixture
def locked(browser: Any, tmp_path: Path) -> Iterator[PageProcess]:
    """A station that asks for keys, and a page that has one for each role."""
    own = tmp_path / "own"
    own.mkdir()
    with running_rig(tmp_path) as rig:
        rig.daemon.end()
        for role in ROLES:
            name = f"page-{role}"
            _keys("new", name, "--role", role, "--keys", str(tmp_path / "keys"), "--out", str(own / f"{name}.key"))
        settings = tmp_path / "station.toml"
        settings.write_text(settings.read_text().replace("[api]\n", '[api]\ncurve = true\nkeys_dir = "keys"\n'))
        rig.start_daemon(_answers_to(own / "page-observe.key"))
        write_people(tmp_path / "people")
        page = PageProcess(
            rig, browser, tmp_path / "people", free_port(), rig.control, tmp_path / "page.log", keys=own
        )  # fmt: skip
        with page.running():
            yield page


def _revoke(rig: Rig, name: str) -> None:
    _keys("revoke", name, "--config", str(rig.places.out / "station.toml"))


def test_18_keys_that_are_taken_back_while_the_page_is_open_are_said_with_their_cure(locked: PageProcess) -> None:
    tab = locked.tab("Lee")
    state_is(tab, "NOT HOMED")
    _revoke(locked.rig, "page-maintain")
    tab.locator("#home:enabled").click()
    tab.locator("#confirm").click()
    tab.wait_for_function("() => document.getElementById('dialog').textContent.includes('key was taken back')")
    state_is(tab, "NOT HOMED")
    tab.keyboard.press("Escape")
    _revoke(locked.rig, "page-observe")
    state_is(tab, "UNKNOWN")
    tab.wait_for_function("() => document.getElementById('banner').textContent.includes('key was taken back')")
    assert tab.locator("button.order:visible:enabled").count() == 0
