"""A hang-up that comes while the daemon is still being loaded ends nothing."""

from __future__ import annotations

import subprocess
import sys
import textwrap
from pathlib import Path

import pytest


@pytest.mark.parametrize("name", ["serve", "run"], ids=["by its name", "by its old name"])
def test_a_hangup_while_the_daemon_is_loaded_does_not_kill_it(tmp_path: Path, name: str) -> None:
    program = textwrap.dedent(
        """
        import importlib.abc, os, signal, sys

        class Hangup(importlib.abc.MetaPathFinder):
            def find_spec(self, name, path, target=None):
                if name == "daemon.cli.serve":
                    os.kill(os.getpid(), signal.SIGHUP)

        sys.meta_path.insert(0, Hangup())
        sys.argv = ["reprobe", sys.argv[2], "--config", sys.argv[1]]
        from daemon.cli import main
        try:
            main()
        finally:
            from daemon.platform.early_hangup import came
            print("came:", came())
        """
    )
    missing = str(tmp_path / "none.toml")
    ended = subprocess.run([sys.executable, "-c", program, missing, name], capture_output=True, text=True, check=False)
    assert ended.returncode == 2, "ended by what is wrong with its configuration, and not by the signal"
    assert "came: True" in ended.stdout
    assert "Traceback" not in ended.stderr
