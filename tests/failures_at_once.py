"""Pytest plugin: a failure is told when it happens, not at the end of the run."""

from __future__ import annotations

import pytest


class FailuresAtOnce:
    """Print each failure with its short traceback as it comes."""

    def __init__(self, config: pytest.Config) -> None:
        self._config = config

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        """Tell it."""
        terminal = self._config.pluginmanager.get_plugin("terminalreporter")
        if report.failed and terminal is not None:
            terminal.ensure_newline()
            terminal.write_line(f"FAILED {report.nodeid} ({report.when})")
            terminal.write_line(report.longreprtext)


def pytest_configure(config: pytest.Config) -> None:
    """Take part."""
    config.pluginmanager.register(FailuresAtOnce(config), "failures-at-once")
