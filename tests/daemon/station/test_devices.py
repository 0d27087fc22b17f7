"""What the configuration says is what the drivers are told."""

from pathlib import Path

from daemon.config.model import Config, load_config
from daemon.station import devices as hardware
from drivers.bus import OdAddressing, SerialLine, TcpLine

EXAMPLE = Path(__file__).parents[3] / "systemd" / "station.example.toml"


def _config(tmp_path: Path, *changes: tuple[str, str]) -> Config:
    text = EXAMPLE.read_text()
    for old, new in changes:
        assert old in text
        text = text.replace(old, new, 1)
    (tmp_path / "station.toml").write_text(text)
    return load_config(tmp_path / "station.toml")


def test_a_serial_line_and_one_over_tcp(tmp_path: Path) -> None:
    config = _config(tmp_path)
    assert hardware.bus_line(config.bus["main"]) == SerialLine("/dev/reprobe-bus", 115200, "E", 1)
    gateway = 'host = "127.0.0.1"\ntcp_port = 4001'
    config = _config(tmp_path, ('port = "/dev/reprobe-bus"', gateway))
    assert hardware.bus_line(config.bus["main"]) == TcpLine("127.0.0.1", 4001, "rtu")


def test_open_points_of_a_drive_can_be_fixed(tmp_path: Path) -> None:
    settled = 'word_order = "little"\nobject_access = { index_order = "little", node = 0 }\naddress = 1'
    axis = hardware.axis_config("x", _config(tmp_path, ("address = 1", settled)).axes.x)
    assert (axis.word_order, axis.addressing) == ("little", OdAddressing("little", 0, 1))
    assert hardware.axis_config("y", _config(tmp_path).axes.y).addressing is None


def test_theta_arrives_within_hundredths_of_a_degree(tmp_path: Path) -> None:
    axes = _config(tmp_path).axes
    assert hardware.axis_config("theta", axes.theta).window_units < 0.05625
    assert hardware.axis_config("x", axes.x).window_units == 1.0
