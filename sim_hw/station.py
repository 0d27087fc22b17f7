"""Whole simulated station: plant, slaves, line, camera, truth log and bench socket, started and ended together."""

from __future__ import annotations

import asyncio
import contextlib
import os
import random
import signal
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Literal

from sim_hw.bench import BenchServer
from sim_hw.board.board import Board, load_board
from sim_hw.board.finish import Finish
from sim_hw.board.nest import InNest, Mark
from sim_hw.bus.line import Line
from sim_hw.bus.modbus import Slave
from sim_hw.bus.relay import Relay
from sim_hw.camera.server import CameraServer
from sim_hw.drive.l4118 import L4118
from sim_hw.electric.electricity import Electricity
from sim_hw.electric.meter import Meter, Time
from sim_hw.electric.meter_wires import MeterWires
from sim_hw.plant.axis import SPECS
from sim_hw.plant.clock import SimClock
from sim_hw.plant.faults import Faults
from sim_hw.plant.knobs import Knobs
from sim_hw.plant.plant import Placement, Plant
from sim_hw.scene.collision import hits_between
from sim_hw.truth import TruthLog, head_record, hit_record, truth_record

RELAY_ADDRESS = 5
DENT_RADIUS_UM = (22.0, 34.0)
"""What the needle's end of 25 um leaves in metal."""


@dataclass(frozen=True)
class StationOptions:
    """Everything a simulated station is started with."""

    board: Path
    side: Literal["top", "bottom"]
    seed: int
    speed: float
    line: Path
    camera: str
    bench: str
    truth: Path
    paced: bool
    knobs: Knobs
    meter_port: int = 0
    """TCP port of the meter on loopback; 0: a free one."""
    meter_line: Path | None = None
    """Symlink to the meter's pseudo terminal."""
    assembled: bool = False
    tiles: int | None = None
    """How many tiles of the board's texture are kept, 4 MiB each; None: as many as make a station of some 300 MB."""


class Station:
    """Own the parts; `run` serves until asked to end."""

    def __init__(self, options: StationOptions) -> None:
        self.options = options
        self.folder, self.assembled = options.board, options.assembled
        self.nest = InNest.made(
            self._loaded(options.board, options.side, assembled=options.assembled), Finish.of(options.knobs)
        )
        self.clock = SimClock(options.speed)
        self.faults = Faults()
        self.plant = Plant(options.knobs, _placement(self.board), self.faults, options.seed)
        self.plant.relief_um = self.nest.relief_um if self.board.bodies else None
        self.drives = {spec.address: L4118(spec, self.plant) for spec in SPECS}
        slaves: dict[int, Slave] = {**self.drives, RELAY_ADDRESS: Relay(self.plant)}
        self._line = Line(
            slaves, self.clock, self.faults, lambda: self.plant.knobs, seed=options.seed, paced=options.paced
        )
        self.electricity = Electricity(self.plant, options.seed)
        self.electricity.lay_board(self.nest, assembled=options.assembled)
        self.plant.sense = self.electricity.sense
        self.meter = Meter(
            self.electricity,
            Time(self.clock.now_s, self._until),
            self.faults,
            lambda: self.plant.knobs,
            self._note,
            options.seed,
        )
        self._meter_wires = MeterWires(self.meter.answer, self.faults, options.seed)
        self._end = asyncio.Event()
        self._ordered = asyncio.Event()
        self._settled_s = 0.0

    @property
    def board(self) -> Board:
        """Return the board side in the nest."""
        return self.nest.board

    def _loaded(self, folder: Path, side: str, *, assembled: bool) -> Board:
        return load_board(folder, side, parts_seed=self.options.seed if assembled else None)

    async def run(self, ready: Callable[[Mapping[str, Any]], None]) -> None:
        """Serve until `shutdown`, SIGTERM or SIGINT; call `ready` once everything is served.

        Raises:
            OSError: a file, the line or a socket cannot be opened.

        """
        options, loop = self.options, asyncio.get_running_loop()
        for number in (signal.SIGTERM, signal.SIGINT):
            loop.add_signal_handler(number, self._end.set)
        async with contextlib.AsyncExitStack() as stack:
            log = TruthLog(options.truth)
            stack.callback(log.close)
            self._connect(log)
            bench = BenchServer(self, options.bench)
            stack.callback(bench.close)
            camera = self._camera = CameraServer(
                plant=self.plant,
                board=self.board,
                clock=self.clock,
                endpoint=options.camera,
                faults=self.faults,
                seed=options.seed,
                tiles=options.tiles,
            )
            stack.push_async_callback(self._meter_wires.close)
            await self._meter_wires.open(options.meter_port, options.meter_line)
            parts = (bench.serve(), camera.serve(), self._meter_wires.serve(), self._follow(log))
            tasks = [loop.create_task(part) for part in parts]
            camera.scene.put(self.nest)
            stack.push_async_callback(_cancel, tasks)
            await _first(loop.create_task(camera.ready.wait()), tasks)
            for endpoint in (options.bench, options.camera):
                stack.callback(_remover(endpoint))
            self._line.open(options.line)
            stack.callback(self._line.close)
            ready(self._facts())
            await _first(loop.create_task(self._end.wait()), tasks)

    # --- the bench's commands

    def status(self) -> dict[str, Any]:
        """Return time, motion, line and fault facts."""
        t_s = self.clock.now_s()
        self._update(t_s)
        return {
            **self._facts(),
            "t_s": t_s,
            "speed": self.clock.speed,
            "seed": self.options.seed,
            "board": str(self.folder),
            "side": self.board.side,
            "assembled": self.assembled,
            "marks": len(self.nest.marks),
            "moving": self.plant.state_at(t_s).moving,
            "tip_px": self._camera.scene.tip_px(self.plant.state_at(t_s)),
            "drives": {drive.spec.name: drive.drive.state.name.lower() for drive in self.drives.values()},
            "statistics": vars(self._line.statistics).copy(),
            "faults": [name for name, fault in self.faults.listing().items() if fault["on"]],
        }

    def truth(self) -> dict[str, Any]:
        """Return the truth record of now."""
        t_s = self.clock.now_s()
        self._update(t_s)
        return {**truth_record(self.plant, self.board.targets, t_s, self.nest), **self._motion_and_light(t_s)}

    def head(self) -> dict[str, Any]:
        """Return the truth record of now without what lies about the tip: that is most of its cost."""
        t_s = self.clock.now_s()
        self._update(t_s)
        return {**head_record(self.plant, t_s), **self._motion_and_light(t_s)}

    def pads(self) -> dict[str, Any]:
        """Return the pins and vias of the side that is up: names, nets and CAD places."""
        board = self.board
        places = [{"pin": pad.name, "net": pad.net, "x_mm": pad.x_mm, "y_mm": pad.y_mm} for pad in board.pads]
        return {"board": board.name, "side": board.side, "outline_mm": board.outline_mm, "pads": places}

    async def lay_board(self, folder: str | None, side: str | None, assembled: bool | None) -> dict[str, Any]:  # noqa: FBT001 - as on the wire
        """Lift the board out and lay one in: the same, or another, or its other side up; it never lies quite the same.

        Raises:
            ValueError: the folder cannot be read, or there is no such side; what lay there lies there still.

        """
        folder_now = self.folder if folder is None else Path(folder)
        side_now = self.board.side if side is None else side
        assembled_now = self.assembled if assembled is None else assembled
        same = (folder_now, side_now, assembled_now) == (self.folder, self.board.side, self.assembled)
        if same:
            board = self.board
        else:
            board = await asyncio.to_thread(self._loaded, folder_now, side_now, assembled=assembled_now)
        self._update(self.clock.now_s())
        self.folder, self.assembled = folder_now, assembled_now
        self._lay(InNest.made(board, self.nest.finish, self.nest.marks if same else None))
        self.plant.seat_board(_placement(board))
        facts = {"board": str(folder_now), "side": side_now, "assembled": assembled_now, "seat": self.plant.seat}
        self.plant.note(self.clock.now_s(), "board", {**facts, "board_pose": asdict(self.plant.board_pose)})
        return facts

    def faults_listing(self) -> dict[str, Any]:
        """Return every fault with its state and parameters."""
        return {"faults": self.faults.listing()}

    def fault(self, name: str, parameters: Mapping[str, Any], *, on: bool) -> None:
        """Switch a fault; what happened before counts with the old state of things."""
        self._update(self.clock.now_s())
        self.faults.switch(name, on=on, **parameters)

    def circuit(self) -> dict[str, Any]:
        """Return which net is at which channel of the meter's scanner, what is closed, broken and shorted."""
        harness = {str(channel): net for channel, net in self.electricity.circuit.pins.items()}
        return {"harness": harness, "closed": list(self.meter.channels), **self.electricity.defects()}

    def set_knob(self, name: str, value: object) -> None:
        """Turn a knob; what happened before counts with the old one."""
        self._update(self.clock.now_s())
        self.plant.set_knob(name, value)
        made = Finish.of(self.plant.knobs)
        if made != self.nest.finish:
            self._lay(InNest.made(self.board, made, self.nest.marks))
        self.electricity.lay_board(self.nest, assembled=self.assembled)
        self.plant.note(self.clock.now_s(), "set", {"name": name, "value": value})

    def power_cycle(self) -> None:
        """Cut and restore the drives' power."""
        t_s = self.clock.now_s()
        for drive in self.drives.values():
            drive.power_cycle(t_s)
        self.plant.note(t_s, "power_cycle", {})
        self._ordered.set()

    def shutdown(self) -> None:
        """End the station, after the reply is sent."""
        asyncio.get_running_loop().call_later(0.05, self._end.set)

    # --- inside

    def _motion_and_light(self, t_s: float) -> dict[str, Any]:
        state = self.plant.state_at(t_s)
        return {"moving": state.moving, "white": state.white, "red": state.red}

    def _lay(self, nest: InNest) -> None:
        self.nest = nest
        self.plant.relief_um = nest.relief_um if nest.board.bodies else None
        self.electricity.lay_board(nest, assembled=self.assembled)
        self._camera.scene.put(nest)

    def _connect(self, log: TruthLog) -> None:
        """Send what happens to the truth log and wake `_follow` when something is ordered."""
        options = self.options
        log.start(self.plant, {"board": str(options.board), "side": options.side, "speed": options.speed})
        self.plant.note = lambda t_s, event, facts: log.write(event, {"t_s": t_s, **facts})
        self.plant.listen(self._ordered.set)
        self.faults.listen(self._fault_changed)

    def _fault_changed(self, name: str, on: bool, parameters: Mapping[str, Any]) -> None:  # noqa: FBT001 - faults.Listener
        self.plant.note(self.clock.now_s(), "fault", {"name": name, "on": on, **parameters})
        self._ordered.set()

    def _update(self, t_s: float) -> None:
        for drive in self.drives.values():
            drive.drive.update(t_s)
        self.electricity.update(t_s)

    def _note(self, t_s: float, event: str, facts: Mapping[str, object]) -> None:
        self.plant.note(t_s, event, facts)

    async def _until(self, t_s: float) -> None:
        await asyncio.sleep(self.clock.wall_delay(t_s - self.clock.now_s()))

    async def _follow(self, log: TruthLog) -> None:
        """Let the drives act when something is due although nobody asks, and log every coming to rest."""
        while True:
            self._ordered.clear()
            t_s = self.clock.now_s()
            self._update(t_s)
            rest_s = self.plant.rest_s()
            if self._settled_s < rest_s <= t_s:
                self._at_rest(log, rest_s)
            due = [drive.drive.next_event_s() for drive in self.drives.values()]
            due += [rest_s if rest_s > t_s else None]
            next_s = min((when_s for when_s in due if when_s is not None), default=None)
            delay_s = None if next_s is None else self.clock.wall_delay(next_s - self.clock.now_s())
            with contextlib.suppress(TimeoutError):
                await asyncio.wait_for(self._ordered.wait(), delay_s)

    def _at_rest(self, log: TruthLog, rest_s: float) -> None:
        """Log what was hit on the way and where the tip came to rest; what is touched keeps a dent."""
        for hit in hits_between(self.plant, self.nest.bodies, self._camera.scene.needle, self._settled_s, rest_s):
            log.write("hit_body", hit_record(hit))
        self._settled_s = rest_s
        record = truth_record(self.plant, self.board.targets, rest_s, self.nest)
        log.write("settled", record)
        if self.plant.knobs.board_marks and record["pressed_um"] > 0.0 and record["on"]["what"] in ("metal", "lead"):
            x_mm, y_mm = record["cad_mm"]
            rng = random.Random(f"{self.options.seed}/dent/{len(self.nest.marks)}")
            self.nest.marks.append(Mark(x_mm, y_mm, rng.uniform(*DENT_RADIUS_UM)))

    def _facts(self) -> dict[str, Any]:
        options = self.options
        return {
            "line": str(options.line),
            "pty": self._line.pty,
            "camera": options.camera,
            "bench": options.bench,
            "meter": self._meter_wires.address,
            "meter_pty": self._meter_wires.pty,
            "truth": str(options.truth),
            "pid": os.getpid(),
        }


def _placement(board: Board) -> Placement:
    return Placement(*board.outline_mm, "top" if board.side == "top" else "bottom")


def _remover(endpoint: str) -> Callable[[], None]:
    """Return what removes an endpoint's socket file, which ZeroMQ leaves behind, while it still is this one."""
    path = Path(endpoint.removeprefix("ipc://"))
    if not endpoint.startswith("ipc://") or not path.exists():
        return lambda: None
    inode = path.stat().st_ino

    def remove() -> None:
        if path.exists() and path.stat().st_ino == inode:
            path.unlink()

    return remove


async def _first(awaited: asyncio.Task[Any], parts: list[asyncio.Task[Any]]) -> None:
    """Wait for one task; if a part of the station ends instead, raise its error."""
    await asyncio.wait([awaited, *parts], return_when=asyncio.FIRST_COMPLETED)
    if awaited.done():
        return
    awaited.cancel()
    for part in parts:
        if part.done():
            part.result()


async def _cancel(tasks: list[asyncio.Task[Any]]) -> None:
    for task in tasks:
        task.cancel()
    await asyncio.gather(*tasks, return_exceptions=True)
