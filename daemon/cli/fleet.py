"""`reprobe uplink` and `reprobe collect`: records of many stations, through a broker, into a database."""

from __future__ import annotations

import importlib.util
import json
import os
import sys
from pathlib import Path
from typing import Annotated, Any

import typer

from daemon.cli.output import DEFAULT_ENDPOINT, USAGE, fail

app = typer.Typer()
Broker = Annotated[
    str, typer.Option(envvar="REPROBE_BROKER", help="The MQTT broker, HOST or HOST:PORT; 8883 with --ca, else 1883.")
]
Ca = Annotated[
    Path | None, typer.Option(envvar="REPROBE_FLEET_CA", help="Certificate of who signed the broker's, PEM.")
]
Certificate = Annotated[Path | None, typer.Option(envvar="REPROBE_FLEET_CERTIFICATE", help="Own TLS certificate, PEM.")]
CertificateKey = Annotated[Path | None, typer.Option(envvar="REPROBE_FLEET_KEY", help="Its private key.")]
AsJson = Annotated[bool, typer.Option("--json", help="Log JSON lines.")]


@app.command()
def uplink(
    site: Annotated[str, typer.Option(envvar="REPROBE_SITE", help="Name of the plant.")],
    line: Annotated[str, typer.Option(envvar="REPROBE_LINE", help="Name of the line in it.")],
    broker: Broker = "127.0.0.1",
    station: Annotated[
        str, typer.Option(envvar="REPROBE_CONTROL", help="Control socket of the daemon.")
    ] = DEFAULT_ENDPOINT,
    keys: Annotated[
        Path | None,
        typer.Option(envvar="REPROBE_UPLINK_KEY", help="Own private key for the daemon; it need only observe."),
    ] = None,
    ca: Ca = None,
    certificate: Certificate = None,
    certificate_key: CertificateKey = None,
    as_json: AsJson = False,
) -> None:
    """Send this station's records to a broker until SIGTERM or Ctrl-C; nothing is ever commanded from there."""
    told = {"station": station, "keys": _text(keys), "site": site, "line": line}
    _become("uplink", told, broker, (ca, certificate, certificate_key), as_json=as_json)


@app.command()
def collect(
    database: Annotated[
        str, typer.Option(envvar="REPROBE_DATABASE", help="PostgreSQL, such as postgresql://reprobe@127.0.0.1/reprobe.")
    ],
    broker: Broker = "127.0.0.1",
    ca: Ca = None,
    certificate: Certificate = None,
    certificate_key: CertificateKey = None,
    recent_days: Annotated[int, typer.Option(min=1, max=366, help="Days for which every record is kept whole.")] = 7,
    record_months: Annotated[
        int | None, typer.Option(min=1, help="Months after which records are deleted; without it they are all kept.")
    ] = None,
    metrics_port: Annotated[int, typer.Option(min=0, max=65535, help="Prometheus port on loopback; 0: none.")] = 0,
    as_json: AsJson = False,
) -> None:
    """Store what all stations send, each record once, in a database; brings its schema up to date."""
    if not database.startswith(("postgresql://", "postgres://")):
        fail("the database is no PostgreSQL address", advice="write postgresql://USER@HOST/NAME", code=USAGE)
    # A password has no place among a process' arguments, which everybody may read.
    os.environ["REPROBE_DATABASE"] = database
    told = {"recent_days": recent_days, "record_months": record_months, "metrics_port": metrics_port}
    _become("collect", told, broker, (ca, certificate, certificate_key), as_json=as_json)


def _become(
    part: str, told: dict[str, Any], broker: str, tls: tuple[Path | None, Path | None, Path | None], *, as_json: bool
) -> None:
    """Be that process from now on: this command line alone is larger than all of it."""
    if any(importlib.util.find_spec(name) is None for name in ("aiomqtt", "asyncpg")):
        fail(f"{part} is not installed", advice="pip install 'reprobe[fleet]'", code=USAGE)
    ca, certificate, key = map(_text, tls)
    told |= {"part": part, "broker": broker, "ca": ca, "certificate": certificate, "certificate_key": key}
    arguments = json.dumps(told | {"as_json": as_json})
    os.execv(sys.executable, [sys.executable, "-m", "daemon.fleet", arguments])  # noqa: S606  # no shell is wanted


def _text(path: Path | None) -> str | None:
    return None if path is None else str(path)
