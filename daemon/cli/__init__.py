"""The command line: `reprobe`."""

from daemon.cli.app import main

__all__ = ["main"]
