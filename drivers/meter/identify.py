"""Answer to *IDN?: maker, model, serial number, firmware (IEEE 488.2, 10.14). Pure."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Identity:
    """Who an instrument says it is; `text` is its answer as it came."""

    maker: str
    model: str
    serial: str
    firmware: str
    text: str

    def __str__(self) -> str:
        return f"{self.maker} {self.model}"


def parse_identity(text: str) -> Identity | None:
    """Return who answered, or None where this is no identity.

    Four fields parted by commas are the standard; some leave out the last or add more. A list of numbers is none.
    """
    fields = [field.strip().strip('"') for field in text.split(",")]
    if len(fields) < 3 or not text.isprintable():
        return None
    maker, model, serial = fields[:3]
    if not (any(letter.isalpha() for letter in maker) and model) or _is_number(maker):
        return None
    return Identity(maker, model, serial, ",".join(fields[3:]), text)


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True
