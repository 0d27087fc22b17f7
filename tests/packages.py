"""What a test or a bench needs of the system's packages, said as a line that can be typed."""

from __future__ import annotations

import os


def not_installed(*packages: str) -> str:
    """Return what is missing, and the one command that brings it, as the Makefile says its own."""
    root = "" if os.geteuid() == 0 else "sudo "
    brought = f"{root}apt-get update && {root}apt-get install -y {' '.join(packages)}"
    return f"not installed: {', '.join(packages)}\n  -> type: {brought}"
