"""Gerber reader: a layer's shapes in painting order, in mm, with what X2 attributes say of them.

Read from the specification (2024.05 and, for what old tools write, RS-274X revision I): flashes, draws, arcs of both
quadrant modes, regions, macros, block apertures, step and repeat, mirror, turn and scale. A file is refused where it
would be drawn wrongly, not where it is merely old.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass, field

import numpy as np

from daemon.tools.cad.apertures import Aperture, macro, standard
from daemon.tools.cad.geometry import Points, along_arc
from daemon.tools.cad.gerber_paint import GerberLayer, Painter, Path, Place
from daemon.tools.cad.gerber_words import FARTHEST_MM, INCH_MM, CannotDrawError, Numbers, commands, is_torn

__all__ = ["GerberLayer", "Path", "read_gerber"]

_WORD = re.compile(r"([GDMXYIJN])\s*([+-]?\d*\.?\d*)")
_PLAIN = re.compile(r"(?:G0?1)?(?:X(-?\d+))?(?:Y(-?\d+))?D0?([123])")
_APERTURE = re.compile(r"ADD(\d+)([A-Za-z_.$][\w.$-]*)(?:,(.*))?$")
_REPEAT = re.compile(r"([XYIJ])\s*([+-]?[\d.]+)")
_UNIT_CODE = re.compile(r"(?:^|[*\n])\s*(?:N\d+)?G7([01])(?=\*|G)")
_END = ("0", "00", "2", "02")


def read_gerber(text: str) -> GerberLayer:
    """Draw a Gerber file; raise ValueError saying in plain words what cannot be drawn."""
    reader, command = _Reader(), ""
    if "%MO" not in text and (unit := _UNIT_CODE.search(text)):  # holds for the apertures before it, too
        reader.numbers.unit_mm = INCH_MM if unit[1] == "0" else 1.0
    try:
        for extended, command in commands(text):
            if extended:
                reader.extended(command)
            elif reader.block(command):
                reader.painter.layer.ended = True
                break
        reader.painter.close_repeat()
    except CannotDrawError:
        raise
    except (ValueError, ArithmeticError, IndexError, KeyError, RecursionError) as exc:
        raise CannotDrawError(f"the command {command[:60]!r} cannot be drawn") from exc
    reader.painter.layer.torn = not reader.painter.layer.ended and is_torn(text)
    if not reader.numbers.known and reader.painter.layer.paths:
        raise CannotDrawError("it has no coordinate format (%FS...*%); export it as RS-274X or X2")
    return reader.painter.layer


def _words(command: str) -> list[tuple[str, str]]:
    """Split a data block; raise ValueError where something else stands beside a coordinate, which may be damaged."""
    if re.search("[XYIJ]", command) and _WORD.sub("", command).strip(" \t\r\n\0\x1a"):
        raise CannotDrawError(f"the command {command[:60]!r} cannot be drawn")
    return _WORD.findall(command)


@dataclass(slots=True)
class _Reader:
    """Coordinates, apertures and modes; what is painted goes to the painter."""

    painter: Painter = field(default_factory=Painter)
    numbers: Numbers = field(default_factory=Numbers)
    apertures: dict[int, Aperture] = field(default_factory=dict)
    macros: dict[str, str] = field(default_factory=dict)
    pen: int = 0
    at: Place = (0.0, 0.0)
    mode: int = 1
    single_quadrant: bool = False
    operation: int = 2
    contour: list[Points] | None = None

    # --- extended commands -------------------------------------------------------------------------------------

    def extended(self, command: str) -> None:
        """Carry out one command of a `%...%` pair."""
        kind = command[:2]
        if (setting := _SETTINGS.get(kind)) is not None:
            setting(self, command)
        elif kind in ("TF", "TA", "TO", "TD"):
            self.painter.attribute(command)
        elif kind in ("OF", "MI", "IR"):
            self.painter.say_image(command, self.unit_mm)
        elif command.startswith("IPNEG"):
            raise CannotDrawError("it is drawn as a negative (%IPNEG*%); export it as a positive")
        elif kind == "AS" and not command.startswith("ASAXBY"):
            raise CannotDrawError(f"its axes are exchanged (%{command}*%); export it again, as seen from the top")
        elif kind == "SF" and any(float(n) != 1.0 for n in re.findall(r"[AB]([\d.]+)", command)):
            raise CannotDrawError(f"it is scaled as a whole (%{command}*%); export it in its true size")

    @property
    def unit_mm(self) -> float:
        """The file's unit; inch where it does not say (RS-274X)."""
        return self.numbers.unit_mm or INCH_MM

    def take_format(self, command: str) -> None:
        """Take `FS`."""
        self.numbers.take_format(command)

    def take_unit(self, command: str) -> None:
        """Take `MO`."""
        self.numbers.unit_mm = 1.0 if command.startswith("MOMM") else INCH_MM

    def take_macro(self, command: str) -> None:
        """Take `AM`."""
        name, _, body = command[2:].partition("*")
        self.macros[name.strip()] = body

    def take_aperture(self, command: str) -> None:
        """Take `AD`."""
        found = _APERTURE.match(command)
        if not found:
            raise CannotDrawError(f"the aperture {command[:40]!r} cannot be read")
        numbers = [float(n) for n in re.split(r"[Xx]", found[3].strip())] if found[3] and found[3].strip() else []
        made: Aperture | None
        if (body := self.macros.get(found[2])) is not None:
            made = macro(body, numbers, self.unit_mm)
        else:
            plain = {1, 2} if found[2] == "P" else set()  # a regular polygon's corners and turn are no lengths
            made = standard(found[2], [n if k in plain else n * self.unit_mm for k, n in enumerate(numbers)])
        if made is None:
            raise CannotDrawError(f"it uses an aperture {found[2]} that it does not define")
        if any(np.abs(points).max(initial=0.0) > FARTHEST_MM for points, _ in made.polygons):
            raise CannotDrawError(f"the aperture {command[:40]!r} is larger than any board")
        self.apertures[int(found[1])] = Aperture(made.polygons, made.round_mm, self.painter.aperture_function)

    def take_polarity(self, command: str) -> None:
        """Take `LP`."""
        self.painter.dark = command[2:3] != "C"

    def take_transform(self, command: str) -> None:
        """Take `LM`, `LR` or `LS`."""
        if command.startswith("LM"):
            self.painter.mirror = command[2:]
        elif command.startswith("LR"):
            self.painter.turn_deg = float(command[2:] or 0.0)
        else:
            self.painter.scale = float(command[2:] or 1.0)

    def take_block(self, command: str) -> None:
        """Take `AB`."""
        if len(command) > 2:
            self.painter.open_block(int(command[3:]))
        elif (made := self.painter.close_block()) is not None:
            self.apertures[made[0]] = made[1]

    def take_repeat(self, command: str) -> None:
        """Take `SR`, in whatever order; a number that it leaves out is one repeat, or no step."""
        self.painter.close_repeat()
        said = dict(_REPEAT.findall(command[2:]))
        if _REPEAT.sub("", command[2:]).strip():
            raise CannotDrawError(f"the command {command[:60]!r} cannot be drawn")
        if said:
            step = (float(said.get("I", 0.0)) * self.unit_mm, float(said.get("J", 0.0)) * self.unit_mm)
            self.painter.open_repeat((int(said.get("X", 1)), int(said.get("Y", 1))), step)

    # --- data blocks -------------------------------------------------------------------------------------------

    def block(self, command: str) -> bool:
        """Carry out one data block; return whether the file ends here."""
        plain = _PLAIN.fullmatch(command)
        if plain and (self.mode == 1 or command[0] == "G"):  # nine in ten are of this kind
            self.mode = 1
            self._operate(int(plain[3]), plain[1], plain[2])
            return False
        words = dict[str, str]()
        for letter, digits in _words(command):
            if letter == "G":
                self._general(int(digits or 0))
            elif letter == "M":
                if digits in _END:
                    return True
            elif letter != "N":
                words[letter] = digits
        code = int(words.pop("D")) if words.get("D") else None
        if code is not None and code >= 10:
            self.pen, code = code, None
            if not words:
                return False
        if code is not None or words:
            x, y, i, j = (words.get(k) or None for k in "XYIJ")
            self._operate(self.operation if code is None else code, x, y, i, j)
        return False

    def _general(self, code: int) -> None:
        if code in (1, 2, 3):
            self.mode = code
        elif code == 36:
            self.contour = []
        elif code == 37:
            self._end_contour()
            self.contour = None
        elif code in (74, 75):
            self.single_quadrant = code == 74
        elif code in (70, 71):
            self.numbers.unit_mm = INCH_MM if code == 70 else 1.0
        elif code in (90, 91):
            self.numbers.incremental = code == 91

    def _operate(self, code: int, x: str | None, y: str | None, i: str | None = None, j: str | None = None) -> None:
        here = self.at
        there = self._target(x, y)
        self.operation, self.at = code, there
        if code == 2:
            self._end_contour()
        elif code == 3 and self.contour is None:
            self.painter.flash(self._aperture(), there)
        elif code == 1:
            centre = self._centre(here, there, i, j) if self.mode > 1 and (i or j) else None
            self._draw(here, there, centre)

    def _target(self, x: str | None, y: str | None) -> Place:
        length = self.numbers.length_mm
        if self.numbers.incremental:
            return self.at[0] + (length(x) if x else 0.0), self.at[1] + (length(y) if y else 0.0)
        return length(x) if x else self.at[0], length(y) if y else self.at[1]

    def _aperture(self) -> Aperture:
        found = self.apertures.get(self.pen)
        if found is None and not self.apertures:
            raise CannotDrawError("it has no apertures of its own (RS-274-D); export it as RS-274X or X2")
        if found is None:
            raise CannotDrawError(f"it uses an aperture D{self.pen} that it does not define")
        return found

    def _draw(self, here: Place, there: Place, centre: Place | None) -> None:
        clockwise = self.mode == 2
        if self.contour is not None:
            ends = np.array((here, there))
            self.contour.append(ends if centre is None else along_arc(here, there, centre, cw=clockwise))
        elif centre is None:
            self.painter.line(self._aperture(), here, there)
        else:
            self.painter.arc(self._aperture(), here, there, centre, cw=clockwise)

    def _centre(self, here: Place, there: Place, i: str | None, j: str | None) -> Place:
        """Return an arc's centre; in single-quadrant mode offsets have no sign, and the quarter that fits counts."""
        dx, dy = (self.numbers.length_mm(d) if d else 0.0 for d in (i, j))
        best, least = (here[0] + dx, here[1] + dy), math.inf
        if not self.single_quadrant:
            return best
        for centre in ((here[0] + sx * abs(dx), here[1] + sy * abs(dy)) for sx in (1, -1) for sy in (1, -1)):
            sweep = math.atan2(there[1] - centre[1], there[0] - centre[0])
            sweep -= math.atan2(here[1] - centre[1], here[0] - centre[0])
            sweep = (sweep if self.mode == 3 else -sweep) % (2.0 * math.pi)
            off = abs(math.dist(centre, here) - math.dist(centre, there))
            if sweep <= math.pi / 2.0 + 1e-3 and off < least:
                best, least = centre, off
        return best

    def _end_contour(self) -> None:
        if self.contour:
            first, *rest = self.contour
            points = np.concatenate([first, *(p[1:] for p in rest)])
            self.contour = []
            if len(points) > 3:
                self.painter.region(points)


_SETTINGS = {
    "FS": _Reader.take_format,
    "MO": _Reader.take_unit,
    "AM": _Reader.take_macro,
    "AD": _Reader.take_aperture,
    "LP": _Reader.take_polarity,
    "LM": _Reader.take_transform,
    "LR": _Reader.take_transform,
    "LS": _Reader.take_transform,
    "AB": _Reader.take_block,
    "SR": _Reader.take_repeat,
}
