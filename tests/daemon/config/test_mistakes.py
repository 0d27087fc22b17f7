"""Mistakes that people make in a station.toml: each is named with its line, and the cure is in the message."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import pytest
from typer.testing import CliRunner

from daemon.cli.app import app
from daemon.config.model import load_config

ROOT = Path(__file__).parents[3]
EXAMPLE = ROOT / "systemd" / "station.example.toml"
pytestmark = pytest.mark.usefixtures("logging_as_before")

CROSS = EXAMPLE.read_text().partition("[control_point]")[2].partition("arm_um")[0]
CROSS = CROSS[CROSS.index("\nx_um") + 1 : CROSS.index("22000.0") + len("22000.0")]
THETA_RANGE = EXAMPLE.read_text().partition("[axes.theta]")[2].partition("9102.222222222223")[2]
THETA_RANGE = THETA_RANGE[THETA_RANGE.index("minimum") : THETA_RANGE.index("speed")]

# what was done -> (text, its replacement, words of the cure, path); counted from the first match
_METER = '[meter]\nkind = "scpi"\naddress = "127.0.0.1:5025"\n'
MISTAKES: dict[str, tuple[str, str, tuple[str, ...], str]] = {
    "a port that does not exist": (
        '"/dev/reprobe-bus"', '"/dev/ttyNOBODY9"', ("is not there on this computer",), "bus.main.port"),
    "an X range smaller than the board plus its place": (
        "maximum = 200000.0", "maximum = 65000.0", ("axes.x goes from 0 to 65000", "origin_x_um"), "axes.x"),
    "an origin in mm": ("origin_x_um = 60000.0", "origin_x_um = 60.0", ("is 60000 meant?", "um"), "board.origin_x_um"),
    "two drives at one address": ("address = 2", "address = 1", ("axes.x and axes.y", "its own"), "axes.y.address"),
    "the lamp at the Z drive's address": (
        "address = 5", "address = 3", ("axes.z and lights", "its own"), "lights.address"),
    "theta 0..360": (
        THETA_RANGE, "minimum = 0.0\nmaximum = 360.0\n", ("minimum = -220", "maximum = 100"), "axes.theta"),
    "control and events on one port": (
        "[gantry]", '[api]\ncontrol = "tcp://127.0.0.1:5555"\nevents = "tcp://127.0.0.1:5555"\n[gantry]',
        ("port of its own",), "api.events"),
    "homing method 99": ("homing_method = 17", "homing_method = 99", ("17, 18",), "axes.x.homing_method"),
    "a speed 1000 times too low": ("speed = 100000.0", "speed = 100.0", ("is 100000 meant?",), "axes.x.speed"),
    "a truth for a number": (
        "maximum = 200000.0", "maximum = true", ("write the number",), "axes.x.maximum"),
    "a wrong name of a line": ('bus = "main"\naddress = 1\n', 'bus = "mian"\naddress = 1\n', ("'main' meant",),
                               "axes.x.bus"),
    "a typo in a key": ("homing_speed = 20000.0", "homing_sped = 20000.0", ("'homing_speed' meant",),
                        "axes.x.homing_sped"),
    "a typo in a table": ("[gantry]", "[gantri]", ("'gantry' meant",), "gantri"),
    "a key in the wrong table": ("[head]", "[head]\nexposure_us = 100", ("[camera]",), "head.exposure_us"),
    "a number between quotes": ("address = 1", 'address = "1"', ("without quotes",), "axes.x.address"),
    "a decimal comma": ("speed = 100000.0", "speed = 100000,5", ("decimal point",), "(file)"),
    "a unit behind the number": ("speed = 100000.0", "speed = 100 mm", ("number alone",), "(file)"),
    "a text without quotes": ('kind = "modbus"', "kind = modbus", ("between quotes",), "(file)"),
    "yes for true": ("[gantry]", "[api]\ncurve = yes\n[gantry]", ("true or false",), "(file)"),
    "a closing quote left out": ('name = "station-1"', 'name = "station-1', ("closing quote",), "(file)"),
    "a key given twice": ("address = 2", "address = 2\naddress = 3", ("twice", "keep one"), "(file)"),
    "ends exchanged": (
        "minimum = 0.0\nmaximum = 200000.0", "minimum = 200000.0\nmaximum = 0.0", ("exchanged",), "axes.x"),
    "a range in mm": ("maximum = 200000.0", "maximum = 200.0", ("is 200000 meant?",), "axes.x.maximum"),
    "increments per mm": (
        "increments_per_unit = 655.36", "increments_per_unit = 655360.0", ("is 655.36 meant?",),
        "axes.x.increments_per_unit"),
    "an acceleration in mm": ("acceleration = 1000000.0", "acceleration = 1000.0", ("is 1e+06 meant?",),
                              "axes.x.acceleration"),
    "a head's radius in mm": ("radius_um = 14938.26", "radius_um = 14.938", ("is 14938 meant?",), "head.radius_um"),
    "an address out of range": ("address = 1", "address = 248", ("less than or equal to 247",), "axes.x.address"),
    "parity in a word": ('parity = "E"', 'parity = "even"', ("'N', 'E' or 'O'",), "bus.main.parity"),
    "a port's bare name": ('"/dev/reprobe-bus"', '"ttyUSB0"', ("'/dev/ttyUSB0'",), "bus.main.port"),
    "a device's first slash left out": (
        '"/dev/reprobe-bus"', '"dev/ttyUSB0"', ("'/dev/ttyUSB0'",), "bus.main.port"),
    "a baud rate mistyped": ("baudrate = 115200", "baudrate = 115000", ("115200 is the nearest",), "bus.main.baudrate"),
    "keys right under [bus]": ("[bus.main]", "[bus]", ("[bus.main]",), "bus.port"),
    "a required key left out": ("homing_method = 17                # 17, 18: a limit switch; 19..22: home switch\n", "",
                                  ("required and missing", "6098h"), "axes.x.homing_method"),
    "a safe height in a board": ("safe_z_um = 12000.0", "safe_z_um = 5300.0", ("must be above", "5600"),
                                 "gantry.safe_z_um"),
    "a needle thicker than its barrel": (
        "[touch]", "[clearance]\nneedle_radius_um = 1600.0\n[touch]", ("barrel_radius_um = 1500",),
        "clearance.needle_radius_um"),
    "a head below its barrel": (
        "[touch]", "[clearance]\nhead_from_um = 1900.0\n[touch]", ("barrel_from_um = 2000",), "clearance.head_from_um"),
    "a barrel that meets the board": (
        "[touch]", "[clearance]\nbarrel_from_um = 300.0\n[touch]", ("gantry.overtravel_um = 300",),
        "clearance.barrel_from_um"),
    "a nest above the safe height": (
        "[touch]", "[clearance]\nnest_um = 7000.0\n[touch]", ("= 7000 um",), "clearance.nest_um"),
    "a part above the safe height": (
        "[touch]", "[clearance]\nheights_um = { J = 8500.0 }\n[touch]", ("safe_z_um - touch_z_um",),
        "clearance.heights_um.J"),
    "a head beside its needle": (
        "[touch]", "[clearance]\nhead_box_um = [5.0, -9.0, 9.0, 9.0]\n[touch]", ("count from the needle",),
        "clearance.head_box_um"),
    "no room at all above the surface": (
        "[touch]", "[clearance]\nclear_um = 20.0\n[touch]", ("greater than or equal to 150",), "clearance.clear_um"),
    "a part's letters in small": (
        "[touch]", "[clearance]\nheights_um = { c = 800.0 }\n[touch]", ("c",), "clearance.heights_um.c"),
    "heights beyond the axis": ("safe_z_um = 12000.0", "safe_z_um = 42000.0", ("0..30000",), "gantry.safe_z_um"),
    "homing that lowers the needle": ("homing_position = 30000.0", "homing_position = 0.0", ("homing_method 18",),
                                      "axes.z.homing_position"),
    "one switch for both rings": ("red = 1", "red = 0", ("each ring has its own",), "lights"),
    "a camera by its number": ('device = "/dev/reprobe-camera"', 'device = "0"', ("'/dev/video0'",), "camera.device"),
    "another camera kind": ('kind = "v4l2"', 'kind = "v4l"', ("'v4l2' meant",), "camera.kind"),
    "a socket for everybody": ("[gantry]", '[api]\ncontrol = "tcp://*:5555"\n[gantry]', ("reprobe keys new",), "api"),
    "a socket without its scheme": (
        "[gantry]", '[api]\nevents = "127.0.0.1:5556"\n[gantry]', ("tcp://127.0.0.1:5555",), "api.events"),
    "an exposure in ms": ("exposure_us = 20000", "exposure_us = 20", ("is 20000 meant?",), "camera.exposure_us"),
    "a watch that is none": ("off = []", 'off = ["tipp"]', ("'tip' meant",), "maintenance.off"),
    "a board file that is not there": ('"board.json"', '"bord.json"', ("reprobe board",), "board.file"),
    "one port for two lines": (
        "[axes.x]", '[bus.second]\nport = "/dev/reprobe-bus"\n[axes.x]', ("port of its own",), "bus.second.port"),
    "an infinite limit": ("maximum = 200000.0", "maximum = inf", ("finite",), "axes.x.maximum"),
    "a rotation in a text": (
        "rotation_deg = 0.0", 'rotation_deg = "90 deg"', ("without quotes",), "board.rotation_deg"),
    "press deeper than the pin may go": ("press_um = 200.0", "press_um = 2000.0", ("less than or equal to 500",),
                                         "gantry.press_um"),
    "a rung that is none": ('"second_site"]', '"scrub"]', ("scrub",), "ladder.order.3"),
    "a rung twice": ('"second_site"]', '"look"]', ("names a rung twice",), "ladder"),
    "the first touch as a rung": ('["look",', '["touch", "look",', ("leave out touch",), "ladder"),
    "more touches in a visit than in a life": (
        "touches_per_visit = 3", "touches_per_visit = 9", ("more than in a pad's life (8)",),
        "ladder.touches_per_visit"),
    "a brush and no reference pad": ("[board]", "[brush]\nx_um = 30000.0\ny_um = 40000.0\n[board]",
                                     ("needs [reference]",), "brush"),
    "a reference pad and nothing to read it by": (
        "[board]", "[reference]\nx_um = 30000.0\ny_um = 34000.0\n[board]", ("needs [meter]",), "reference"),
    "a reference pad below the floor": (
        "[board]", f"{_METER}[reference]\nx_um = 30000.0\ny_um = 34000.0\nz_um = 500.0\n[board]", ("surface_range_um",),
        "reference.z_um"),
    "a reference pad in mm": (
        "[board]", f"{_METER}[reference]\nx_um = 30.0\ny_um = 34000.0\n[board]", ("is 30000 meant?",),
        "reference.x_um"),
    "a proof of contact by the net itself": (
        "[board]", f"{_METER}contact_channel = 101\nchannels = {{ CLK = 101 }}\n[board]", ("net 'CLK'",),
        "meter.contact_channel"),
    "a proof of contact that accuses nobody": (
        "[board]", f"{_METER}contact_channel = 1\n[board]", ("no open is ever accused",), "meter.contact_channel"),
    "a ground without a pin": ("[board]", f'{_METER}ground_net = "GDN"\nchannels = {{ GND = 102 }}\n[board]',
                               ("'GND' meant",), "meter.ground_net"),
    "a lead for increments": (
        "increments_per_unit = 655.36", "increments_per_unit = 5.0", ("is it the lead", "655.36"),
        "axes.x.increments_per_unit"),
    "a head's range in radians": (
        THETA_RANGE, "minimum = -3.84\nmaximum = 1.745\n", ("-220 and 100 meant",), "axes.theta.maximum"),
    "looks from where the needle touches": (
        "work_z_um = 5200.0", "work_z_um = 5000.0", ("usual is 5200",), "gantry.work_z_um"),
    "a press in mm": ("press_um = 200.0", "press_um = 0.2", ("is 200 meant?",), "gantry.press_um"),
    "a pin's rate per um": (
        "rate_n_per_mm = 0.6", "rate_n_per_mm = 0.0006", ("is 0.6 meant?",), "pin.rate_n_per_mm"),
    "a dwell in seconds": ("dwell_ms = 30.0", "dwell_ms = 0.03", ("is 30 meant?",), "touch.dwell_ms"),
    "a quota in GB": (
        "pictures_quota_mb = 500.0", "pictures_quota_mb = 0.5", ("is 500 meant?",), "station.pictures_quota_mb"),
    "a rotation in radians": ("rotation_deg = 0.0", "rotation_deg = 1.5708", ("is 90 meant?",), "board.rotation_deg"),
    "a data folder that is a file": (
        '"/var/lib/reprobe"', '"station.toml"', ("a folder is wanted",), "station.data_dir"),
    "a name with a slash": ('"station-1"', '"line/1"', ("leave out slashes",), "station.name"),
    "keys that were never made": (
        "[gantry]", '[api]\ncurve = true\nkeys_dir = "nowhere"\n[gantry]', ("reprobe keys new",), "api.keys_dir"),
    "metrics on a port of the system's": (
        "[gantry]", "[metrics]\nport = 80\n[gantry]", ("9464",), "metrics.port"),
    "a channel for a net that the board has not": (
        "[board]", f"{_METER}channels = {{ CLKK = 101 }}\n[board]", ("'CLK' meant",), "meter.channels.CLKK"),
    "one channel for two nets": (
        "[board]", f"{_METER}channels = {{ CLK = 101, GND = 101 }}\n[board]", ("has its own",), "meter.channels.GND"),
    "cycles of the mains beyond sense": (
        "[board]", f"{_METER}[meter.methods.resistance]\nnplc = 2000\n[board]", ("is 2 meant?",),
        "meter.methods.resistance.nplc"),
    "a touch sense on the input of a limit switch": (
        "[lights]", '[sense]\nkind = "drive_input"\ninput = 1\nclosed = "high"\n[lights]', ("negative limit switch",),
        "sense.input"),
    "homing of Z to the lower switch": (
        "homing_method = 18", "homing_method = 17", ("press the needle down", "is 18 meant"), "axes.z.homing_method"),
    "inputs without the switch of homing": (
        "# switch_inputs = 7", "switch_inputs = 0 #", ("7 is all three",), "axes.x.switch_inputs"),
    "homing faster than any move": (
        "homing_speed = 20000.0", "homing_speed = 900000.0", ("homing is slower",), "axes.x.homing_speed"),
    "a host with its port": (
        'port = "/dev/reprobe-bus"', 'host = "10.0.0.5:502"', ("tcp_port = 502",), "bus.main.host"),
    "an approach of many degrees": (
        "[touch] ", "approach_deg = 50.0\n[touch] ", ("usual is 0.5",), "gantry.approach_deg"),
    "a remark by a semicolon": ('parity = "E"', 'parity = "E"  ; even', ("begins with #",), "(file)"),
    "a typesetter's minus": ("minimum = -220.0", "minimum = \u2212220.0", ("plain minus",), "(file)"),
    "a number with dots for thousands": ("maximum = 200000.0", "maximum = 200.000,0", ("in one piece",), "(file)"),
    "one rung and no list": (
        '["look", "pump", "reference", "second_site"]', '"look"', ("should be a list",), "ladder.order"),
    "a tolerance in mm": ("[gantry]", "[servo]\ntolerance_um = 0.015\n[gantry]", ("is 15 meant?",),
                          "servo.tolerance_um"),
    "a port's name of Windows": ('"/dev/reprobe-bus"', '"COM3"', ("Windows", "/dev/ttyUSB0"), "bus.main.port"),
    "a folder of Windows": ('"/var/lib/reprobe"', "'C:\\reprobe'", ("with /",), "station.data_dir"),
    "a home folder by its sign": ('"/var/lib/reprobe"', '"~/reprobe"', ("not replaced", "whole"), "station.data_dir"),
    "a data folder that does not outlive a start": (
        '"/var/lib/reprobe"', '"/tmp/reprobe"', ("next start", "/var/lib/reprobe"), "station.data_dir"),
    "a picture on end": (
        "exposure_us = 20000", "width = 1200\nheight = 1600", ("width = 1600, height = 1200",), "camera.width"),
    "a port that the kind of lamp does not use": (
        "white = 0", 'port = "/dev/null"\nwhite = 0', ("not used", "'serial'"), "lights.port"),
    "an endpoint that the kind of camera does not use": (
        "exposure_us = 20000", 'endpoint = "ipc:///run/frames"', ("not used", "'stream'"), "camera.endpoint"),
    "a safe height in mm": ("safe_z_um = 12000.0", "safe_z_um = 12.0", ("is 12000 meant?",), "gantry.safe_z_um"),
    "the board's height in mm": ("touch_z_um = 5000.0", "touch_z_um = 5.0", ("is 5000 meant?",), "gantry.touch_z_um"),
    "looks from far above": (
        "work_z_um = 5200.0", "work_z_um = 9200.0", ("usual is 5200",), "gantry.work_z_um"),
    "a pin's travel in mm": ("travel_um = 1000.0", "travel_um = 1.0", ("is 1000 meant?",), "pin.travel_um"),
    "an arm of the cross in mm": ("arm_um = 720.0", "arm_um = 0.72", ("is 720 meant?",), "control_point.arm_um"),
    "a time-out in seconds": (
        'parity = "E"', "timeout_ms = 0.2", ("is 200 meant?",), "bus.main.timeout_ms"),
    "a socket by its port alone": (
        "[gantry]", "[api]\ncontrol = 5555\n[gantry]", ("tcp://127.0.0.1:5555",), "api.control"),
    "a name that is empty": ('"station-1"', '""', ("not be empty",), "station.name"),
    "more than a turn": ("rotation_deg = 0.0", "rotation_deg = 450.0", ("is 90 meant?",), "board.rotation_deg"),
    "a scale of zero": (
        "increments_per_unit = 655.36", "increments_per_unit = 0", ("increments per um",),
        "axes.x.increments_per_unit"),
    "no line at all": ("[bus.main]", "[meters.main]", ("[bus.NAME]", "port"), "bus"),
    "a host as in a browser": (
        'port = "/dev/reprobe-bus"', 'host = "http://10.0.0.5"', ("host = '10.0.0.5'",), "bus.main.host"),
    "one gateway for two lines": (
        '[bus.main]\nport = "/dev/reprobe-bus"', '[bus.two]\nhost = "10.0.0.5"\n[bus.main]\nhost = "10.0.0.5"',
        ("also [bus.two]", "leave one out"), "bus.main.host"),
    "a port of the network on a serial line": (
        'parity = "E"', "tcp_port = 5020", ("leave it out", "host"), "bus.main.tcp_port"),
    "a silence in seconds": ('parity = "E"', "gap_ms = 0.003", ("is 3 meant?",), "bus.main.gap_ms"),
    "a reference pad on the board": (
        "[board]", f"{_METER}[reference]\nx_um = 65000.0\ny_um = 45000.0\n[board]", ("belongs beside it",),
        "reference.x_um"),
    "a cross on the board": (
        CROSS,
        "x_um = 70000.0\ny_um = 50000.0",
        ("belongs beside it",),
        "control_point.x_um",
    ),
    "a brush where the reference pad is": (
        "[board]",
        f"{_METER}[reference]\nx_um = 30000.0\ny_um = 34000.0\n[brush]\nx_um = 30000.0\ny_um = 34100.0\n[board]",
        ("100 um from [reference]", "its own middle"),
        "brush.x_um",
    ),
    "a head in mm": (
        "[touch] ", "[clearance]\nhead_box_um = [-60.0, -60.0, 60.0, 60.0]\n[touch] ", ("60000] meant?",),
        "clearance.head_box_um"),
    "a head without its last side": (
        "[touch] ", "[clearance]\nhead_box_um = [-60.0, -60.0, 60.0]\n[touch] ", ("element 4 is missing", "x0, y0"),
        "clearance.head_box_um.3"),
    "a part's height in mm": (
        "[touch] ", "[clearance]\nheights_um = { R = 0.8 }\n[touch] ", ("is 800 meant?",), "clearance.heights_um.R"),
    "a nest's height in mm": ("[touch] ", "[clearance]\nnest_um = 2\n[touch] ", ("is 2000 meant?",),
                              "clearance.nest_um"),
    "a nest's height in quotes": ("[touch] ", '[clearance]\nnest_um = "2000"\n[touch] ', ("without quotes",),
                                  "clearance.nest_um"),
    "a needle's radius in mm": (
        "[touch] ", "[clearance]\nneedle_radius_um = 0.5\n[touch] ", ("is 500 meant?",), "clearance.needle_radius_um"),
    "landings in mm": ("[gantry]", "[servo]\nlanding_um = 0.04\n[gantry]", ("is 40 meant?",), "servo.landing_um"),
    "a tip's radius in mm": (
        "[gantry]", "[servo]\ntip_radius_um = 0.025\n[gantry]", ("is 25 meant?",), "servo.tip_radius_um"),
    "darkness as a share": ("white = 0", "dark_level = 0.2\nwhite = 0", ("usual is 60",), "lights.dark_level"),
    "a camera that is frozen before it has exposed": (
        "exposure_us = 20000", "exposure_us = 500000\nfrozen_ms = 60", ("usual is 1000",), "camera.frozen_ms"),
    "a pin that is never pushed in": (
        "overtravel_um = 300.0", "overtravel_um = 0", ("usual is 300",), "gantry.overtravel_um"),
    "a data folder left empty": ('"/var/lib/reprobe"', '""', ("/var/lib/reprobe",), "station.data_dir"),
    "more jobs of one client than of all": (
        "[gantry]", "[api]\nqueue_length = 4\nqueue_per_client = 100\n[gantry]", ("no more than that",),
        "api.queue_per_client"),
    "an instrument's address without its port": (
        "[board]", f'{_METER.replace(":5025", "")}[board]', ("192.168.0.7:5025",), "meter.address"),
    "channels closed by a number of its own": (
        "[board]", f'{_METER}close_channels = "ROUT:CLOS (@101)"\n[board]', ("ROUT:CLOS (@{channels})",),
        "meter.close_channels"),
    "a method misspelt": (
        "[board]", f"{_METER}[meter.methods.resistence]\nnplc = 1\n[board]", ("'resistance' meant",),
        "meter.methods.resistence"),
    "a value with its unit in quotes": (
        "[board]", f'{_METER}[meter.methods.resistance]\nrange = "100 ohm"\n[board]', ("without quotes",),
        "meter.methods.resistance.range"),
    "a rung with a blank": ('"second_site"]', '"second site"]', ("'second_site' meant",), "ladder.order.3"),
    "the uplink's settings in the file": (
        "[gantry]", '[uplink]\nbroker = "10.0.0.1"\n[gantry]', ("reprobe uplink --help",), "uplink"),
    "a sign apart from its number": ("minimum = -220.0", "minimum = - 220.0", ("close to its number",), "(file)"),
    "a number that ends with its point": (
        "maximum = 200000.0", "maximum = 200000.", ("both sides of the decimal point",), "(file)"),
    "a number that begins with its point": ("rotation_deg = 0.0", "rotation_deg = .5", ("both sides",), "(file)"),
    "a quotient": ("= 655.36 ", "= 3276800/5000 ", ("write the result",), "(file)"),
    "a degree's sign": ("rotation_deg = 0.0", "rotation_deg = 90\u00b0", ("number alone",), "(file)"),
    "a key with a Greek letter": ("radius_um = 14938.26", "radius_\u00b5m = 14938.26", ("a-z",), "(file)"),
    "a blank that is none of the keyboard's": (
        "maximum = 200000.0", "maximum =\u00a0200000.0", ("type the line anew",), "(file)"),
    "a comma at the end of a line": ('parity = "E"', 'parity = "E",', ("ends without a comma",), "(file)"),
    "a comma left out in a list": ('"look", "pump"', '"look" "pump"', ("put a comma",), "(file)"),
    "a list left open": ('"second_site"]', '"second_site"', ("closing ] of the list",), "(file)"),
    "a table in braces": ("[axes.x]", "{axes.x}", ("square brackets: [axes.x]",), "(file)"),
    "a table's name with a blank": ("[bus.main]", "[bus.main line]", ("no blanks",), "(file)"),
    "two signs of equality": ("maximum = 200000.0", "maximum == 200000.0", ("one = alone",), "(file)"),
}  # fmt: skip


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("station")
    made = CliRunner().invoke(app, ["board", str(ROOT / "sim_hw" / "demo_board"), "-o", str(folder / "board.json")])
    assert made.exit_code == 0
    return folder


def _check(folder: Path, text: str) -> tuple[int, list[dict[str, object]]]:
    """Return the exit code, and everything that is named."""
    (folder / "station.toml").write_text(text)
    result = CliRunner().invoke(app, ["check-config", str(folder / "station.toml"), "--json"])
    says = json.loads(result.output)
    assert says["ok"] is (result.exit_code == 0)
    warnings = [{**warning, "problem": warning["warning"]} for warning in says["warnings"]]
    return result.exit_code, says["problems"] + warnings


def _mistaken(*changes: tuple[str, str]) -> str:
    text = EXAMPLE.read_text()
    for old, new in changes:
        assert old in text
        text = text.replace(old, new, 1)
    return text


@pytest.mark.parametrize("done", MISTAKES)
def test_a_mistake_is_named_with_its_place_and_its_cure(folder: Path, done: str) -> None:
    old, new, cures, path = MISTAKES[done]
    _, named = _check(folder, _mistaken((old, new)))
    here = [str(one["problem"]) for one in named if one["path"] == path]
    assert any(all(cure in text for cure in cures) for text in here), named
    assert not any("Value error" in str(one["problem"]) for one in named)


def test_a_socket_without_a_port_is_not_called_reachable_from_outside(folder: Path) -> None:
    _, named = _check(folder, _mistaken(("[gantry]", '[api]\ncontrol = "tcp://127.0.0.1"\n[gantry]')))
    assert [one["path"] for one in named if "api" in str(one["path"])] == ["api.control"]


def test_a_text_that_is_no_endpoint_is_not_called_reachable_from_outside(folder: Path) -> None:
    _, named = _check(folder, _mistaken(("[gantry]", '[api]\ncontrol = "localhost:5555"\n[gantry]')))
    assert [one["path"] for one in named if "api" in str(one["path"])] == ["api.control"]


def test_many_points_out_of_reach_for_one_reason_are_one_line(folder: Path) -> None:
    _, named = _check(folder, _mistaken(("origin_y_um = 40000.0", "origin_y_um = 400000.0")))
    said = [str(one["problem"]) for one in named if "out of reach" in str(one["problem"])]
    assert len(said) == 1
    assert said[0].startswith("12 test points (TP1, TP2, TP3, ...) are out of reach at every head angle: y ")


@pytest.mark.parametrize("name", ["safe", "touch"])
def test_a_height_in_mm_is_one_mistake_and_one_line(folder: Path, name: str) -> None:
    """What follows from it for the heights of parts and of looks is no mistake of its own."""
    height = {"safe": "12000.0", "touch": "5000.0"}[name]
    wrong = f"{name}_z_um = {float(height) / 1e3:g}"
    parts = "[clearance]\nheights_um = { J = 5500.0, R = 900.0, U = 1500.0 }\n[touch]"
    _, named = _check(folder, _mistaken((f"{name}_z_um = {height}", wrong), ("[touch]", parts)))
    said = [(one["path"], str(one["problem"])) for one in named if "warning" not in one]
    assert len(said) == 1
    assert said[0][0] == f"gantry.{name}_z_um"
    assert f"is {float(height):g} meant?" in said[0][1]


@pytest.mark.parametrize("given", ["safe_z_um = 12000.0", "origin_x_um = 60000.0"])
def test_a_number_beyond_all_numbers_is_a_mistake_and_no_defect(folder: Path, given: str) -> None:
    """Something lay on the keyboard."""
    _, named = _check(folder, _mistaken((given, f"{given.partition(' ')[0]} = {'1' * 400}")))
    assert named


def test_an_empty_file_is_called_that_once(folder: Path) -> None:
    _, named = _check(folder, "# nothing yet\n")
    assert len(named) == 1
    assert "reprobe setup" in str(named[0]["problem"])


def test_the_example_has_no_problem_and_warns_of_absent_devices_alone(folder: Path) -> None:
    code, named = _check(folder, EXAMPLE.read_text())
    assert code == 0
    assert all("is not there on this computer" in str(one["problem"]) for one in named)


def test_all_mistakes_of_a_file_are_named_in_one_go_in_the_order_of_their_lines(folder: Path) -> None:
    """A wrong field hides neither another one nor what needs two values."""
    wrong = _mistaken(
        ("address = 2", "address = 1"), ("baudrate = 115200", 'baudrate = "fast"'),
        ('bus = "main"\naddress = 4', 'bus = "mani"\naddress = 4'),
        ('bus = "main"\naddress = 5', 'bus = "x"\naddress = 5'),
        ("safe_z_um = 12000.0", "safe_z_um = 42000.0"), ("radius_um", "radius_mm"),
    )  # fmt: skip
    code, named = _check(folder, wrong)
    assert code == 2
    problems = [one for one in named if "warning" not in one]
    assert {one["path"] for one in problems} == {
        "bus.main.baudrate", "axes.y.address", "axes.theta.bus", "gantry.safe_z_um", "lights.bus", "head.radius_mm",
        "head.radius_um",
    }  # fmt: skip
    lines = [int(str(one["line"])) for one in problems]
    assert lines == sorted(lines)
    text = wrong.splitlines()
    for one in problems:
        key = str(one["path"]).rpartition(".")[2]
        assert key in text[int(str(one["line"])) - 1] or key == "radius_um"


def test_a_person_reads_the_line_the_path_and_the_cure(folder: Path) -> None:
    (folder / "station.toml").write_text(_mistaken(("homing_speed", "homing_sped")))
    result = CliRunner().invoke(app, ["check-config", str(folder / "station.toml")])
    line = 1 + EXAMPLE.read_text().splitlines().index("homing_speed = 20000.0")
    assert f"problem line {line}: axes.x.homing_sped: there is no key" in result.output
    assert "is 'homing_speed' meant?" in result.output


def test_a_byte_order_mark_is_read_and_another_encoding_said_with_its_line(folder: Path) -> None:
    file = folder / "station.toml"
    file.write_bytes(b"\xef\xbb\xbf" + EXAMPLE.read_bytes())
    assert CliRunner().invoke(app, ["check-config", str(file)]).exit_code == 0
    file.write_bytes(b'[station]\nname = "M\xfcller"\n')
    refused = CliRunner().invoke(app, ["check-config", str(file)])
    assert refused.exit_code == 2
    assert "line 2 is not UTF-8" in refused.output


def test_a_port_below_the_files_folder_is_read_and_looked_for_there(folder: Path) -> None:
    """As the data folder and the board file are; it is no mistake of the file, whether or not it is there now."""
    file = folder / "station.toml"
    code, named = _check(folder, _mistaken(('"/dev/reprobe-bus"', '"run/bus"')))
    assert code == 0
    absent = [str(one["problem"]) for one in named if one["path"] == "bus.main.port"]
    assert [text.partition(" on this")[0] for text in absent] == [f"{folder}/run/bus is not there"]
    assert load_config(file).bus["main"].port == str(folder / "run" / "bus")
    (folder / "run").mkdir()
    (folder / "run" / "bus").touch()
    code, named = _check(folder, _mistaken(('"/dev/reprobe-bus"', '"run/bus"')))
    assert (code, [one for one in named if one["path"] == "bus.main.port"]) == (0, [])


def test_sockets_of_the_files_folder_do_not_depend_on_where_the_daemon_is_started(folder: Path) -> None:
    sockets = '[api]\ncontrol = "ipc://run/control"\nevents = "ipc://@events"\n[gantry]'
    assert _check(folder, _mistaken(("[gantry]", sockets)))[0] == 0
    api = load_config(folder / "station.toml").api
    assert (api.control, api.events) == (f"ipc://{folder}/run/control", "ipc://@events")


def test_with_probe_a_port_that_is_not_there_is_a_problem(folder: Path) -> None:
    file = folder / "probed.toml"
    shutil.copy(EXAMPLE, file)
    assert CliRunner().invoke(app, ["check-config", str(file)]).exit_code == 0
    asked = CliRunner().invoke(app, ["check-config", str(file), "--probe"])
    assert asked.exit_code == 2
    assert "problem line 12: bus.main.port: /dev/reprobe-bus is not there" in asked.output
