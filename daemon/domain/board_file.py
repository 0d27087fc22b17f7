"""Bytes of a board file: JSON, packed with gzip or not, with or without a byte-order mark.

Every point and every layer stands on a line of its own, so that two files can be compared by eye.
"""

from __future__ import annotations

import codecs
import gzip
import json
import zlib
from collections.abc import Iterator
from typing import Any

MOST_BYTES = 200_000_000
"""A dense board takes 5 MB unpacked: more than this is no board."""
_GZIP = b"\x1f\x8b"


def unpacked(content: bytes) -> bytes:
    """Return the JSON of a board file; raise ValueError if it is packed and broken, or too large."""
    if content.startswith(_GZIP):
        unpack = zlib.decompressobj(wbits=zlib.MAX_WBITS | 16)
        try:
            content = unpack.decompress(content, MOST_BYTES)
        except zlib.error as exc:
            raise ValueError(f"it is packed, and broken: {exc}") from exc
        if not unpack.eof:
            whole = f"more than {MOST_BYTES} bytes" if unpack.unconsumed_tail else "its end is missing"
            raise ValueError(f"it is packed, and {whole}")
    return content.removeprefix(codecs.BOM_UTF8)


def file_bytes(facts: dict[str, Any], *, packed: bool) -> bytes:
    """Return the bytes of a board file that says `facts`; the same facts give the same bytes."""
    text = "{\n" + ",\n".join(f"{json.dumps(name)}: {value}" for name, value in _values(facts)) + "\n}\n"
    return gzip.compress(text.encode(), mtime=0) if packed else text.encode()


def _values(facts: dict[str, Any]) -> Iterator[tuple[str, str]]:
    for name, value in facts.items():
        if name == "points":
            yield name, "[\n" + ",\n".join(_compact(point) for point in value) + "\n]"
        elif name == "layers" and value is not None:
            yield name, "{\n" + ",\n".join(f"{json.dumps(side)}: {_layers(value[side])}" for side in value) + "\n}"
        else:
            yield name, _compact(value)


def _layers(side: dict[str, Any]) -> str:
    return "{\n" + ",\n".join(f"{json.dumps(name)}: {_compact(layer)}" for name, layer in side.items()) + "\n}"


def _compact(value: Any) -> str:
    return json.dumps(value, separators=(",", ":"))
