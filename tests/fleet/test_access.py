"""The broker as it is shipped: who comes is known by a certificate, and no station writes for another or downward."""

from __future__ import annotations

import asyncio
import shutil
import subprocess
from collections.abc import Iterator
from pathlib import Path

import aiomqtt
import pytest

from daemon.fleet.broker import BadConnection, Broker
from daemon.fleet.topics import StationPath, everywhere
from tests.fleet.engines import Mosquitto

SHIPPED = Path(__file__).parents[2] / "systemd"
ONE, TWO = StationPath("north", "L1", "station-1"), StationPath("north", "L1", "station-2")
NAMES = ("broker", "station-1", "collect", "stranger")


def _certificates(folder: Path) -> None:
    """Make an authority, and a certificate signed by it for each name; the stranger signs for itself."""

    def openssl(*words: str) -> None:
        subprocess.run(["openssl", *words], check=True, capture_output=True, cwd=folder)  # noqa: S607

    make = ("req", "-x509", "-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:P-256", "-nodes", "-days", "2")
    openssl(*make, "-keyout", "ca.key", "-out", "ca.pem", "-subj", "/CN=plant")
    for name in NAMES:
        signed = () if name == "stranger" else ("-CA", "ca.pem", "-CAkey", "ca.key")
        openssl(*make, *signed, "-keyout", f"{name}.key", "-out", f"{name}.pem", "-subj", f"/CN={name}",
                "-addext", "subjectAltName=IP:127.0.0.1", "-addext", "basicConstraints=critical,CA:FALSE")  # fmt: skip


class ShippedBroker(Mosquitto):
    """The broker with the shipped configuration, its files in another folder and its port another."""

    def __init__(self, folder: Path) -> None:
        super().__init__(folder)
        text = (SHIPPED / "mosquitto.conf").read_text().replace("/etc/mosquitto/reprobe", str(folder))
        # As root the broker becomes another user, who may not look into a test's folder.
        text += f"user {Path.home().owner()}\n"
        (folder / "mosquitto.conf").write_text(text.replace("listener 8883", f"listener {self.port} 127.0.0.1"))
        shutil.copy(SHIPPED / "mosquitto.acl", folder / "acl")


@pytest.fixture
def broker(tmp_path: Path) -> Iterator[Mosquitto]:
    _certificates(tmp_path)
    found = ShippedBroker(tmp_path)
    found.start()
    yield found
    found.kill()


def _as(broker: Mosquitto, folder: Path, name: str) -> aiomqtt.Client:
    own = Broker.of(broker.address, folder / "ca.pem", folder / f"{name}.pem", folder / f"{name}.key")
    return own.client(f"test-{name}")


async def test_a_station_is_heard_under_its_own_name_alone(broker: Mosquitto, tmp_path: Path) -> None:
    async with _as(broker, tmp_path, "collect") as centre, _as(broker, tmp_path, "station-1") as station:
        await centre.subscribe(everywhere("records"), qos=1)
        # The broker takes it and hands it to nobody.
        await station.publish(TWO.topic("records"), b"forged", qos=1)
        await station.publish(ONE.topic("records"), b"own", qos=1)
        message = await asyncio.wait_for(anext(aiter(centre.messages)), 10.0)
        assert (str(message.topic), message.payload) == (ONE.topic("records"), b"own")


async def test_a_station_can_say_to_nobody_what_is_stored_and_reads_of_no_other(
    broker: Mosquitto, tmp_path: Path
) -> None:
    async with _as(broker, tmp_path, "collect") as centre, _as(broker, tmp_path, "station-1") as station:
        await station.subscribe("reprobe/#", qos=1)
        await station.publish(ONE.topic("stored"), b"forged", qos=1)
        await centre.publish(TWO.topic("stored"), b"of another", qos=1)
        await centre.publish(ONE.topic("stored"), b"own", qos=1)
        message = await asyncio.wait_for(anext(aiter(station.messages)), 10.0)
        assert message.payload == b"own"


@pytest.mark.parametrize("name", ["stranger", None])
async def test_who_has_no_certificate_of_the_plant_is_not_let_in(
    broker: Mosquitto, tmp_path: Path, name: str | None
) -> None:
    own = (tmp_path / f"{name}.pem", tmp_path / f"{name}.key") if name else (None, None)
    with pytest.raises(aiomqtt.MqttError):
        async with Broker.of(broker.address, tmp_path / "ca.pem", *own).client("x"):
            pass


async def test_a_certificate_that_cannot_be_read_is_told_in_words(tmp_path: Path) -> None:
    (tmp_path / "ca.pem").write_text("no certificate")
    with pytest.raises(BadConnection) as refused:
        Broker.of("127.0.0.1", tmp_path / "ca.pem", None, None).client("x")
    assert refused.value.advice
