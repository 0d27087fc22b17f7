"""Relative paths of a configuration: they begin in the configuration file's folder, wherever the daemon is started."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from daemon.config.model import Config

_FILE_SOCKET = "ipc://"


def is_below_the_file(device: str) -> bool:
    """Tell whether the path of a device or port is meant to begin in the file's folder.

    A bare name such as `ttyUSB0` is not: a device was meant. Nor is `dev/ttyUSB0`, whose slash was left out.
    """
    first, slash, rest = device.partition("/")
    return bool(slash and rest) and first not in ("", "dev")


def from_folder(place: str, folder: Path) -> str:
    """Return a port's path, or the endpoint of a socket that is a file, as it is from anywhere."""
    if place.startswith(_FILE_SOCKET):
        path = place.removeprefix(_FILE_SOCKET)
        is_relative = not path.startswith(("/", "@"))  # @: of the kernel's own name space, no file
        return f"{_FILE_SOCKET}{folder / path}" if is_relative else place
    return str(folder / place) if is_below_the_file(place) and "://" not in place else place


def resolved(config: Config, folder: Path) -> Config:
    """Return the configuration with each of its paths as it is from anywhere."""

    def here(place: str | None) -> str | None:
        return None if place is None else from_folder(place, folder)

    station, board, lights, camera, api = config.station, config.board, config.lights, config.camera, config.api
    changed = {
        "station": station.model_copy(update={"data_dir": folder / station.data_dir}),
        "bus": {name: line.model_copy(update={"port": here(line.port)}) for name, line in config.bus.items()},
        "lights": lights.model_copy(update={"port": here(lights.port)}),
        "camera": camera.model_copy(update={"device": here(camera.device), "endpoint": here(camera.endpoint)}),
        "board": board.model_copy(update={"file": folder / board.file}),
        "api": api.model_copy(
            update={
                "keys_dir": folder / api.keys_dir,
                **{name: from_folder(getattr(api, name), folder) for name in ("control", "events", "live")},
            }
        ),
    }
    return config.model_copy(update=changed)
