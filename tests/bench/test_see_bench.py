import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tests.bench.see import __main__ as bench
from tests.bench.see import boards, frames, kinds, seats
from tests.bench.see.artist import Lie
from tests.bench.see.frames import Asked


def test_the_bench_judges_a_near_board_right_and_a_turned_one_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    lines = tmp_path / "see.jsonl"
    asked = ["--kinds", "near,turned", "--count", "1", "--no-peers", "--json", str(lines)]
    assert bench.main(asked) == 0
    rows = [json.loads(line) for line in lines.read_text().splitlines()]
    assert {(row["kind"], row["verdict"]) for row in rows} == {("near", "right"), ("turned", "refused")}
    assert all(row["off_px"] < 1.0 for row in rows if row["kind"] == "near")
    assert "refused as" in capsys.readouterr().out


@pytest.mark.parametrize("kind", ["oxide", "dents"])
def test_tarnish_and_dents_are_drawn_on_pads_of_any_shape_and_registered_all_the_same(kind: str) -> None:
    side, trouble = boards.load_side("demo", "top"), kinds.KINDS[kind].trouble
    target = next(target for target in side.targets if np.ptp(np.ptp(target.outline_um, axis=0)) > 100.0)
    place, artist = (target.x_um, target.y_um), frames.artist_of("demo", "top")
    worn, new = (
        artist.shoot(place, Lie(), how, np.random.default_rng(3))
        for how in (trouble, replace(trouble, oxide=0, dents=0))
    )
    x, y = (round(v) for v in worn.truth_px(*place))
    beside = np.s_[y - 6 : y + 7, x - 6 : x + 7, 2]
    assert float(worn.frame[beside].mean()) < 0.95 * float(new.frame[beside].mean())
    rows = [frames.make(Asked("demo", "top", kind, seed, "", peers=False)) for seed in range(1, 4)]
    assert [row["verdict"] for row in rows if row is not None] == ["right"] * 3


def test_the_old_way_takes_the_wrong_pad_of_a_displaced_board_and_registration_the_right_one() -> None:
    rows = [frames.make(Asked("demo", "top", "displaced", seed, "", peers=True)) for seed in range(1, 5)]
    told = [(row["old"], row["verdict"]) for row in rows if row is not None and "old" in row]
    assert told
    assert all(verdict == "right" for _, verdict in told)
    assert any(old == "wrong" for old, _ in told)


def test_looks_that_put_a_board_at_two_places_are_refused_and_a_false_place_they_agree_on_is_wrong() -> None:
    def look(x_um: float, shift_um: tuple[float, float], *, right: bool = True) -> dict[str, object]:
        return {"accepted": True, "at_um": [x_um, 0.0], "shift_um": shift_um, "turn_deg": 0.0, "right": right}

    here, there = look(0.0, (100.0, 0.0)), look(30_000.0, (110.0, 5.0))
    assert seats.judged([here, there], 2) == "right"
    assert seats.judged([here, there], 3) == "refused"
    assert seats.judged([here, look(30_000.0, (400.0, 0.0))], 2) == "refused"
    assert seats.judged([here, look(30_000.0, (110.0, 5.0), right=False)], 2) == "wrong"
    assert seats.judged([look(0.0, (900.0, 0.0)), look(30_000.0, (900.0, 0.0))], 2) == "refused"


@pytest.mark.parametrize("asked", [["--kinds", "nearby"], ["--boards", "nowhere"], ["--count", "0"]])
def test_a_name_that_there_is_not_is_a_usage_error(asked: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as stopped:
        bench.main(asked)
    assert stopped.value.code == 2
    assert "error" in capsys.readouterr().err
