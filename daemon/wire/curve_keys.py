"""Keys of the wire: one pair for the station, one for each client, and the list of clients that may come in.

A key folder (mode 0700) holds `server.key`, the station's pair, and `clients/`, one file a client with its name, its
role and its public key. What is handed to a client is its private file (mode 0600): its own pair and the station's
public key. All are small TOML files with Z85 text, so that any language can read them. Nothing secret of a client
stays on the station.
"""

from __future__ import annotations

import os
import re
import stat
import tomllib
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import zmq

from daemon.domain.roles import ROLES, Role
from daemon.platform.atomic_file import replace_whole
from daemon.platform.clock import utc_now
from daemon.platform.plain_file import as_text, read_small

SERVER_FILE, CLIENTS, REVOKED = "server.key", "clients", "revoked"
PRIVATE, FOLDER, PUBLIC = 0o600, 0o700, 0o644
ANY_OF_OTHERS, WRITE_OF_OTHERS = 0o077, 0o022
NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9._-]{0,63}")
KEY = re.compile(r"[0-9a-zA-Z.:+=^!/*?&<>()\[\]{}@%$#-]{40}")


class KeyTrouble(Exception):
    """A key or its folder cannot be used; `advice` says what to do."""

    def __init__(self, message: str, advice: str) -> None:
        super().__init__(message)
        self.advice = advice


@dataclass(frozen=True)
class PrivateKey:
    """A key pair; a client's also knows the station's public key. Never logged, never sent."""

    name: str
    public: str
    secret: str
    server: str | None = None

    def __repr__(self) -> str:
        return f"PrivateKey({self.name!r})"


@dataclass(frozen=True)
class ClientKey:
    """One line of the allow-list."""

    name: str
    role: Role
    public: str
    made_at: str


# --- reading --------------------------------------------------------------------------------------------------


def read_private(path: Path, *, kept_by_system: bool = False) -> PrivateKey:
    """Read a private key; raise `KeyTrouble` if it is damaged or anybody else could read it.

    `kept_by_system`: the service manager put it where it is and answers for its mode.
    """
    if not kept_by_system:
        require_mode(path, ANY_OF_OTHERS)
    raw = _read(path)
    server = raw.get("server")
    return PrivateKey(
        _text(raw, "name", path), _key(raw, "public", path), _key(raw, "secret", path),
        None if server is None else _key(raw, "server", path),
    )  # fmt: skip


def read_client(path: Path, *, kept_by_system: bool = False) -> ClientKey:
    """Read one file of the allow-list; raise `KeyTrouble` if it is damaged or anybody else could change it."""
    if not kept_by_system:
        require_mode(path, WRITE_OF_OTHERS)
    raw = _read(path)
    given = raw.get("role")
    role = next((known for known in ROLES if known == given), None)
    if role is None:
        raise KeyTrouble(f"{path}: role {given!r} is none of {', '.join(ROLES)}", "make the key anew")
    return ClientKey(_text(raw, "name", path), role, _key(raw, "public", path), _text(raw, "made_at", path))


def require_mode(path: Path, forbidden: int) -> None:
    """Raise `KeyTrouble` if a file or folder belongs to somebody else or has any of the forbidden mode bits."""
    try:
        facts = path.stat()
    except OSError as exc:
        advice = "make it by `reprobe keys new`" if isinstance(exc, FileNotFoundError) else f"chown {_me()} {path}"
        raise KeyTrouble(f"{path}: {exc.strerror}", advice) from exc
    if facts.st_uid not in (0, os.geteuid()):
        raise KeyTrouble(f"{path} belongs to user {facts.st_uid}", f"chown {_me()} {path}")
    if facts.st_mode & forbidden:
        mode = stat.S_IMODE(facts.st_mode)
        raise KeyTrouble(f"{path} is open to others (mode {mode:04o})", f"chmod {mode & ~forbidden:04o} {path}")


# --- making and taking back -----------------------------------------------------------------------------------


def new_server(folder: Path) -> PrivateKey:
    """Return the station's key pair; make it, and the folder, if there is none."""
    for part in (folder, folder / CLIENTS):
        part.mkdir(mode=FOLDER, parents=True, exist_ok=True)
    require_mode(folder, ANY_OF_OTHERS)
    path = folder / SERVER_FILE
    if not path.exists():
        public, secret = _pair()
        _write(path, PRIVATE, "Private key of the station: nobody else may read it.", name="server", public=public,
               secret=secret)  # fmt: skip
    return read_private(path)


def new_client(folder: Path, name: str, role: Role, private: Path) -> ClientKey:
    """Make a client's pair: put it on the allow-list and write its private file to `private`; raise `KeyTrouble`."""
    if not NAME.fullmatch(name):
        raise KeyTrouble(f"{name!r} is no name for a key", "use letters, digits, dot, dash and underscore, up to 64")
    server = new_server(folder)
    entry = folder / CLIENTS / f"{name}.toml"
    if entry.exists():
        raise KeyTrouble(f"there is a key of the name {name}", f"choose another name, or `reprobe keys revoke {name}`")
    if private.exists():
        raise KeyTrouble(f"{private} exists already", "choose another file with --out")
    public, secret = _pair()
    _write(private, PRIVATE, f"Private key of client {name}: keep it to yourself.", name=name, role=role,
           public=public, secret=secret, server=server.public)  # fmt: skip
    _write(entry, PUBLIC, "A client that may come in.", name=name, role=role, public=public, made_at=utc_now())
    return read_client(entry)


def revoke(folder: Path, name: str) -> ClientKey:
    """Take a client off the allow-list; it is kept beside, so that the list still tells of it."""
    entry = folder / CLIENTS / f"{name}.toml"
    if not NAME.fullmatch(name) or not entry.exists():
        raise KeyTrouble(f"there is no key of the name {name!r}", "`reprobe keys list` shows the names")
    key = read_client(entry)
    (folder / REVOKED).mkdir(mode=FOLDER, exist_ok=True)
    entry.replace(folder / REVOKED / f"{name}-{key.public.encode().hex()[:8]}.toml")
    return key


def clients(folder: Path, which: str = CLIENTS) -> list[ClientKey]:
    """Return the clients that may come in, or with `REVOKED` those that may no more, by name."""
    return sorted((read_client(path) for path in (folder / which).glob("*.toml")), key=lambda key: key.name)


# --- small things ---------------------------------------------------------------------------------------------


def _pair() -> tuple[str, str]:
    public, secret = zmq.curve_keypair()
    return public.decode(), secret.decode()


def _write(path: Path, mode: int, head: str, **fields: str) -> None:
    """Write a small TOML file; Z85 and names have neither quotes nor backslashes."""
    text = f"# {head}\n" + "".join(f'{name} = "{value}"\n' for name, value in fields.items())

    def put(beside: Path) -> None:
        beside.write_text(text, encoding="utf-8")
        beside.chmod(mode)

    try:
        replace_whole(path, put)
    except OSError as exc:
        raise KeyTrouble(f"{path} cannot be written: {exc.strerror}", "choose a folder that is yours") from exc


def _read(path: Path) -> dict[str, Any]:
    try:
        return tomllib.loads(as_text(read_small(path)))
    except OSError as exc:
        raise KeyTrouble(f"{path}: {exc.strerror}", "give the file `reprobe keys new` wrote") from exc
    except (ValueError, RecursionError) as exc:
        raise KeyTrouble(f"{path} is no key file: {exc}", "make the key anew by `reprobe keys new`") from exc


def _text(raw: dict[str, Any], name: str, path: Path) -> str:
    value = raw.get(name)
    if not isinstance(value, str) or not value:
        raise KeyTrouble(f"{path} has no {name}", "make the key anew by `reprobe keys new`")
    return value


def _key(raw: dict[str, Any], name: str, path: Path) -> str:
    value = _text(raw, name, path)
    if not KEY.fullmatch(value):
        raise KeyTrouble(f"{path}: {name} is no key of 40 Z85 letters", "make the key anew by `reprobe keys new`")
    return value


def _me() -> str:
    return str(os.geteuid())
