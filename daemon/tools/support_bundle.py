"""Support bundle: all that somebody far away needs to understand a station, and nothing secret.

Nothing is copied because it lies there. The configuration is written from its model, which knows what is secret
and drops what it does not know; records, results and journal go through their readers; of pictures only what is a JPEG
goes in. Links are never followed. At last every part is searched for the secrets this station is known to have, and a
part that holds one is left out. `manifest.json` lists what is in and what was left out, with why.
"""

from __future__ import annotations

import hashlib
import io
import json
import platform
import shutil
import subprocess
import tarfile
from collections.abc import Iterator
from dataclasses import dataclass, field
from importlib.metadata import distributions
from itertools import islice
from pathlib import Path
from typing import Any
from urllib.request import urlopen

from pydantic import BaseModel, SecretBytes, SecretStr, ValidationError

from daemon.client import Client, NoAnswer, Refused, from_here
from daemon.config.model import Config, ConfigError, load_config
from daemon.domain.results import JobResult
from daemon.platform.atomic_file import replace_whole
from daemon.platform.clock import utc_now
from daemon.storage.calibration_records import read_record
from daemon.storage.journal_reader import JournalReader, NoJournal
from daemon.wire.curve_keys import SERVER_FILE, KeyTrouble, read_private

JOBS, LOG_LINES = 1000, 5000
ASK_WITHIN_S = 2.0
LOG_WITHIN_S = 20.0
JPEG = b"\xff\xd8\xff"
PRIVATE = 0o600
REMOVED = "(removed)"


@dataclass
class Bundle:
    """What goes in: name -> bytes; and what stays out, with why."""

    forbidden: list[bytes] = field(default_factory=list)
    parts: dict[str, bytes] = field(default_factory=dict)
    left_out: dict[str, str] = field(default_factory=dict)

    def add(self, name: str, content: bytes | str) -> None:
        """Put a part in, unless it holds a known secret."""
        data = content.encode() if isinstance(content, str) else content
        if any(secret in data for secret in self.forbidden):
            self.left_out[name] = "it holds a secret of this station"
        else:
            self.parts[name] = data

    def write(self, path: Path, station: str) -> None:
        """Write the archive with its manifest, readable by its owner alone, whole or not at all."""
        listed = {
            name: {"bytes": len(data), "sha256": hashlib.sha256(data).hexdigest()} for name, data in self.parts.items()
        }
        manifest = {"format": "reprobe-bundle-1", "made_at": utc_now(), "station": station, "parts": listed,
                    "left_out": self.left_out}  # fmt: skip
        parts = {"manifest.json": json.dumps(manifest, indent=1).encode(), **self.parts}
        replace_whole(path, lambda file: _pack(file, parts))


def _pack(file: Path, parts: dict[str, bytes]) -> None:
    file.chmod(PRIVATE)
    with tarfile.open(file, "w:gz") as archive:
        for name, data in parts.items():
            member = tarfile.TarInfo(f"reprobe-bundle/{name}")
            member.size, member.mode = len(data), PRIVATE
            archive.addfile(member, io.BytesIO(data))


def collect(config_file: Path, *, pictures_bytes: int, unit: str) -> tuple[Bundle, str]:
    """Collect everything that can be had; return it with the station's name. What cannot be had is said to be so."""
    bundle = Bundle()
    bundle.add("versions.json", json.dumps(_versions(), indent=1))
    try:
        config = load_config(config_file)
    except ConfigError as exc:
        # A bad file is not copied: what is in it that nobody knows may be anything.
        bundle.add("config-problems.json", json.dumps([where for where, _ in exc.problems]))
        bundle.left_out["config.json"] = "the configuration is bad: see config-problems.json for the places"
        return bundle, "(unknown)"
    bundle.forbidden += _secrets(config)
    bundle.add("config.json", json.dumps(without_secrets(config), indent=1))
    folder = config.station.data_dir
    _add_calibrations(bundle, folder / "calibration")
    _add_journal(bundle, folder, pictures_bytes)
    _add_live(bundle, config)
    _add_log(bundle, unit)
    return bundle, config.station.name


# --- configuration ------------------------------------------------------------------------------------------------


def without_secrets(model: BaseModel) -> dict[str, Any]:
    """Return a model as plain values; fields that the model calls secret are removed."""
    return {name: _shown(getattr(model, name), secret=_is_secret(model, name)) for name in type(model).model_fields}


def _is_secret(model: BaseModel, name: str) -> bool:
    """Tell whether the model marks a field: `Field(json_schema_extra={"secret": True})`."""
    extra = type(model).model_fields[name].json_schema_extra
    return isinstance(extra, dict) and bool(extra.get("secret"))


def _shown(value: Any, *, secret: bool = False) -> Any:
    if value is not None and (secret or isinstance(value, SecretStr | SecretBytes)):
        return REMOVED
    match value:
        case BaseModel():
            return without_secrets(value)
        case dict():
            return {str(key): _shown(entry) for key, entry in value.items()}
        case list() | tuple():
            return [_shown(entry) for entry in value]
        case Path():
            return str(value)
        case _:
            return value


def _secrets(config: BaseModel) -> list[bytes]:
    """Return what must be in no part: secret values of the configuration, and private keys in folders it names."""
    found: list[bytes] = []
    for name in type(config).model_fields:
        value = getattr(config, name)
        if isinstance(value, BaseModel):
            found += _secrets(value)
        elif isinstance(value, dict):
            found += [secret for entry in value.values() if isinstance(entry, BaseModel) for secret in _secrets(entry)]
        elif isinstance(value, SecretStr | SecretBytes):
            plain = value.get_secret_value()
            found.append(plain.encode() if isinstance(plain, str) else plain)
        elif _is_secret(config, name) and value is not None:
            found.append(str(value).encode())
        elif isinstance(value, Path):
            found += [secret for place in (value, value / "keys") for secret in _private_key(place / SERVER_FILE)]
    return [secret for secret in found if secret]


def _private_key(file: Path) -> list[bytes]:
    try:
        return [read_private(file, kept_by_system=True).secret.encode()] if file.is_file() else []
    except (KeyTrouble, OSError):
        return []


# --- what the station kept ------------------------------------------------------------------------------------


def _plain_file(path: Path) -> bool:
    return path.is_file() and not path.is_symlink()


def _add_calibrations(bundle: Bundle, folder: Path) -> None:
    for path in sorted(folder.glob("*.json")):
        name = f"calibration/{path.name}"
        try:
            if _plain_file(path):
                bundle.add(name, read_record(path).model_dump_json(indent=1))
            else:
                bundle.left_out[name] = "it is a link"
        except ValueError:  # its words may quote the file
            bundle.left_out[name] = "it is no calibration record"
        except OSError as exc:
            bundle.left_out[name] = _why(exc)


def _add_journal(bundle: Bundle, folder: Path, pictures_bytes: int) -> None:
    try:
        with JournalReader(folder / "journal.sqlite") as journal:
            rows = list(islice(journal.jobs(newest_first=True), JOBS))
            bundle.add("journal.jsonl", "".join(journal.line(row) + "\n" for row in reversed(rows)))
            bundle.add("alerts.jsonl", "".join(json.dumps(alert) + "\n" for alert in journal.alerts()))
    except NoJournal as exc:
        bundle.left_out["journal.jsonl"] = str(exc)
        return
    failed = (row.result["pictures"] for row in rows if row.result and row.error and row.result.get("pictures"))
    _add_pictures(bundle, folder / "pictures", failed, pictures_bytes)


def _add_pictures(bundle: Bundle, ring: Path, folders: Iterator[str], budget: int) -> None:
    """Add the pictures of the last failed jobs until the budget is used up."""
    for folder in map(Path, folders):
        # The journal names the folder; only one of this station's own ring is taken.
        if folder.parent.resolve() != ring.resolve() or folder.is_symlink() or not folder.is_dir():
            continue
        files = [path for path in sorted(folder.iterdir()) if path.suffix in (".jpg", ".json")]
        size = sum(path.lstat().st_size for path in files)
        if size > budget:
            bundle.left_out[f"pictures/{folder.name}"] = f"its {size / 1e6:.1f} MB are more than there is room for"
            continue
        budget -= size
        for path in files:
            _add_picture(bundle, path, f"pictures/{folder.name}/{path.name}")


def _add_picture(bundle: Bundle, path: Path, name: str) -> None:
    try:
        if not _plain_file(path):
            raise ValueError("it is a link")
        data = path.read_bytes()
        if path.suffix == ".json":
            bundle.add(name, JobResult.model_validate_json(data).model_dump_json(indent=1))
        elif data.startswith(JPEG):
            bundle.add(name, data)
        else:
            raise ValueError("it is no JPEG")
    except (ValueError, OSError) as exc:
        bundle.left_out[name] = _why(exc)


def _why(exc: Exception) -> str:
    """Return why a part is left out, without a word of what is in it."""
    if isinstance(exc, ValidationError):
        return "it is not what its name says"
    return f"it cannot be read: {exc.strerror}" if isinstance(exc, OSError) else str(exc)[:200]


# --- what runs ----------------------------------------------------------------------------------------------------


def _versions() -> dict[str, Any]:
    packages = sorted({(found.name, found.version) for found in distributions() if found.name})
    release = platform.freedesktop_os_release() if Path("/etc/os-release").exists() else {}
    return {"python": platform.python_version(), "system": platform.platform(), "machine": platform.machine(),
            "os": release.get("PRETTY_NAME"), "packages": dict(packages)}  # fmt: skip


def _add_live(bundle: Bundle, config: Config) -> None:
    """Ask the daemon, if it runs, for its snapshot and its metrics."""
    try:
        with Client(from_here(config.api.control), timeout_s=ASK_WITHIN_S) as client:
            bundle.add("snapshot.json", json.dumps(client.request("snapshot"), indent=1))
    except (NoAnswer, Refused, KeyTrouble) as exc:
        bundle.left_out["snapshot.json"] = str(exc)
    if not config.metrics.port:
        bundle.left_out["metrics.txt"] = "metrics are not served ([metrics] port)"
        return
    try:
        with urlopen(f"http://127.0.0.1:{config.metrics.port}/metrics", timeout=ASK_WITHIN_S) as answer:
            bundle.add("metrics.txt", answer.read())
    except OSError as exc:
        bundle.left_out["metrics.txt"] = f"nothing answers on port {config.metrics.port}: {exc}"


def _add_log(bundle: Bundle, unit: str) -> None:
    """Take the last lines of the unit's log, if systemd's journal is here and may be read."""
    tool = shutil.which("journalctl")
    if tool is None:
        bundle.left_out["log.txt"] = "there is no journalctl"
        return
    command = [tool, f"--unit={unit}", "--output=short-iso", f"--lines={LOG_LINES}", "--no-pager", "--quiet"]
    try:
        done = subprocess.run(command, capture_output=True, timeout=LOG_WITHIN_S, check=False)
    except (OSError, subprocess.TimeoutExpired) as exc:
        bundle.left_out["log.txt"] = f"journalctl: {exc}"
        return
    if done.returncode == 0 and done.stdout:
        bundle.add("log.txt", done.stdout)
    else:
        bundle.left_out["log.txt"] = f"systemd's journal has nothing of {unit}, or you may not read it"
