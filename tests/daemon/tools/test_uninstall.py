"""What install laid out goes; what a person made goes only when the person says so."""

from __future__ import annotations

from pathlib import Path

import pytest
from typer.testing import CliRunner

from daemon.cli.app import app
from daemon.platform.instance_lock import alone

pytestmark = pytest.mark.usefixtures("logging_as_before")


def _run(*words: str) -> tuple[int, str]:
    done = CliRunner().invoke(app, list(words))
    return done.exit_code, done.output


def _files(root: Path) -> set[str]:
    return {str(p.relative_to(root)) for p in root.rglob("*") if p.is_symlink() or p.is_file()}


@pytest.fixture
def root(tmp_path: Path) -> Path:
    """An installed station that has worked."""
    assert _run("install", "--root", str(tmp_path), "--instance", "left")[0] == 0
    (tmp_path / "etc/reprobe/station.toml").write_text("mine")
    for state in ("reprobe", "reprobe-left"):
        (tmp_path / "var/lib" / state).mkdir(parents=True)
        (tmp_path / "var/lib" / state / "journal.sqlite").write_text("a journal")
    return tmp_path


def test_nothing_that_install_made_is_left_and_nothing_of_a_persons_is_gone(root: Path) -> None:
    (root / "etc/unrelated").write_text("another's")
    code, said = _run("uninstall", "--root", str(root))
    assert code == 0, said
    left = _files(root)
    assert {name for name in left if not name.startswith(("etc/reprobe/", "var/lib/reprobe"))} == {"etc/unrelated"}
    assert {"etc/reprobe/station.toml", "var/lib/reprobe/journal.sqlite"} <= left
    assert "kept" in said


def test_configuration_and_state_go_when_they_are_named(root: Path) -> None:
    rules = root / "etc/udev/rules.d/70-reprobe.rules"
    rules.write_text("my own serial numbers")
    assert _run("uninstall", "--root", str(root), "--yes", "--configuration")[0] == 0
    assert not rules.exists()
    assert not (root / "etc/reprobe").exists()
    assert (root / "var/lib/reprobe-left/journal.sqlite").exists()
    assert _run("uninstall", "--root", str(root), "--yes", "--state")[0] == 0
    assert _files(root) == set()


def test_edited_rules_stay_like_a_configuration(root: Path) -> None:
    rules = root / "etc/udev/rules.d/70-reprobe.rules"
    rules.write_text("my own serial numbers")
    _run("uninstall", "--root", str(root), "--yes")
    assert rules.read_text() == "my own serial numbers"


def test_nothing_is_taken_from_below_a_running_daemon(root: Path) -> None:
    before = _files(root)
    with alone(root / "var/lib/reprobe-left"):
        code, said = _run("uninstall", "--root", str(root), "--yes", "--state")
    assert code == 1
    assert "systemctl disable --now" in said
    assert _files(root) >= before


def test_a_place_where_nothing_is_installed_is_said(tmp_path: Path) -> None:
    code, said = _run("uninstall", "--root", str(tmp_path))
    assert code == 1
    assert "nothing of reprobe is installed" in said
