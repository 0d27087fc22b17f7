"""Roles of CAD files by their names: suffixes and words of the common tools.

Only names are looked at here; what a file says of itself (X2) goes first, see `roles`.
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from pathlib import PurePosixPath

# Suffix -> role. Protel and Altium, KiCad with Protel suffixes, EasyEDA, Fritzing; EAGLE; OrCAD; TARGET 3001!.
_SUFFIXES = {
    "gtl": "top copper", "gbl": "bottom copper", "gts": "top mask", "gbs": "bottom mask",
    "gto": "top silk", "gbo": "bottom silk", "gtp": "top paste", "gbp": "bottom paste",
    "gko": "outline", "gm1": "outline", "gml": "outline", "gm": "outline", "gm13": "ignored", "gdd": "ignored",
    "gd1": "ignored", "gg1": "ignored", "gpt": "ignored", "gpb": "ignored", "gdl": "ignored", "gta": "ignored",
    "gba": "ignored",
    "cmp": "top copper", "sol": "bottom copper", "sld": "bottom copper", "stc": "top mask", "sts": "bottom mask",
    "plc": "top silk", "pls": "bottom silk", "crc": "top paste", "crs": "bottom paste", "dim": "outline",
    "oln": "outline", "mil": "outline", "bor": "outline", "tsm": "top mask", "bsm": "bottom mask", "tsk": "top silk",
    "bsk": "bottom silk", "tsp": "top paste", "bsp": "bottom paste",
    "top": "top copper", "bot": "bottom copper", "smt": "top mask", "smb": "bottom mask", "sst": "top silk",
    "ssb": "bottom silk", "spt": "top paste", "spb": "bottom paste", "ast": "top fabrication",
    "asb": "bottom fabrication", "adt": "top fabrication", "adb": "bottom fabrication", "bottom": "bottom copper",
    "stoptop": "top mask", "stopbot": "bottom mask", "positop": "top silk", "posibot": "bottom silk",
    "pastetop": "top paste", "pastebot": "bottom paste", "outline": "outline",
    "tmk": "top mask", "bmk": "bottom mask", "smk": "top mask", "slk": "top silk", "pst": "top paste",
    "bst": "bottom paste", "tss": "top silk", "bss": "bottom silk", "pmt": "top paste", "pmb": "bottom paste",
}  # fmt: skip
WEAK_OUTLINES = ("gm", "gml", "gm1", "gko", "dim", "mil")
"""Suffixes that tools also use for other mechanical drawings; what the file draws decides."""
_INNER_SUFFIX = re.compile(r"(g\d+|gp\d+|g\d+l|in\d+|ly\d+|gl\d+|l\d+)$")
_MECHANICAL_SUFFIX = re.compile(r"gm\d+$")

_TOP = {"top", "front", "component", "comp", "compo", "cmp", "primary", "prim", "upper", "oben", "tl", "topside"}
_BOTTOM = {"bottom", "bot", "back", "secondary", "sec", "lower", "unten", "bl", "botside", "bottomside"}
_OUTLINE = (
    r"\b(board ?outline|outlines?|profile|edge ?cuts?|edges?|contours?|border|dimensions?|board ?shape|"
    r"board ?edge|milling|board ?geom(etry)?|mechanical ?1?|route|routing|umriss|keep ?out|rout)\b"
)
# Order counts: the first whose pattern is found in the words (joined by blanks) is the use.
_USES = (
    ("ignored", (r"\b(drill\w*|drl|comments?|cmts|dwgs|eco[12]|"
                 r"margin|adhes(ive)?|glue|v ?cut|document(s|ation)?|readme|keep ?in|peelable|3d|table|pads?( master)?|"
                 r"viaplug|tenting)\b")),
    ("courtyard", r"\b(court ?yard|crt ?yd|place ?bound)\b"),
    ("fabrication", r"\b(fab(rication)?|assembl?y|assy|component outlines?|adoc)\b"),
    ("paste", r"\b(solder ?paste|paste ?mask|paste|cream|stencil|metal ?mask|t ?cream|b ?cream|spaste)\b"),
    ("mask", (r"\b(solder ?mask|solder ?resist|solder ?stop|stop ?mask|mask|resist|stop|smask|sm|"
              r"lötstopp\w*|stopplack)\b")),
    ("silk", (r"\b(silk ?(screen|s|print)?|silkscreen|legend|overlay|symbol|posi|screen|nomenclature|idents?|"
                 r"component print|bestückung\w*)\b")),
    ("outline", _OUTLINE),
    ("copper", r"\b(copper|cu|layer|etch|conduct(or|ive)?|signal|sig|track|tracks|kupfer|elec|electrical)\b"),
)  # fmt: skip
_INNER = re.compile(r"\b(in(ner|t)?(ernal)?( ?(plane|layer|cu|copper|signal))? ?\d+|mid ?layer ?\d*|inner)\b")
_NUMBERED = re.compile(
    r"\b(?:l|ly|lay|lyr|layer|art|conduct(?:or|ive)|copper|cu|sig(?:nal)?|etch)(?: signal| plane)? ?0*(\d{1,2})\b"
)
_GLUED = re.compile(
    r"(?<![a-z])(top|bottom|bot|front|back|board|internal|solder|component|comp)"
    r"(?=layer|solder|silk|mask|paste|copper|cream|outline|overlay|stop|side|screen|assembly|plane|place|courtyard|fab)"
)
_SHORT = re.compile(r"\b(smt|smb|sst|ssb|spt|spb|tsm|bsm|tsk|bsk|tsp|bsp|tss|bss|pmt|pmb)\b")
# PADS: `sm0121` is the mask (21) of layer 1, of many layers `sm001021`; `sst0126`, `ssb0229`, `smd0123`. Short: `SM1`.
_PADS = re.compile(r"\b(sm|ss|sst|ssb|smd)(?:(?:\d{1,2}|\d{3}[01])(2[1-9])|([12]))\b")
_PADS_LAYERS = {
    "21": "top mask", "28": "bottom mask", "26": "top silk", "29": "bottom silk", "23": "top paste",
    "22": "bottom paste", "27": "top fabrication",
}  # fmt: skip
_USE_FIRST = re.compile(r"(?<![a-z])(mask|silk|paste|assy)(?=(top|bottom|bot)\b)")
_SIDE_LETTER = re.compile(r"(?<![a-z])([tb])(?=(solder|silk)(mask|screen|paste)\b)")
_SHORT_SIDED = re.compile(r"\b(sm|ss|sk|sp|pm|cu)(top|bottom|bot)\b")
_SHORT_USES = {"sm": "mask", "ss": "silk", "sk": "silk", "sp": "paste", "pm": "paste", "cu": "copper"}
_LETTERED = re.compile(r"\b(mask|silk|paste)([tb])\b")
_LETTER_FIRST = re.compile(r"\b([tb])(mask|silk|paste|sold(?:er)?)\b")
_KICAD = re.compile(r"\b([fb]) (?:cu|mask|silk ?s\w*|silk|paste|adhes\w*|court ?yard|crt ?yd|fab)$")
_UNPLATED = re.compile(r"\b(npth?|(non|un|not) ?-?plated|nonplated|unplated|nonmetal(l)?ized|npt)\b")
_PLATED = re.compile(r"\b(pth|plated|via|plt|metallized|throughplated)\b")


def words(name: str) -> list[str]:
    """Split a file's stem into small words: at signs, at capitals and before digits that end a word."""
    stem = PurePosixPath(name).name
    stem = re.sub(r"([a-zäöü])([A-Z])", r"\1 \2", stem)
    stem = re.sub(r"([A-Z]{2,}|\d)([A-Z][a-z])", r"\1 \2", stem)
    stem = _GLUED.sub(r"\1 ", stem.lower())
    return [w for w in re.split(r"[^a-z0-9äöüß]+", stem) if w]


def shared_words(names: Iterable[str]) -> int:
    """Count the words that all names begin with: the project's name, which may say `front` or `bottom` of its own."""
    lists = [words(PurePosixPath(n).stem) for n in names]
    if len(lists) < 3:
        return 0
    count = 0
    while all(len(w) > count + 1 for w in lists) and len({w[count] for w in lists}) == 1:
        count += 1
    return count


def role_by_name(name: str, skip_words: int = 0, *, letters: bool = True) -> str | None:
    """Return the role a Gerber's name tells, None where it tells none (then the person is asked).

    letters: a letter that stands alone may be a side; not in a project's name.
    """
    path = PurePosixPath(name)
    suffix = path.suffix.lower().lstrip(".")
    told = _by_words(" ".join(words(path.stem)[skip_words:]), letters=letters)
    by_suffix = _SUFFIXES.get(suffix)
    if by_suffix and suffix not in WEAK_OUTLINES:
        return by_suffix
    if by_suffix:
        return told if told and told.split()[-1] in ("outline", "courtyard", "fabrication", "ignored") else by_suffix
    if _MECHANICAL_SUFFIX.fullmatch(suffix):
        return told if told and told.split()[-1] in ("outline", "courtyard", "fabrication", "ignored") else "outline"
    return "inner copper" if _INNER_SUFFIX.fullmatch(suffix) else told


def _by_words(text: str, *, letters: bool = True) -> str | None:
    if found := _PADS.search(text):
        number_side = "top" if found[3] == "1" else "bottom"
        return _PADS_LAYERS.get(found[2] or "", f"{number_side} {'mask' if found[1] == 'sm' else 'silk'}")
    text = _USE_FIRST.sub(r"\1 ", text)
    text = _SIDE_LETTER.sub(lambda m: "top " if m[1] == "t" else "bottom ", text)
    text = _SHORT_SIDED.sub(lambda m: f"{_SHORT_USES[m[1]]} {m[2]}", text)
    text = _LETTERED.sub(lambda m: f"{m[1]} {'top' if m[2] == 't' else 'bottom'}", text)
    text = _LETTER_FIRST.sub(
        lambda m: f"{'mask' if m[2].startswith('sold') else m[2]} {'top' if m[1] == 't' else 'bottom'}", text
    )
    use = next((use for use, pattern in _USES if re.search(pattern, text)), None)
    if use in ("ignored", "outline"):
        return use
    side = _side(text, letters=letters and use is not None)
    if use == "fabrication" and side is None and re.search(_OUTLINE, text):
        return "outline"
    if use in (None, "copper") and (_INNER.search(text) or (side is None and _NUMBERED.search(text))):
        return "inner copper"
    if use is None and re.search(r"\bsolder\b", text):
        return "bottom copper" if re.search(r"\bsolder ?side\b", text) else f"{side} mask" if side else None
    if use is None and (short := _SHORT.search(text)):
        return _SUFFIXES[short[1]]
    if use is None and side is None:
        return "outline" if text.endswith("board") else None
    if side is None:
        return "bottom copper" if use == "copper" and "solder" in text else None
    return f"{side} {use or 'copper'}"


def _side(text: str, *, letters: bool) -> str | None:
    """Return the side named last; single letters count only where no whole word does, and a use is named."""
    found = None
    if kicad := _KICAD.search(text):  # surer than a board's name that says a side
        return "top" if kicad[1] == "f" else "bottom"
    for word in text.split():
        if word in _TOP:
            found = "top"
        elif word in _BOTTOM:
            found = "bottom"
    if found is None and "solder side" in text:
        found = "bottom"
    if found is None and letters:
        for word in text.split():
            found = "top" if word in ("f", "t") else "bottom" if word == "b" else found
    if found is None and letters and text.split()[-1:] == ["a"]:  # Zuken's sides are A and B
        found = "top"
    return found


def numbered_copper(names: Iterable[str]) -> dict[str, str]:
    """Return top and bottom among files that only number their copper: 1 is the top, the largest number the bottom."""
    numbers = {
        name: int(found[1]) for name in names if (found := _NUMBERED.search(" ".join(words(PurePosixPath(name).name))))
    }
    if len(set(numbers.values())) < 2 or len(set(numbers.values())) < len(numbers) or min(numbers.values()) != 1:
        return {}
    last = max(numbers.values())
    return {name: "top copper" if n == 1 else "bottom copper" for name, n in numbers.items() if n in (1, last)}


def outline_strength(name: str) -> int:
    """Return how surely a name means the edge: 0 surely, larger less; drawings and keep-outs are named so too."""
    path = PurePosixPath(name)
    text, suffix = " ".join(words(path.stem)), path.suffix.lower().lstrip(".")
    if re.search(r"\b(keep ?out|mechanical|route|routing|rout|milling)\b", text):
        return 3
    if re.search(r"\b(outlines?|profile|edge ?cuts?|edges?|contours?|border|umriss|board)\b", text):
        return 0
    if suffix in WEAK_OUTLINES:
        return 1 + (suffix in ("gm", "gml", "mil"))
    return 4 if _MECHANICAL_SUFFIX.fullmatch(suffix) else 1


def plating_by_name(name: str) -> bool | None:
    """Return whether a drill file's name says that its holes are plated."""
    text = " ".join(words(PurePosixPath(name).stem))
    if _UNPLATED.search(text) or PurePosixPath(name).suffix.lower() in (".npt", ".rou"):
        return False
    return True if _PLATED.search(text) else None
