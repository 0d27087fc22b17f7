"""Usage errors of the command line in plain words, without those of the library that found them."""

from __future__ import annotations

import re
from typing import Any

import typer
from typer.core import TyperGroup

_INSTEAD = (
    (re.compile(r"Value error, "), ""),
    (re.compile(r"Input should be a valid number, unable to parse string as a number"), "a number is wanted"),
    (re.compile(r"Input should be a valid integer, .*"), "a whole number is wanted"),
    (re.compile(r"Input should be"), "it should be"),
)


class PlainGroup(TyperGroup):
    """The commands together; what is wrong with a parameter is said without names of a library's own."""

    def invoke(self, ctx: Any) -> Any:
        """Run the command that was named."""
        try:
            return super().invoke(ctx)
        except typer.BadParameter as exc:
            exc.message = in_plain_words(exc.message)
            raise


def in_plain_words(said: str) -> str:
    """Return a validator's message as a person would say it."""
    for pattern, plain in _INSTEAD:
        said = pattern.sub(plain, said)
    return said
