"""Boards of the campaign: folder, side, bare or with parts."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from sim_hw import __file__ as sim_file

OWN = Path(sim_file).parent / "demo_board"
SHARED = Path(__file__).parents[4] / "shared" / "boards"


@dataclass(frozen=True)
class BoardKind:
    """One board as it lies in the nest."""

    name: str
    folder: Path
    side: Literal["top", "bottom"] = "top"
    assembled: bool = False

    @property
    def here(self) -> bool:
        """Whether its files are on this computer."""
        return self.folder.is_dir()


KINDS = (
    BoardKind("demo", OWN),
    BoardKind("glasgow-top", SHARED / "glasgow-revC3"),
    BoardKind("glasgow-bottom", SHARED / "glasgow-revC3", "bottom"),
    BoardKind("demo-parts", OWN, assembled=True),
    BoardKind("cloud-dripper-parts", SHARED / "cloud-dripper", assembled=True),
)


def known(name: str) -> BoardKind:
    """Return a kind by its name; raise ValueError with those there are."""
    for kind in KINDS:
        if kind.name == name:
            return kind
    raise ValueError(f"unknown board {name!r}; known: {', '.join(kind.name for kind in KINDS)}")
