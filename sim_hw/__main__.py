"""Command line of the simulated station: `reprobe sim --board DIR --line PATH ...`, or `python -m sim_hw`."""

from __future__ import annotations

import argparse
import asyncio
import json
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NoReturn

import zmq

from sim_hw.plant.knobs import Knobs
from sim_hw.station import Station, StationOptions

EXIT_BAD = 2


class _Parser(argparse.ArgumentParser):
    """Say what is wrong in one line."""

    def error(self, message: str) -> NoReturn:
        self.exit(EXIT_BAD, f"sim_hw: {message}\n")


def main(arguments: Sequence[str] | None = None) -> int:
    """Run a simulated station; return the exit code."""
    parser = _parser()
    options = _options(parser, parser.parse_args(arguments))
    try:
        asyncio.run(_run(options))
    except (OSError, ValueError, zmq.ZMQError) as error:
        sys.stderr.write(f"sim_hw: {' '.join(str(error).split())}\n")
        return EXIT_BAD
    return 0


async def _run(options: StationOptions) -> None:
    await Station(options).run(_announce)


def _announce(facts: Mapping[str, Any]) -> None:
    sys.stdout.write(json.dumps({"ready": True, **facts}) + "\n")
    sys.stdout.flush()


def _parser() -> argparse.ArgumentParser:
    parser = _Parser(prog="reprobe sim", description="A simulated station on real wires.")
    parser.add_argument("--board", type=Path, required=True, help="folder or zip of Gerber, drill and netlist files")
    parser.add_argument("--side", choices=("top", "bottom"), default="top", help="side that is up")
    parser.add_argument("--assembled", action="store_true", help="parts stand on the board; without, it is bare")
    parser.add_argument("--seed", type=int, default=1, help="seed of everything random")
    parser.add_argument("--speed", type=float, default=1.0, help="simulated seconds per second")
    parser.add_argument("--line", type=Path, required=True, help="path of the symlink to the serial line")
    parser.add_argument("--camera", required=True, help="ZeroMQ endpoint of the camera, e.g. ipc:///run/sim/camera")
    parser.add_argument("--bench", required=True, help="ZeroMQ endpoint of the bench socket")
    parser.add_argument("--meter-port", type=int, default=0, help="TCP port of the meter on loopback; 0: a free one")
    parser.add_argument("--meter-line", type=Path, default=None, help="path of the symlink to the meter's serial line")
    parser.add_argument("--truth", type=Path, required=True, help="file the truth log is appended to")
    parser.add_argument("--unpaced", action="store_true", help="serve the line as fast as possible")
    parser.add_argument(
        "--tiles", type=int, default=None, metavar="N", help="keep N tiles of the board's image, 4 MiB each (28 or 44)"
    )
    parser.add_argument("--set", action="append", default=[], metavar="KNOB=VALUE", help="turn a knob; may be repeated")
    return parser


def _options(parser: argparse.ArgumentParser, given: argparse.Namespace) -> StationOptions:
    if not 0.0 < given.speed <= 1000.0:
        parser.error(f"--speed must be above 0 and at most 1000, not {given.speed}")
    if not 0 <= given.meter_port <= 65535:
        parser.error(f"--meter-port must be 0 to 65535, not {given.meter_port}")
    if given.tiles is not None and given.tiles < 1:
        parser.error(f"--tiles must be 1 or more, not {given.tiles}")
    if not given.board.is_dir() and given.board.suffix.lower() != ".zip":
        parser.error(f"--board: {given.board} is not a folder")
    return StationOptions(
        board=given.board,
        side=given.side,
        seed=given.seed,
        speed=given.speed,
        line=given.line,
        camera=given.camera,
        bench=given.bench,
        truth=given.truth,
        paced=not given.unpaced,
        knobs=_knobs(parser, given.set),
        meter_port=given.meter_port,
        meter_line=given.meter_line,
        assembled=given.assembled,
        tiles=given.tiles,
    )


def _knobs(parser: argparse.ArgumentParser, settings: Sequence[str]) -> Knobs:
    knobs = Knobs()
    for setting in settings:
        name, equals, value = setting.partition("=")
        if not equals:
            parser.error(f"--set needs KNOB=VALUE, not {setting!r}")
        try:
            knobs = knobs.with_value(name, value)
        except ValueError as error:
            parser.error(f"--set: {error}")
    return knobs


if __name__ == "__main__":
    sys.exit(main())
