"""A copy of the project in which one file at a time is spoiled and its tests are run; the checkout is never touched."""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Self

from tests.bench.mutants.core_files import CoreFile
from tests.bench.mutants.operators import Mutant

PARTS = ("daemon", "drivers", "vision", "sim_hw", "tests", "systemd", "doc", "pyproject.toml", "README.md")
LEFT_OUT = shutil.ignore_patterns("__pycache__", ".*")
PYTEST = (
    sys.executable, "-m", "pytest", "-x", "-q", "-p", "no:cacheprovider", "-p", "no:reprobe", "--basetemp",
)  # fmt: skip
"""The project's own plugin is left out: it is found by its installed name, and what is tested is a copy."""


@dataclass(frozen=True, slots=True)
class Run:
    """How a run of tests ended: status None is a timeout."""

    status: int | None
    output: str
    took_s: float

    @property
    def passed(self) -> bool:
        """Whether every test passed."""
        return self.status == 0


class Workshop:
    """A temporary copy of the project; a context manager that leaves nothing behind, no file and no process."""

    def __init__(self, root: Path, options: tuple[str, ...] = ()) -> None:
        """Copy `root`; `options` go to every run of pytest."""
        self._root, self._options = root, options
        self._process: subprocess.Popen[str] | None = None
        self._closed = False
        self._writes = 0

    def __enter__(self) -> Self:
        self._folder = tempfile.TemporaryDirectory(prefix="mutants-")
        self._copy = Path(self._folder.name) / "project"
        for part in PARTS:
            if (self._root / part).is_dir():
                shutil.copytree(self._root / part, self._copy / part, ignore=LEFT_OUT, symlinks=True)
            elif (self._root / part).exists():
                self._copy.mkdir(exist_ok=True)
                shutil.copy2(self._root / part, self._copy / part)
        return self

    def __exit__(self, *_: object) -> None:
        self.kill()
        self._folder.cleanup()

    def kill(self) -> None:
        """End the run under way, if any, with everything it started; no further one begins."""
        self._closed = True
        if self._process is not None:
            _kill_group(self._process)

    def run(self, core: CoreFile, mutant: Mutant | None, limit_s: float) -> Run:
        """Run a file's own tests in the copy, with one mutant of the file or without."""
        source, original = self._copy / core.path, (self._root / core.path).read_text()
        self._write(source, mutant.apply(original) if mutant else original)
        try:
            return self._pytest(core.tests, limit_s)
        finally:
            self._write(source, original)

    def _write(self, source: Path, text: str) -> None:
        """Write with a time no other text has had: byte code is found by size and whole seconds."""
        source.write_text(text)
        self._writes += 1
        os.utime(source, (self._writes, self._writes))

    def _pytest(self, tests: tuple[str, ...], limit_s: float) -> Run:
        began_s = time.monotonic()
        process = subprocess.Popen(
            [*PYTEST, str(self._copy.parent / "tmp"), *self._options, *tests],
            cwd=self._copy,
            env=os.environ | {"PYTHONPATH": str(self._copy)},
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            errors="replace",
            start_new_session=True,
        )
        self._process = process
        if self._closed:  # killed before there was a process to kill
            _kill_group(process)
        try:
            output, _ = process.communicate(timeout=limit_s)
            status: int | None = process.returncode
        except subprocess.TimeoutExpired:
            output, status = "", None
        finally:
            _kill_group(process)
            process.communicate()
            self._process = None
        return Run(status, output, time.monotonic() - began_s)


def _kill_group(process: subprocess.Popen[str]) -> None:
    """Kill a run and what it has started: the run leads a session of its own."""
    try:
        os.killpg(process.pid, signal.SIGKILL)
    except ProcessLookupError:
        return
