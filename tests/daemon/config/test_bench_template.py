"""The configuration of a bench is a whole one, with its own places, and waits by its station's time."""

from pathlib import Path

from daemon.config.bench_template import REPLY_MS, STILL_MS, BenchPlaces, BenchWaits, bench_toml
from daemon.config.model import Config, load_config

PLACES = BenchPlaces(
    by="a test",
    name="bench-7",
    data_dir="/var/lib/bench-7",
    line="/run/bench-7/bus",
    camera="ipc:///run/bench-7/camera",
    control="tcp://127.0.0.1:5557",
    events="tcp://127.0.0.1:5558",
)


def _loaded(folder: Path, waits: BenchWaits) -> Config:
    file = folder / "station.toml"
    file.write_text(bench_toml(PLACES, waits, "failed"))
    return load_config(file)


def test_a_bench_has_the_places_it_was_given(tmp_path: Path) -> None:
    config = _loaded(tmp_path, BenchWaits())
    assert (config.station.name, str(config.station.data_dir)) == (PLACES.name, PLACES.data_dir)
    assert (config.station.pictures, config.bus["main"].port) == ("failed", PLACES.line)
    assert config.camera.endpoint == PLACES.camera
    assert (config.api.control, config.api.events) == (PLACES.control, PLACES.events)
    assert (tmp_path / "station.toml").read_text().startswith("# Written by `a test`.")


def test_a_fast_station_shortens_the_waits_and_no_timeout(tmp_path: Path) -> None:
    fast = _loaded(tmp_path, BenchWaits(speed=6.0))
    assert fast.gantry.settle_ms == STILL_MS / 6.0
    assert fast.bus["main"].timeout_ms == REPLY_MS
