"""A configuration is right as a whole or refused with every fault named."""

from pathlib import Path

import pytest

from daemon.config.model import Config, ConfigError, load_config
from daemon.tools.demo.settings import Places, write_settings
from tests.vm.station import NOWHERE, emulated_settings

EXAMPLE = Path(__file__).parents[3] / "systemd" / "station.example.toml"


def _changed(tmp_path: Path, *changes: tuple[str, str]) -> Path:
    text = EXAMPLE.read_text()
    for old, new in changes:
        assert old in text
        text = text.replace(old, new, 1)
    path = tmp_path / "station.toml"
    path.write_text(text)
    return path


def _problems(path: Path) -> dict[str, str]:
    with pytest.raises(ConfigError) as caught:
        load_config(path)
    return dict(caught.value.problems)


def test_the_example_is_good() -> None:
    config = load_config(EXAMPLE)
    assert config.axes.theta.maximum == 100.0
    assert config.board.file == EXAMPLE.parent / "board.json"


def test_a_byte_order_mark_is_no_fault(tmp_path: Path) -> None:
    path = _changed(tmp_path)
    path.write_text(path.read_text(), encoding="utf-8-sig")
    assert load_config(path).station == load_config(EXAMPLE).station


def test_the_demonstration_writes_a_good_one(tmp_path: Path) -> None:
    config = load_config(write_settings(Places(tmp_path, tmp_path)))
    assert isinstance(config, Config)
    assert config.bus["main"].port == str(tmp_path / "bus")


def test_the_emulated_machine_is_given_a_good_one(tmp_path: Path) -> None:
    """Its own tests run last and take minutes: what the demonstration's settings gained is found here."""
    text = emulated_settings()
    assert str(NOWHERE) not in text
    path = tmp_path / "station.toml"
    path.write_text(text)
    assert load_config(path).board.file == tmp_path / "board.json"


def test_all_faults_are_told_at_once_with_their_paths(tmp_path: Path) -> None:
    path = _changed(
        tmp_path,
        ("address = 1", "address = 900"),
        ("baudrate = 115200", 'baudrate = "fast"'),
        ("exposure_us = 20000", "exposure_us = 20000\nshutter = 3"),
    )
    assert set(_problems(path)) == {"axes.x.address", "bus.main.baudrate", "camera.shutter"}


@pytest.mark.parametrize(
    ("change", "where", "what"),
    [
        (("minimum = 0.0", ""), "axes.x.minimum", "required"),
        (("minimum = 0.0", "minimum = 300000.0"), "axes.x", "not below"),
        (("minimum = 0.0", "minimum = nan"), "axes.x.minimum", "finite"),
        (('bus = "main"', 'bus = "other"'), "axes.x.bus", "not under [bus]"),
        (("address = 1", "address = 2"), "axes.y.address", "axes.x and axes.y have the same address 2"),
        (("address = 4", "address = 5"), "lights.address", "axes.theta and lights have the same address 5"),
        (("work_z_um = 5200.0", "work_z_um = 4200.0"), "gantry", "touch_z_um <= work_z_um"),
        (("safe_z_um = 12000.0", "safe_z_um = 42000.0"), "gantry.safe_z_um", "axes.z"),
        (("red = 1", "red = 0"), "lights", "same switch"),
        (('device = "/dev/reprobe-camera"', ""), "camera", "needs device"),
        (('port = "/dev/reprobe-bus"', ""), "bus.main", "either port or host"),
        (("[gantry]", '[api]\ncontrol = "tcp://0.0.0.0:5555"\n[gantry]'), "api", "reachable from outside"),
    ],
)
def test_each_bad_value_is_named(tmp_path: Path, change: tuple[str, str], where: str, what: str) -> None:
    problems = _problems(_changed(tmp_path, change))
    assert what in problems[where]


def test_a_missing_or_torn_file_says_so(tmp_path: Path) -> None:
    assert "cannot be read" in _problems(tmp_path / "none.toml")["(file)"]
    (tmp_path / "torn.toml").write_text("[station\nname=")
    assert "is not TOML" in _problems(tmp_path / "torn.toml")["(file)"]


# --- heights --------------------------------------------------------------------------------------------------------


def test_heights_that_say_nothing_of_the_surface_have_a_range_an_overtravel_and_a_slow_descent(tmp_path: Path) -> None:
    """Files from before these fields stay good."""
    left_out = tuple((line + "\n", "") for line in EXAMPLE.read_text().splitlines() if "surface_range_um = " in line
                     or "overtravel_um = " in line or "descent_speed = " in line)  # fmt: skip
    assert len(left_out) == 3
    gantry = load_config(_changed(tmp_path, *left_out)).gantry
    assert (gantry.surface_range_um, gantry.overtravel_um, gantry.descent_speed) == (500.0, 300.0, 2000.0)
    assert (gantry.highest_surface_um, gantry.free_z_um) == (5500.0, 5600.0)


@pytest.mark.parametrize(
    ("change", "lowest_um"),
    [
        (("overtravel_um = 300.0", "overtravel_um = 300.0"), 4200.0),
        (("overtravel_um = 300.0", "overtravel_um = 100.0"), 4300.0),  # the press counts where it is more
        (("surface_range_um = 500.0", "surface_range_um = 150.0"), 4550.0),
        (("minimum = 0.0\nmaximum = 30000.0", "minimum = 4700.0\nmaximum = 30000.0"), 4700.0),
    ],
)
def test_the_floor_is_the_lowest_surface_less_the_most_overtravel(
    tmp_path: Path, change: tuple[str, str], lowest_um: float
) -> None:
    assert load_config(_changed(tmp_path, change)).lowest_z_um == lowest_um


@pytest.mark.parametrize(
    ("change", "where", "what"),
    [
        (("descent_speed = 2000.0", "descent_speed = 2000.1"), "gantry.descent_speed", "less than or equal to 2000"),
        (("surface_range_um = 500.0", "surface_range_um = -1.0"), "gantry.surface_range_um", "greater than or equal"),
        (
            ("safe_z_um = 12000.0", "safe_z_um = 5600.0"),
            "gantry.safe_z_um",
            "above touch_z_um + surface_range_um + 100",
        ),
    ],
)
def test_heights_at_which_a_board_would_be_hit_are_refused(
    tmp_path: Path, change: tuple[str, str], where: str, what: str
) -> None:
    assert what in _problems(_changed(tmp_path, change))[where]


# --- presses --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("change", "what"),
    [
        (
            ("travel_um = 1000.0 ", "travel_um = 440.0 "),
            "gantry.overtravel_um = 300 is more than two thirds of pin.travel",
        ),
        (("\npress_um = 200.0", "\npress_um = 400.0"), None),
        (("\npress_um = 200.0", "\npress_um = 500.0\novertravel_um = 666.0"), None),
        (
            ("\npress_um = 200.0", "\npress_um = 200.0\novertravel_um = 667.0"),
            "more than two thirds of pin.travel_um (667)",
        ),
        (
            ("approach_um = 300.0 ", "overtravel_um = 301.0 #"),
            "touch.overtravel_um = 301 is more than gantry.overtravel_um",
        ),
    ],
)
def test_no_press_goes_beyond_two_thirds_of_the_pins_travel(
    tmp_path: Path, change: tuple[str, str], what: str | None
) -> None:
    changes = [change]
    if "\novertravel_um" in change[1]:
        changes.insert(0, ("overtravel_um = 300.0 ", "# "))
    if what is None:
        load_config(_changed(tmp_path, *changes))
        return
    with pytest.raises(ConfigError) as caught:
        load_config(_changed(tmp_path, *changes))
    assert what in str(caught.value)


def test_a_file_without_touch_and_pin_stays_good_and_touches_as_deep_as_is_allowed(tmp_path: Path) -> None:
    text = EXAMPLE.read_text()
    section = text[text.index("[touch]") : text.index("[lights]")]
    config = load_config(_changed(tmp_path, (section, ""), ("overtravel_um = 300.0", "overtravel_um = 250.0")))
    assert (config.press_um, config.touch.approach_um, config.pin.stroke_um) == (
        250.0,
        300.0,
        pytest.approx(666.67, abs=0.01),
    )
    assert config.pin.force_n(250.0) == pytest.approx(0.45)
    assert config.pin.force_n(0.0) == 0.0
