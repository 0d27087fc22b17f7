"""What is asked to be calibrated is what is calibrated; the tip is taught from one white frame."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from daemon.domain.errors import Fault, FaultCode
from daemon.domain.states import Event
from daemon.procedures.registry import PROCEDURES
from daemon.wire.operations.jobs import Calibrate
from drivers.lights import Light
from tests.daemon.procedures.fake_station import World, a_board, begin, probe_model, run
from vision import ProbeModel

GRID = [(f"P{i}{k}", 5_000.0 + 7_000.0 * i, 4_000.0 + 6_500.0 * k) for i in range(2) for k in range(2)]
TEACH = {"op": "calibrate", "what": "tip", "tip_px": [801.5, 622.0]}


@pytest.fixture
def world(tmp_path: Path) -> World:
    return World(tmp_path, a_board(*GRID), {})


@pytest.mark.parametrize("what", ["map", "rotation", "surface", "backlash"])
async def test_each_kind_leaves_a_record_of_its_own_and_a_page(world: World, what: str, pages: list[list[str]]) -> None:
    world.teach().with_map()
    before = world.calibrations.records["map"]
    ran = await run(world, PROCEDURES["calibrate"], {"op": "calibrate", "what": what, "angles": None})
    assert ran.got.outcome == "calibrated"
    assert ran.got.detail["what"] == what
    assert world.calibrations.records[what] != before
    assert set(world.calibrations.records) == {"map", what}
    assert [page[0] for page in pages] == [str(world.calibrations.file(what))]


async def test_the_tip_is_taught_from_a_white_frame_at_the_pixel_pointed_at(
    world: World, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked: list[Any] = []

    def teach(pixels: Any, tip_px: tuple[float, float]) -> ProbeModel:
        asked.append((pixels.shape, tip_px))
        return probe_model((800.9, 621.7))

    monkeypatch.setattr(ProbeModel, "teach", teach)
    world.teach().with_map()
    ran = await run(world, PROCEDURES["calibrate"], TEACH)
    assert asked == [((8, 8, 3), (801.5, 622.0))]
    assert world.lights.log == [Light.WHITE]
    assert world.calibrations.require_probe().tip_px == (800.9, 621.7)
    assert world.calibrations.pose_map is None, "a map of the old tip is void"
    told = {"in_force": "new", "probe": world.calibrations.fingerprint, "void": ["map"]}
    told["next"] = ["calibrate map", "calibrate rotation", "align", "calibrate surface"]
    assert ran.got.detail == {"what": "tip", "tip_px": [801.5, 622.0], **told}
    assert ran.events == [Event.ACCEPTED]
    assert world.gantry.moves == []


async def test_what_a_new_tip_makes_void_is_told_with_what_to_do_next_and_what_stays_is_not(
    world: World, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(ProbeModel, "teach", lambda *_pixels, **_named: probe_model())
    world.teach().with_map().with_surface().with_alignment(world.true_pose)
    ran = await run(world, PROCEDURES["calibrate"], TEACH)
    assert ran.got.detail["void"] == ["map", "surface"]
    assert ran.got.detail["next"] == ["calibrate map", "calibrate rotation", "calibrate surface"]
    again = await run(world, PROCEDURES["calibrate"], TEACH)
    assert again.got.detail["void"] == [], "they were void already"


async def test_a_needle_that_was_taught_anew_has_no_tare_of_the_one_before(
    world: World, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(ProbeModel, "teach", lambda *_pixels, **_named: probe_model())
    world.teach()
    world.station.needle.health.read(0.4, good=True)
    await run(world, PROCEDURES["calibrate"], TEACH)
    assert world.station.needle.health.tare_ohm == 0.0


async def test_a_frame_in_which_no_needle_is_seen_teaches_nothing(world: World) -> None:
    world.teach()
    with pytest.raises(Fault) as caught:
        await run(world, PROCEDURES["calibrate"], TEACH)
    assert caught.value.kind is FaultCode.CALIBRATION_FAILED
    assert caught.value.message.startswith("the tip cannot be taught: ")
    assert "nothing bright lies below the needle" in caught.value.advice
    assert world.calibrations.require_probe().tip_px == probe_model().tip_px


async def test_without_a_pixel_there_is_nothing_to_teach(world: World) -> None:
    request = Calibrate.model_construct(op="calibrate", id="j", what="tip", tip_px=None)
    ran = begin(request)
    with pytest.raises(Fault) as caught:
        await PROCEDURES["calibrate"](ran.job, world.context)
    assert caught.value.kind is FaultCode.INVALID_REQUEST
    assert ran.events == []
