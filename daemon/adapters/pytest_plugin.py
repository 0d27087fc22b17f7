"""pytest plugin: `probe("TP7").ohms < 2` on a station, and one case for each point of a plan.

    pytest --reprobe-station tcp://127.0.0.1:5555     a station that is set up
    pytest --reprobe-sim                              a simulated one, started and set up for this run

Without either, a test that asks for a station fails: a line that tests nothing must not look as if it had passed.
"""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

if TYPE_CHECKING:
    from daemon.adapters.prober import Prober
    from daemon.adapters.simulated import Simulated
    from daemon.domain.board import Board
    from daemon.domain.point_test import PointTest

STATION_VARIABLE = "REPROBE_STATION"
MARK = "reprobe_points"
# What the plugin needs of the project is imported when a test asks for it: pytest loads the plugin for every run.


def pytest_addoption(parser: pytest.Parser) -> None:
    """Add the options."""
    group = parser.getgroup("reprobe", "probing points of a board on a reprobe station")
    at = f"control socket of the station, tcp://host:port or ipc://path (default: ${STATION_VARIABLE})"
    serial = "serial number of the board in the nest, by which its pads' touches are counted"
    sim = "start a simulated station; its set-up takes a while"
    group.addoption("--reprobe-station", metavar="ENDPOINT", default=os.environ.get(STATION_VARIABLE), help=at)
    group.addoption("--reprobe-sim", action="store_true", help=sim)
    group.addoption("--reprobe-sim-seed", type=int, default=1, help="of everything random in it (default: 1)")
    group.addoption("--reprobe-board", type=Path, metavar="FILE", help="board file by which plans are read")
    group.addoption("--reprobe-board-id", metavar="ID", help=serial)


def pytest_configure(config: pytest.Config) -> None:
    """Explain the marker, and refuse two stations."""
    config.addinivalue_line(
        "markers",
        f"{MARK}(plan): one case for each point of a plan file (TOML or CSV), or of a list of names or of tests; "
        "the case gets it as its argument `point`",
    )
    if config.option.reprobe_sim and config.option.reprobe_station:
        raise pytest.UsageError("give --reprobe-station or --reprobe-sim, not both")
    if config.option.reprobe_sim and config.option.reprobe_board_id:
        raise pytest.UsageError("the board in a simulated station has no serial number: leave out --reprobe-board-id")


def pytest_generate_tests(metafunc: pytest.Metafunc) -> None:
    """Make a case of each point of a plan."""
    mark = metafunc.definition.get_closest_marker(MARK)
    if mark is None:
        return
    if len(mark.args) != 1 or mark.kwargs:
        raise pytest.UsageError(f"{MARK} takes one plan: a file, or a list of points")
    if "point" not in metafunc.fixturenames:
        raise pytest.UsageError(f"{metafunc.definition.nodeid} is marked {MARK} and takes no argument `point`")
    tests = _tests(mark.args[0], metafunc.definition.path.parent, metafunc.config)
    metafunc.parametrize("point", tests, ids=[_name(test) for test in tests])


@pytest.fixture(scope="session")
def reprobe_sim(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Simulated]:
    """Return a simulated station that is set up; the same for all tests of the run."""
    from daemon.adapters.simulated import simulated_station
    from daemon.tools.demo.processes import StartError
    from daemon.tools.demo.session import SetUpError

    if request.config.option.reprobe_station:
        pytest.fail("this test needs --reprobe-sim, and a real station is asked for", pytrace=False)
    terminal = request.config.pluginmanager.get_plugin("terminalreporter")

    def say(text: str) -> None:
        if terminal is not None:
            terminal.write_line(f"reprobe: {text}")

    try:
        with simulated_station(
            tmp_path_factory.mktemp("reprobe"), request.config.option.reprobe_sim_seed, say
        ) as station:
            yield station
    except (StartError, SetUpError) as exc:
        pytest.fail(f"no simulated station: {exc}", pytrace=False)


@pytest.fixture(scope="session")
def probe(request: pytest.FixtureRequest) -> Iterator[Prober]:
    """Give what tests points of the board, by name or as a plan has them."""
    from daemon.adapters.prober import Prober
    from daemon.client import Client, NoAnswer

    option = request.config.option
    if option.reprobe_sim:
        endpoint = request.getfixturevalue("reprobe_sim").control
    elif option.reprobe_station:
        endpoint = option.reprobe_station
    else:
        pytest.fail(
            f"no station: give --reprobe-station ENDPOINT (or ${STATION_VARIABLE}), or --reprobe-sim", pytrace=False
        )
    with Client(endpoint) as client:
        try:
            client.request("status")
        except NoAnswer as exc:
            pytest.fail(str(exc), pytrace=False)
        yield Prober(client, option.reprobe_board_id)


def _tests(plan: object, beside: Path, config: pytest.Config) -> list[str | PointTest]:
    if isinstance(plan, str | Path):
        return list(_read(beside / plan, config))
    if isinstance(plan, Iterable):
        return list(plan)
    raise pytest.UsageError(f"{MARK} takes a plan file or a list of points, not {plan!r}")


def _read(path: Path, config: pytest.Config) -> Iterable[PointTest]:
    """Read a plan by the board that is tested."""
    from daemon.config.plan_file import PlanError, read_plan

    form: Any = path.suffix.lower().removeprefix(".")
    if form not in ("toml", "csv"):
        raise pytest.UsageError(f"{path} is no plan: its name has to end in .toml or .csv")
    try:
        text = path.read_text(encoding="utf-8")
        return read_plan(text, form, _board(config), path.stem).tests
    except (OSError, UnicodeDecodeError) as exc:
        raise pytest.UsageError(f"{path} cannot be read: {exc}") from exc
    except PlanError as exc:
        raise pytest.UsageError(f"{path}: {exc}") from exc


def _board(config: pytest.Config) -> Board:
    from daemon.adapters.simulated import own_board
    from daemon.domain.board import Board

    if config.option.reprobe_board is not None:
        try:
            return Board.load(config.option.reprobe_board)
        except ValueError as exc:
            raise pytest.UsageError(f"--reprobe-board: {exc}") from exc
    if config.option.reprobe_sim:
        return own_board()
    raise pytest.UsageError("a plan file is read by the board it is for: give --reprobe-board board.json")


def _name(test: str | PointTest) -> str:
    return test if isinstance(test, str) else f"{test.point}-{test.method}"
