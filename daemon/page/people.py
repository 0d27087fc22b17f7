"""Users of the page: a file of names with their roles, secrets kept by scrypt."""

from __future__ import annotations

import hashlib
import hmac
import json
import re
import secrets
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Final

from daemon.domain.roles import ROLES, Role
from daemon.platform.atomic_file import replace_whole

NAME: Final = re.compile(r"[\w][\w .@'-]{0,47}")
PIN: Final = re.compile(r"[0-9]{6}")
SHORTEST: Final = 10
USERS_FILE: Final = "users.json"
COST: Final = {"n": 2**14, "r": 8, "p": 1, "dklen": 32}
"""Of scrypt: some 50 ms and 16 MB for each try."""


class UserTrouble(Exception):
    """A user or the file of users cannot be used; `advice` says what to do."""

    def __init__(self, message: str, advice: str) -> None:
        super().__init__(message)
        self.advice = advice


@dataclass(frozen=True)
class User:
    """One line of the file."""

    name: str
    role: Role
    salt: str
    digest: str
    pin: bool = False
    """The secret is a PIN of six digits, which counts at the machine only."""


class Users:
    """The file of users; read again when it has changed, so that who is removed is out at once."""

    def __init__(self, file: Path) -> None:
        self._file = file
        self._mark: tuple[int, int] | None = None
        self._users: dict[str, User] = {}

    def find(self, name: str) -> User | None:
        """Return a user by name; raise `UserTrouble` if the file cannot be read."""
        self._refresh()
        return self._users.get(name)

    def all(self) -> list[User]:
        """Return all users."""
        self._refresh()
        return list(self._users.values())

    def add(self, name: str, role: Role, secret: str) -> User:
        """Add a user, or give one another role and secret; raise `UserTrouble` if that cannot be."""
        if not NAME.fullmatch(name):
            raise UserTrouble(f"{name!r} is no name", "use letters, digits, space, and . @ ' - within, 48 at most")
        pin = bool(PIN.fullmatch(secret))
        if not pin and len(secret) < SHORTEST:
            raise UserTrouble(
                f"the secret has {len(secret)} letters", f"use {SHORTEST} or more, or a PIN of six digits"
            )
        salt = secrets.token_bytes(16)
        user = User(name, role, salt.hex(), _digest(secret, salt).hex(), pin)
        self._refresh()
        self._write({**self._users, name: user})
        return user

    def remove(self, name: str) -> None:
        """Remove a user; raise `UserTrouble` if there is none."""
        self._refresh()
        if name not in self._users:
            raise UserTrouble(f"there is no user {name!r}", "`reprobe page user list` shows who there is")
        self._write({other: user for other, user in self._users.items() if other != name})

    def _write(self, users: dict[str, User]) -> None:
        text = json.dumps([asdict(user) for user in users.values()], indent=1)

        def write(beside: Path) -> None:
            beside.chmod(0o600)
            beside.write_text(text, encoding="utf-8")

        try:
            replace_whole(self._file, write)
        except OSError as exc:
            raise UserTrouble(f"{self._file}: {exc.strerror}", "see that its folder may be written") from exc
        self._mark = None

    def _refresh(self) -> None:
        try:
            facts = self._file.stat()
        except FileNotFoundError:
            self._users, self._mark = {}, None
            return
        except OSError as exc:
            raise UserTrouble(f"{self._file}: {exc.strerror}", "let the page's user read it") from exc
        mark = (facts.st_mtime_ns, facts.st_ino)
        if mark == self._mark:
            return
        if facts.st_mode & 0o077:
            raise UserTrouble(f"{self._file} is open to others", f"chmod 600 {self._file}")
        self._users, self._mark = _read(self._file), mark


def _read(file: Path) -> dict[str, User]:
    try:
        users = [User(**line) for line in json.loads(file.read_text(encoding="utf-8"))]
        if any(user.role not in ROLES or not user.digest for user in users):
            raise ValueError
    except (OSError, ValueError, TypeError) as exc:
        raise UserTrouble(f"{file} is damaged", "remove it and add the users again") from exc
    return {user.name: user for user in users}


def right_secret(user: User | None, secret: str, *, here: bool) -> bool:
    """Tell whether a secret is a user's; as slow for nobody's name. `here`: it is typed at the machine itself."""
    known = user or User("", "observe", "00" * 16, "00" * 32)
    same = hmac.compare_digest(_digest(secret, bytes.fromhex(known.salt)), bytes.fromhex(known.digest))
    return same and user is not None and (here or not user.pin)


def _digest(secret: str, salt: bytes) -> bytes:
    return hashlib.scrypt(secret.encode(errors="replace"), salt=salt, **COST)
