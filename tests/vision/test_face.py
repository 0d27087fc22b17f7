"""What `vision` lists comes from its packages, each imported when one of its names is asked for."""

from __future__ import annotations

import subprocess
import sys
from importlib import import_module
from pathlib import Path

import pytest

import vision

PACKAGES = [
    import_module(f"vision.{name}") for name in ("annotate", "control_point", "core", "geometry", "pads", "tip")
]
ASKS = "import sys, vision; print(*dir(vision)); vision.{}; print(*sys.modules)"


@pytest.mark.parametrize("name", vision.__all__)
def test_a_name_is_the_one_of_a_package(name: str) -> None:
    assert any(getattr(vision, name) is getattr(package, name) for package in PACKAGES if name in package.__all__)


def test_a_name_that_is_not_listed_is_missing() -> None:
    with pytest.raises(AttributeError, match="no attribute 'find_board'"):
        vision.find_board  # type: ignore[attr-defined]  # noqa: B018


@pytest.mark.parametrize(("name", "package"), [("View", "core"), ("project", "geometry"), ("Tip", "tip")])
def test_a_name_waits_for_its_own_package_alone(name: str, package: str) -> None:
    done = subprocess.run(
        [sys.executable, "-c", ASKS.format(name)], capture_output=True, text=True, check=True, timeout=60,
        cwd=Path(__file__).parents[2],
    )  # fmt: skip
    listed, loaded = (set(line.split()) for line in done.stdout.splitlines())
    assert set(vision.__all__) <= listed, "also before it was asked for"
    assert f"vision.{package}" in loaded
    assert not {"vision.annotate", "vision.pads", "vision.registration", "scipy"} & loaded
