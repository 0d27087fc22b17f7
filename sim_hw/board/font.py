"""Stroke font of our own for silkscreen: only the letters our board needs."""

from collections.abc import Iterator

Point = tuple[float, float]

_GLYPHS: dict[str, tuple[str, ...]] = {
    "0": ("0004242000", "0024"),
    "1": ("0314", "1410", "0020"),
    "2": ("0424221202001020",),
    "3": ("0424201000", "0222"),
    "4": ("04021222", "2420"),
    "5": ("24040222200000",),
    "6": ("240400202202",),
    "7": ("04242310",),
    "8": ("0004242000", "0222"),
    "9": ("220204242000",),
    "C": ("24040020",),
    "D": ("0004142321100000",),
    "E": ("24040020", "0212"),
    "F": ("000424", "0212"),
    "I": ("0424", "1410", "0020"),
    "J": ("2421100001",),
    "M": ("0004122420",),
    "O": ("0004242000",),
    "P": ("0004242202",),
    "R": ("0004242202", "1220"),
    "T": ("0424", "1410"),
    "U": ("04002024",),
}
"""Strokes on a grid 2 wide and 4 high, origin bottom left; one string per stroke, two digits a point."""

_WIDTH = 2
_HEIGHT = 4
_ADVANCE = 3


def strokes(text: str, at_mm: Point, height_mm: float) -> Iterator[list[Point]]:
    """Yield polylines in mm of `text`, its lower left corner at `at_mm`; other characters are blanks."""
    unit_mm = height_mm / _HEIGHT
    for place, letter in enumerate(text):
        left_mm = at_mm[0] + place * _ADVANCE * unit_mm
        for stroke in _GLYPHS.get(letter, ()):
            yield [
                (left_mm + int(stroke[i]) * unit_mm, at_mm[1] + int(stroke[i + 1]) * unit_mm)
                for i in range(0, len(stroke), 2)
            ]


def width_mm(text: str, height_mm: float) -> float:
    """Return how wide `text` gets, in mm."""
    return (len(text) * _ADVANCE - (_ADVANCE - _WIDTH)) * height_mm / _HEIGHT
