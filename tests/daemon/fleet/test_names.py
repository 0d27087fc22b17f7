"""Topics, partitions and connections: what is allowed, and what is said where it is not."""

import importlib.util
from datetime import UTC, date, datetime

import pytest
from typer.testing import CliRunner

from daemon.cli.app import app
from daemon.fleet.partitions import day_of, month_of, needed, over
from daemon.fleet.topics import BadName, StationPath, everywhere

NOW = datetime(2026, 12, 31, 23, 30, tzinfo=UTC)


def test_a_topic_tells_its_station_again() -> None:
    path = StationPath("plant north", "L1", "station-1")
    assert StationPath.of(path.topic("records")) == path
    assert everywhere("records") == "reprobe/v1/+/+/+/records"


@pytest.mark.parametrize("name", ["", "a/b", "+", "#", "$SYS", "a\0", "a\nb", "x" * 65])
def test_a_name_no_topic_can_bear_is_refused_with_advice(name: str) -> None:
    with pytest.raises(BadName) as refused:
        StationPath("north", "L1", name)
    assert refused.value.advice


@pytest.mark.parametrize("topic", ["", "reprobe/v1/a/b/c", "reprobe/v2/a/b/c/records", "reprobe/v1/a//c/records"])
def test_a_topic_of_no_station_is_refused(topic: str) -> None:
    with pytest.raises(BadName):
        StationPath.of(topic)


def test_partitions_are_there_before_their_day_over_the_end_of_a_year() -> None:
    assert [partition.name for partition in needed(NOW)] == [
        "records_2026_12", "records_2027_01", "recent_2026_12_31", "recent_2027_01_01",
    ]  # fmt: skip
    assert month_of(date(2026, 12, 31)).end == date(2027, 1, 1)
    assert day_of(date(2028, 2, 29)).end == date(2028, 3, 1)


def test_only_partitions_whose_time_is_over_go() -> None:
    names = ["recent_2026_12_23", "recent_2026_12_24", "records_2026_09", "records_2026_10", "something"]
    assert over(names, NOW, 7, None) == ["recent_2026_12_23"]
    assert over(names, NOW, 7, 2) == ["recent_2026_12_23", "records_2026_09"]


BROKERS = [
    (("broker.plant", None, None, None), "in clear"),
    (("127.0.0.1:0", None, None, None), "is no broker"),
    (("127.0.0.1:mqtt", None, None, None), "is no broker"),
    (("127.0.0.1", None, "cert.pem", None), "needs its key"),
    (("127.0.0.1", None, "cert.pem", "key.pem"), "--ca"),
]


@pytest.mark.parametrize(("told", "says"), BROKERS)
def test_a_broker_that_must_not_be_used_is_refused_in_words(told: tuple[str | None, ...], says: str) -> None:
    broker = pytest.importorskip("daemon.fleet.broker", exc_type=ImportError)
    with pytest.raises(broker.BadConnection) as refused:
        broker.Broker.of(*told)
    assert says in str(refused.value)
    assert refused.value.advice


def test_without_the_extra_both_commands_say_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(importlib.util, "find_spec", lambda _name: None)
    for words in (["uplink", "--site", "a", "--line", "b"], ["collect", "--database", "postgresql://x@127.0.0.1/x"]):
        result = CliRunner().invoke(app, words)
        assert result.exit_code == 2
        assert "pip install 'reprobe[fleet]'" in result.output
    assert "pip install 'reprobe[page]'" in CliRunner().invoke(app, ["page"]).output


def test_a_database_that_is_none_is_refused() -> None:
    result = CliRunner().invoke(app, ["collect", "--database", "mysql://x"])
    assert result.exit_code == 2
    assert "postgresql://" in result.output
