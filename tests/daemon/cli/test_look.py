"""Stored pictures: `reprobe look` and `reprobe teach` find, tell, draw, and refuse in whole sentences."""

import json
import math
import re
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from typer.testing import CliRunner, Result

from daemon.cli.app import app
from daemon.cli.picture_files import BadPicture, decode
from daemon.cli.points import parse_point
from daemon.cli.vision_output import number, seen_facts, tip_facts
from tests.daemon.procedures.cad_board import cad_board, cad_pad
from tests.daemon.procedures.fake_station import pose_map as exact_map
from tests.vision.scene import NOMINAL_TIP, Camera, Canvas, Needle, Pad, frame_of, red_frame, white_frame
from vision import ProbeModel, Seen, Tip, find_test_points, find_tip

runner = CliRunner()
NEEDLE = Needle(tip=(430.3, 618.6))
PADS = (Pad(437.0, 630.0, 17.0, 4.5), Pad(470.0, 620.0, 6.5, 2.5))
AROUND = "430.3,618.6"


@pytest.fixture(scope="module")
def desk(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a taught probe, a white and a red picture of one look, and a printed cross."""
    folder = tmp_path_factory.mktemp("desk")
    ProbeModel.teach(white_frame(Needle(), Camera(), 0, 0.0), NOMINAL_TIP).save(folder / "probe.npz")
    pictures = {
        "white.png": white_frame(NEEDLE, Camera(), 1, 0.3),
        "red.png": red_frame(PADS, NEEDLE, Camera(), 2),
        "quiet.png": white_frame(NEEDLE, Camera(), 3, 0.0),
        "bare.png": white_frame(None, Camera(), 4, 0.3),
        "cross.png": _cross(),
    }
    for name, pixels in pictures.items():
        assert cv2.imwrite(str(folder / name), pixels)
    return folder


def _cross() -> np.ndarray:
    canvas = Canvas(NOMINAL_TIP, (200, 200), 205.0)
    for angle in (20.0, 105.0):
        canvas.paint(canvas.bar((420.25, 611.5), angle, 140, 5), 40.0)
    return frame_of(canvas.develop(Camera(), np.random.default_rng(0)), canvas, True, 205.0)


def _reprobe(desk: Path, command: str) -> Result:
    """Run a command; a word with a dot and a known ending is a file of the desk, and no traceback may come out."""
    words = [str(desk / word) if word.endswith((".png", ".npz", ".jpg")) else word for word in command.split()]
    result = runner.invoke(app, words, env={"COLUMNS": "130"})
    assert result.exception is None or isinstance(result.exception, SystemExit), result.exception
    return result


def _told(result: Result) -> dict[str, Any]:
    def refuse(constant: str) -> None:
        raise AssertionError(f"{constant} in JSON")

    told: dict[str, Any] = json.loads(result.stdout, parse_constant=refuse)
    return told


def _picture(path: Path) -> np.ndarray:
    picture = cv2.imread(str(path))
    assert picture is not None
    return picture


def test_a_look_finds_tip_and_test_points(desk: Path) -> None:
    result = _reprobe(desk, "look --white white.png --red red.png --probe probe.npz --json")
    assert result.exit_code == 0
    told = _told(result)
    assert told["ok"]
    assert math.dist((told["tip"]["x_px"], told["tip"]["y_px"]), NEEDLE.tip) < 0.3
    nearest = told["test_points"]["nearest"]
    assert math.dist((nearest["x_px"], nearest["y_px"]), PADS[0].target) < 0.3
    assert nearest["distance_px"] == pytest.approx(math.hypot(*nearest["offset_px"]), abs=1e-3)
    assert [point["rule"] for point in told["test_points"]["taken"]] == ["site_with_hole", "via_with_hole"]


def test_people_get_tables_with_the_rule_that_decided(desk: Path) -> None:
    result = _reprobe(desk, "look --white white.png --red red.png --probe probe.npz")
    assert result.exit_code == 0
    for words in ("rims of the marking", "nearest site", "site with hole", "Take large pads with a dark"):
        assert words in result.stdout
    assert "5.4" not in result.stdout


def test_the_json_keys_are_the_same_whatever_was_found(desk: Path) -> None:
    commands = (
        "look --white white.png --red red.png --probe probe.npz --json",
        "look --white bare.png --red red.png --probe probe.npz --json",
        "look red.png --around 3,3 --json",
        f"look cross.png --control-point --around {AROUND} --json",
    )
    keys = [set(_told(_reprobe(desk, command))) for command in commands]
    assert all(each == keys[0] for each in keys)


def test_the_needle_is_known_when_the_red_picture_is_searched(desk: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    needles = []

    def searching(red: Any, around: Any, reach: float, radius: float | None, needle: Tip | None, **more: Any) -> Seen:
        needles.append(needle)
        return find_test_points(red, around, reach, radius, needle, **more)

    monkeypatch.setattr("daemon.cli.stored_look.find_test_points", searching)
    told = _told(_reprobe(desk, "look --white white.png --red red.png --probe probe.npz --json"))
    alone = _told(_reprobe(desk, f"look red.png --around {AROUND} --json"))
    assert [type(needle) for needle in needles] == [Tip, type(None)]
    assert told["test_points"]["nearest"]["visible"] < 1.0
    assert alone["tip"] is None


def test_the_tip_alone(desk: Path, tmp_path: Path) -> None:
    result = _reprobe(desk, f"look --white white.png --probe probe.npz --out {tmp_path}/tip.png")
    assert result.exit_code == 0
    assert "tip" in result.stdout
    assert _picture(tmp_path / "tip.png").shape[0] > 700


def test_a_picture_round_a_point(desk: Path, tmp_path: Path) -> None:
    result = _reprobe(desk, f"look red.png --around {AROUND} --out {tmp_path}/pads.jpg --json")
    assert result.exit_code == 0
    assert _told(result)["annotated"] == f"{tmp_path}/pads.jpg"
    assert _picture(tmp_path / "pads.jpg").shape[1] > 600


def test_a_pad_of_another_size_than_cad_says_is_not_found(desk: Path) -> None:
    result = _reprobe(desk, f"look red.png --around {AROUND} --expected-radius-px 11 --json")
    assert result.exit_code == 1
    points = _told(result)["test_points"]
    assert points["reason"] == "no_test_point"
    assert points["nearest"] is None
    assert "wrong_size" in {item["rule"] for item in points["thrown"]}


@pytest.mark.parametrize(
    ("said", "hole_px"), [("", 4.5), ("--expected-hole-radius-px 4.5", 4.5), ("--expected-hole-radius-px 0", None)]
)
def test_a_dark_place_in_a_pad_is_a_hole_unless_cad_has_none(desk: Path, said: str, hole_px: float | None) -> None:
    result = _reprobe(desk, f"look red.png --around {AROUND} --expected-radius-px 17 {said} --json")
    assert result.exit_code == 0
    found = _told(result)["test_points"]["nearest"]["hole_radius_px"]
    assert found == (None if hole_px is None else pytest.approx(hole_px, abs=0.5))


def test_a_control_point(desk: Path, tmp_path: Path) -> None:
    result = _reprobe(desk, f"look cross.png --control-point --around {AROUND} --out {tmp_path}/cross.png --json")
    assert result.exit_code == 0
    found = _told(result)["control_point"]
    assert math.dist((found["x_px"], found["y_px"]), (420.25, 611.5)) < 0.3
    assert len(found["arms"]) == 4
    assert "arm" in _reprobe(desk, f"look cross.png --control-point --around {AROUND}").stdout
    assert _reprobe(desk, f"look white.png --control-point --around {AROUND}").exit_code == 1
    assert _picture(tmp_path / "cross.png").shape[0] > 500


def test_nothing_found_is_said_with_its_reason_and_drawn_all_the_same(desk: Path, tmp_path: Path) -> None:
    sheet = tmp_path / "look.png"
    result = _reprobe(desk, f"look --white bare.png --red red.png --probe probe.npz --out {sheet}")
    assert result.exit_code == 1
    assert "no_needle" in result.stderr
    assert "is it mounted" in result.stderr
    assert "--around" in result.stderr
    assert _picture(sheet).shape[1] > 1000
    again = _reprobe(desk, f"look --white bare.png --red red.png --probe probe.npz --around {AROUND}")
    assert again.exit_code == 1
    assert "nearest site" in again.stdout
    assert "--out" in again.stderr


@pytest.mark.parametrize(
    ("command", "words"),
    [
        ("look red.png", "--around"),
        ("look --red red.png", "--around"),
        ("look --around 1,2", "which picture"),
        ("look --white white.png", "--probe"),
        ("look --probe probe.npz", "--white"),
        ("look red.png --red red.png --around 1,2", "given twice"),
        ("look --white white.png --probe probe.npz --around 1,2", "--red"),
        ("look red.png --around 428,620 --arm-px 60", "--control-point"),
        ("look cross.png --control-point", "--around"),
        ("look cross.png --control-point --around 1,2 --red red.png", "one white picture"),
        ("look red.png --around nan,620", "is no place"),
        ("look red.png --around 428", "X,Y"),
        ("look red.png --around 1600,620", "outside the picture"),
        ("look red.png --around 428,620 --reach-px nan", "reach_px"),
        ("look red.png --around 428,620 --expected-radius-px 1e9", "expected_radius_px"),
        ("look red.png --around 428,620 --expected-hole-radius-px -1", "expected_hole_radius_px"),
        ("look red.png --around 428,620 --expected-radius-px 9 --expected-hole-radius-px 9", "less than the pad's"),
        ("look --white white.png --probe probe.npz --expected-hole-radius-px 4", "--red"),
        ("look cross.png --control-point --around 428,620 --expected-hole-radius-px 4", "one white picture"),
        ("look cross.png --control-point --around 428,620 --reach-px 1", "reach_px"),
        ("look gone.png --around 1,2", "cannot read"),
        ("look probe.npz --around 1,2", "not a picture"),
        ("look --white white.png --probe white.png", "no taught probe"),
        ("look --white white.png --probe gone.npz", "cannot read"),
        ("look red.png --around 428,620 --out red.png", "another name"),
        ("look red.png --around 428,620 --out notes.txt", "no picture's name"),
        ("look red.png --around 428,620 --out nowhere/look.png", "no folder"),
        ("teach --white quiet.png --tip 5000,1 --out new.npz", "outside the picture"),
        ("teach --white quiet.png --tip x --out new.npz", "X,Y"),
        ("teach --white quiet.png --tip 430.3,618.6 --out probe.npz", "--force"),
        ("teach --white quiet.png --tip 430.3,618.6 --out quiet.png --force", "another name"),
    ],
)
def test_what_was_asked_for_wrongly_is_refused_with_what_to_do(desk: Path, command: str, words: str) -> None:
    result = _reprobe(desk, command)
    assert result.exit_code == 2
    assert words in result.stderr
    assert not result.stdout


def test_a_name_that_cannot_be_written_is_told(desk: Path, tmp_path: Path) -> None:
    result = _reprobe(desk, f"look red.png --around {AROUND} --out {tmp_path / ('x' * 296)}.png")
    assert result.exit_code == 2
    assert "cannot write" in result.stderr
    assert not list(tmp_path.iterdir())


def test_the_longest_name_there_is_can_be_written(desk: Path, tmp_path: Path) -> None:
    sheet = tmp_path / f"{'x' * 251}.png"
    _reprobe(desk, f"look red.png --around {AROUND} --out {sheet}")
    assert sheet.exists()
    assert len(list(tmp_path.iterdir())) == 1


def test_a_folder_is_no_file(desk: Path, tmp_path: Path) -> None:
    (tmp_path / "look.png").mkdir()
    assert "is a folder" in _reprobe(desk, f"look red.png --around {AROUND} --out {tmp_path}/look.png").stderr
    assert "cannot read" in _reprobe(desk, f"look {tmp_path}/look.png --around {AROUND}").stderr


def test_no_picture_but_a_test_point_asks_the_daemon(desk: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("daemon.cli.tester.ANSWER_WITHIN_S", 0.2)
    for command in ("look", "look TP7"):
        result = _reprobe(desk, f"{command} --endpoint ipc:///nonexistent/reprobe-test")
        assert result.exit_code == 1
        assert "is the daemon running?" in result.stderr


def _png(pixels: np.ndarray) -> bytes:
    return cv2.imencode(".png", pixels)[1].tobytes()


def test_only_whole_8_bit_pictures_are_read() -> None:
    colour = np.random.default_rng(0).integers(0, 256, (40, 50, 3), dtype=np.uint8)
    assert np.array_equal(decode(_png(colour))[0], colour)
    gray, note = decode(_png(colour[:, :, 0]))
    assert np.array_equal(gray, np.repeat(colour[:, :, :1], 3, axis=2))
    assert "gray" in note
    opaque = np.dstack([colour, np.full((40, 50), 255, np.uint8)])
    assert np.array_equal(decode(_png(opaque))[0], colour)
    opaque[3, 4, 3] = 254
    for data, words in (
        (_png(opaque), "transparent"),
        (_png(colour.astype(np.uint16) * 256), "16 bits"),
        (_png(colour)[:-40], "ends early"),
        (cv2.imencode(".jpg", colour)[1].tobytes()[:-40], "ends early"),
        (b"", "not a picture"),
        (b"GIF89a", "not a picture"),
    ):
        with pytest.raises(BadPicture) as caught:
            decode(data)
        assert words in caught.value.problem
        assert caught.value.advice


def test_a_gray_picture_is_taken_with_a_word_and_a_16_bit_one_refused(desk: Path, tmp_path: Path) -> None:
    red = _picture(desk / "red.png")[:, :, 2]
    cv2.imwrite(str(tmp_path / "gray.png"), red)
    cv2.imwrite(str(tmp_path / "deep.png"), red.astype(np.uint16) * 256)
    taken = _reprobe(desk, f"look {tmp_path}/gray.png --around {AROUND}")
    assert taken.exit_code == 0
    assert "gray" in taken.stderr
    refused = _reprobe(desk, f"look {tmp_path}/deep.png --around {AROUND}")
    assert refused.exit_code == 2
    assert "8-bit colour" in refused.stderr


def test_a_picture_of_another_size_than_taught_is_remarked(desk: Path, tmp_path: Path) -> None:
    cv2.imwrite(str(tmp_path / "small.png"), _picture(desk / "white.png")[:480, :640])
    result = _reprobe(desk, f"look --white {tmp_path}/small.png --probe probe.npz")
    assert result.exit_code == 1
    assert "1600 x 1200" in result.stderr
    assert "out_of_frame" in result.stderr


def test_a_probe_is_taught_checked_and_written(desk: Path, tmp_path: Path) -> None:
    command = f"teach --white quiet.png --tip {AROUND} --out {tmp_path}/new.npz --annotated {tmp_path}/teach.png"
    result = _reprobe(desk, f"{command} --json")
    assert result.exit_code == 0
    told = _told(result)
    assert told["h_px"] == pytest.approx(NEEDLE.taper_px, abs=1.0)
    assert told["cylinder_width_px"] == pytest.approx(NEEDLE.cylinder_width_px, abs=1.0)
    assert told["found_again_off_px"] < 0.5
    assert ProbeModel.load(tmp_path / "new.npz").h_px == pytest.approx(told["h_px"], abs=1e-3)
    assert _reprobe(desk, f"look --white white.png --probe {tmp_path}/new.npz").exit_code == 0
    assert _reprobe(desk, command).exit_code == 2
    replaced = _reprobe(desk, f"{command} --force")
    assert replaced.exit_code == 0
    assert "h, lower rim to end" in replaced.stdout
    assert {path.name for path in tmp_path.iterdir()} == {"new.npz", "teach.png"}


def test_a_probe_that_cannot_be_taught_is_not_written_but_shown(desk: Path, tmp_path: Path) -> None:
    old = (desk / "probe.npz").read_bytes()
    command = f"teach --white bare.png --tip 330,518 --out probe.npz --force --annotated {tmp_path}/teach.png"
    result = _reprobe(desk, command)
    assert result.exit_code == 1
    assert "not taught" in result.stderr
    assert (desk / "probe.npz").read_bytes() == old
    assert _picture(tmp_path / "teach.png").shape[0] > 700


def test_a_probe_that_is_not_found_again_in_its_picture_is_refused(
    desk: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    elsewhere = find_tip(white_frame(Needle(tip=(431.2, 618.6)), Camera(), 3, 0.0), ProbeModel.load(desk / "probe.npz"))
    monkeypatch.setattr("daemon.cli.teach.find_tip", lambda _picture, _model: elsewhere)
    result = _reprobe(desk, f"teach --white quiet.png --tip {AROUND} --out {tmp_path}/new.npz")
    assert result.exit_code == 1
    assert "px off in its own picture" in result.stderr
    assert not (tmp_path / "new.npz").exists()


@given(text=st.text(alphabet="0123456789.,-+eE naif_x[/]", max_size=20) | st.text(max_size=12))
@example("428.0,620.5")
@example(" 1e3 ,-2")
@example("1,2,3")
@example("inf,0")
def test_any_text_is_a_finite_point_or_a_value_error(text: str) -> None:
    try:
        point = parse_point(text)
    except ValueError:
        with pytest.raises(ValueError, match=re.escape(repr(text))):
            parse_point(text)
        return
    assert all(math.isfinite(value) for value in point)
    assert point == tuple(float(part) for part in text.split(","))


@given(x=st.floats(allow_nan=False, allow_infinity=False), y=st.floats(allow_nan=False, allow_infinity=False))
def test_a_point_survives_being_written_and_read(x: float, y: float) -> None:
    assert parse_point(f"{x!r},{y!r}") == (x, y)


@settings(max_examples=40)
@given(text=st.text(alphabet="0123456789.,-+eE naif[/]", max_size=14).filter(lambda text: not text.startswith("-")))
def test_any_around_is_answered_or_refused_without_a_traceback(desk: Path, text: str) -> None:
    words = ["look", str(desk / "red.png"), f"--around={text}", "--json"]
    result = runner.invoke(app, words)
    assert result.exception is None or isinstance(result.exception, SystemExit), result.exception
    assert result.exit_code in (0, 1, 2)
    assert result.stdout or result.stderr


def test_numbers_that_json_cannot_hold_are_null() -> None:
    assert [number(value) for value in (1.23456, math.nan, math.inf, np.float64(2.0))] == [1.2346, None, None, 2.0]
    model = ProbeModel.teach(white_frame(Needle(), Camera(), 0, 0.0), NOMINAL_TIP)
    facts = [tip_facts(find_tip(white_frame(NEEDLE, Camera(), 1, 0.3), model), model)]
    facts.append(seen_facts(find_test_points(red_frame(PADS, NEEDLE, Camera(), 2), NEEDLE.tip), NEEDLE.tip))
    json.dumps(facts, allow_nan=False)


# --- a board's CAD over a stored picture --------------------------------------------------------------------------


def _board_file(folder: Path, *, layers: bool) -> Path:
    pad = cad_pad("R1.1", 15_000.0, 12_000.0)
    board = cad_board(pad)
    path = folder / ("board.json" if layers else "old.json")
    (board if layers else board.model_copy(update={"layers": None})).save(path)
    return path


def _map_file(folder: Path) -> Path:
    path = folder / "map.json"
    path.write_text(exact_map().to_json())
    return path


@pytest.mark.parametrize("missing", ["--board", "--at", "--map"])
def test_board_at_and_map_belong_together(desk: Path, tmp_path: Path, missing: str) -> None:
    given = {"--board": _board_file(tmp_path, layers=True), "--at": "R1.1", "--map": _map_file(tmp_path)}
    options = [str(part) for name, value in given.items() if name != missing for part in (name, value)]
    result = runner.invoke(app, ["look", "--red", str(desk / "red.png"), "--around", AROUND, *options])
    assert result.exit_code == 2
    assert "belong together" in result.output


@pytest.mark.parametrize(
    ("at", "layers", "map_name", "says"),
    [
        ("R9.9", True, "map.json", "has no test point R9.9"),
        ("1,x", True, "map.json", "is not X,Y"),
        ("R1.1", False, "map.json", "no layers"),
        ("R1.1", True, "nowhere.json", "cannot read"),
    ],
)
def test_what_makes_no_sense_of_a_board_is_refused_in_a_sentence(
    desk: Path, tmp_path: Path, at: str, layers: bool, map_name: str, says: str
) -> None:
    board = _board_file(tmp_path, layers=layers)
    _map_file(tmp_path)
    arguments = ["--board", str(board), "--at", at, "--map", str(tmp_path / map_name)]
    result = runner.invoke(app, ["look", "--red", str(desk / "red.png"), "--around", AROUND, *arguments])
    assert result.exit_code == 2
    assert says in re.sub(r"\s+", " ", result.output)
    assert "Traceback" not in result.output


def test_a_picture_of_something_else_is_not_registered_and_drawn_all_the_same(desk: Path, tmp_path: Path) -> None:
    board, sheet = _board_file(tmp_path, layers=True), tmp_path / "look.png"
    arguments = ["--board", str(board), "--at", "R1.1", "--map", str(_map_file(tmp_path)), "-o", str(sheet), "--json"]
    result = runner.invoke(app, ["look", "--red", str(desk / "red.png"), "--around", AROUND, *arguments])
    assert result.exit_code == 1
    told = json.loads(result.stdout)["board"]
    assert told["found"] is False
    assert told["reason"] in ("not_this_board", "no_board", "wrong_place", "ambiguous")
    assert sheet.is_file()
