"""Sites and known targets: found beside the event loop, and by what lies near alone."""

from __future__ import annotations

import math
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from daemon.domain.board import Board
from daemon.domain.board_layers import HoleShape, Painting
from daemon.procedures import registered, sites
from daemon.procedures.registry import PROCEDURES
from daemon.procedures.sites import CELL_UM, LEAST_KNOWN, STEP_UM, looks_known
from daemon.station.board_obstacles import Obstacles
from tests.daemon.procedures.cad_board import cad_board, cad_pad, rectangle
from tests.daemon.procedures.fake_station import World, run
from vision.registration import Polygon, SideLayers, Target

PAD = cad_pad("P1", 15_000.0, 12_000.0, 3000.0, 1200.0, part=None, kind="site")


def _with(board: Board, **shapes: Any) -> Board:
    assert board.layers is not None
    top = board.layers.top.model_copy(update=shapes)
    return board.model_copy(update={"layers": board.layers.model_copy(update={"top": top})})


def _slot(x_um: float, y_um: float) -> HoleShape:
    return HoleShape(x_um=x_um, y_um=y_um, diameter_um=600.0, end_um=(x_um + 300.0, y_um))


@pytest.mark.parametrize("op", ["place", "look", "correct"])
async def test_cad_is_worked_on_beside_the_event_loop(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, op: str) -> None:
    board = _with(cad_board(PAD), holes=(_slot(15_000.0, 12_000.0),))
    world = World(tmp_path, board, {}).teach().with_map()
    world.put_tip(world.true_pose.apply((14_400.0, 12_000.0)))
    threads: dict[str, set[int]] = {}

    def noted(name: str, work: Callable[..., Any]) -> Callable[..., Any]:
        def call(*given: Any, **named: Any) -> Any:
            threads.setdefault(name, set()).add(threading.get_ident())
            return work(*given, **named)

        return call

    monkeypatch.setattr(Board, "side_layers", noted("layers", Board.side_layers))
    monkeypatch.setattr(sites, "free_site", noted("site", sites.free_site))
    monkeypatch.setattr(registered, "looks_known", noted("known", registered.looks_known))
    await run(world, PROCEDURES[op], {"op": op, "test_point": "P1"})
    asked = {"layers", "site"} if op == "place" else {"layers", "site", "known"}
    assert threads.keys() == asked
    assert threading.get_ident() not in set.union(*threads.values())


async def test_only_holes_near_the_metal_are_outlined(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    far = tuple(_slot(25_000.0 + 200.0 * k, 25_000.0) for k in range(50))
    board = _with(cad_board(PAD), holes=(_slot(15_000.0, 12_000.0), *far))
    world = World(tmp_path, board, {}).teach()
    hulls: list[Any] = []
    hull = cv2.convexHull

    def counted(points: Any) -> Any:
        hulls.append(points)
        return hull(points)

    monkeypatch.setattr(cv2, "convexHull", counted)
    ran = await run(world, PROCEDURES["place"], {"op": "place", "test_point": "P1"})
    assert len(hulls) == 1
    x_um, y_um = ran.got.detail["target_um"]
    assert min(math.dist((x_um, y_um), (x, 12_000.0)) for x in (15_000.0, 15_300.0)) > 300.0
    assert abs(x_um - 15_000.0) < 1500.0
    assert abs(y_um - 12_000.0) < 600.0


def _known_by_every_cover(target: Target, covers: list[Any]) -> bool:
    """Ask every point of the edge of every cover."""
    edge = []
    for a, b in zip(target.outline_um, np.roll(target.outline_um, -1, axis=0), strict=True):
        edge.extend(np.linspace(a, b, max(1, math.ceil(math.dist(a, b) / STEP_UM)), endpoint=False))
    contours = [np.asarray(c, dtype=np.float32).reshape(-1, 1, 2) for c in covers]
    free = [
        all(cv2.pointPolygonTest(c, (float(x), float(y)), measureDist=True) < -CELL_UM for c in contours)
        for x, y in edge
    ]
    return float(np.mean(free)) >= LEAST_KNOWN


def test_a_target_is_known_as_if_every_cover_had_been_asked() -> None:
    rng = np.random.default_rng(5)
    target = Target(0.0, 0.0, np.array(rectangle(0, 0, 2000, 1000), dtype=float).reshape(-1, 2))
    answers = set()
    for _ in range(60):
        middles, sizes = rng.uniform(-2500, 2500, (14, 2)), rng.uniform(100, 2000, (14, 2))
        covers = [np.array(rectangle(*m, *s), dtype=float).reshape(-1, 2) for m, s in zip(middles, sizes, strict=True)]
        bodies, soldered = (tuple(Polygon(c) for c in half) for half in (covers[:7], covers[7:]))
        layers = SideLayers((), (), (), (), (), bodies, soldered)
        expected = _known_by_every_cover(target, covers)
        assert looks_known(target, Obstacles(layers)) == expected
        answers.add(expected)
    assert answers == {True, False}


def test_a_cover_that_is_nearer_than_a_cell_hides_an_edge() -> None:
    target = Target(0.0, 0.0, np.array(rectangle(0, 0, 1000, 1000), dtype=float).reshape(-1, 2))

    def around(gap: int) -> Obstacles:
        half, far = 500 + gap, 3000
        frame = [
            (-far, half, far, half, far, far, -far, far),
            (-far, -far, far, -far, far, -half, -far, -half),
            (-far, -half, -half, -half, -half, half, -far, half),
            (half, -half, far, -half, far, half, half, half),
        ]
        return Obstacles(SideLayers((), (), (), (), (), Painting(outlines=tuple(frame)).polygons()))

    assert not looks_known(target, around(10))
    assert looks_known(target, around(14))
