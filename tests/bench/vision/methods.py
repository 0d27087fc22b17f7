"""Ours and the peers under one signature: a scene in, an answer with its reason out."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from importlib.util import find_spec
from typing import Any

from tests.bench.vision import peers_pads, peers_tip
from tests.bench.vision.scenes import REACH_PX, DiscScene, MarkScene, PadScene, Point, TipKit, TipScene
from vision import ProbeModel, Tip, find_control_point, find_test_points, find_tip

OURS = "ours"
OURS_KNOWN = "ours, needle known"


@dataclass(frozen=True)
class Answer:
    """at_px is None when nothing was found; reason says why, or how it was found."""

    at_px: Point | None
    reason: str = ""


Method = Callable[[Any], Answer]


@cache
def model_of(kit: TipKit) -> ProbeModel | str:
    """Return the taught needle, or why it could not be taught."""
    try:
        return ProbeModel.teach(kit.golden_bgr, kit.tip_px)
    except ValueError as exc:
        # The fact without the advice.
        return f"not taught: {str(exc).split(':')[0]}"


def _tip(scene: TipScene) -> Answer:
    model = model_of(scene.kit)
    if isinstance(model, str):
        return Answer(None, model)
    tip = find_tip(scene.white_bgr, model)
    return Answer((tip.x_px, tip.y_px), "found") if isinstance(tip, Tip) else Answer(None, str(tip.reason))


def _pads(scene: PadScene | DiscScene, needle: Tip | None = None) -> Answer:
    known: dict[str, Any] = {} if needle is None else {"needle": needle}
    nearest = find_test_points(scene.red_bgr, around_px=scene.around_px, reach_px=REACH_PX, **known).nearest
    return Answer((nearest.x_px, nearest.y_px), nearest.rule) if nearest else Answer(None, str(nearest.reason))


def _pads_known(scene: PadScene) -> Callable[[], Answer]:
    """Find the needle first, untimed: a station has its tip from the white look before."""
    needle: Tip | None = None
    if scene.needle_bgr is not None and scene.kit is not None:
        model = model_of(scene.kit)
        found = None if isinstance(model, str) else find_tip(scene.needle_bgr, model)
        needle = found if isinstance(found, Tip) else None
    return lambda: _pads(scene, needle)


def _mark(scene: MarkScene) -> Answer:
    found = find_control_point(scene.white_bgr, scene.around_px, scene.reach_px, scene.arm_px)
    return Answer((found.x_px, found.y_px), f"{len(found.arms)} arms") if found else Answer(None, str(found.reason))


def _peer(find: Callable[[Any], Point | None]) -> Method:
    def found(scene: Any) -> Answer:
        at = find(scene)
        return Answer(at, "found" if at else "nothing")

    return found


def missing_peers() -> dict[str, str]:
    """Return the peers that cannot run here, and what to install."""
    packages = {"subpixel_edges": "subpixel-edges", "circle_fit": "circle-fit"}
    absent = [name for module, name in packages.items() if find_spec(module) is None]
    return {"subpixel-edges + circle-fit": ", ".join(absent)} if absent else {}


@cache
def methods(task: str) -> dict[str, Method]:
    """Return the methods of a task by name, ours first."""
    pads = {name: _peer(find) for name, find in peers_pads.PEERS.items() if name not in missing_peers()}
    if task == "tip":
        return {OURS: _tip} | {name: _peer(find) for name, find in peers_tip.PEERS.items()}
    if task == "pads":
        return {OURS: _pads, OURS_KNOWN: lambda scene: _pads_known(scene)()} | pads
    return {"disc": {OURS: _pads, **pads}, "control": {OURS: _mark}}[task]


def prepare(task: str, name: str, scene: Any) -> Callable[[], Answer]:
    """Return the call that is timed; what a station would have from elsewhere is done before."""
    if name == OURS_KNOWN:
        return _pads_known(scene)
    if task == "tip" and name == OURS:
        model_of(scene.kit)
    method = methods(task)[name]
    return lambda: method(scene)
