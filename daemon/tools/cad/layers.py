"""Layers of a board: Gerber files drawn by their roles, checked against each other's origin."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from typing import cast

from daemon.tools.cad.folder import CadFile, CadFolder
from daemon.tools.cad.foreign import INSTEAD, PACKED, is_packed
from daemon.tools.cad.geometry import area
from daemon.tools.cad.gerber import GerberLayer, read_gerber
from daemon.tools.cad.model import Shape, Side, Use
from daemon.tools.cad.names import outline_strength, role_by_name
from daemon.tools.cad.outline import MOST_PADS, board_edges, box_of, box_shape, closed_polygons
from daemon.tools.cad.places import Places, pad_places
from daemon.tools.cad.role_file import SIDED
from daemon.tools.cad.roles import Roles

Box = tuple[float, float, float, float]


@dataclass
class Layers:
    """What was drawn, and what was left out on the way.

    drawings: where an edge may be, if no file is the outline. broken: of copper and masks that were left out, why.
    """

    shapes: dict[tuple[Side, Use], tuple[Shape, ...]] = field(default_factory=dict)
    outlines: list[tuple[str, GerberLayer]] = field(default_factory=list)
    drawings: list[tuple[str, GerberLayer]] = field(default_factory=list)
    attributes: dict[str, dict[str, list[str]]] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)
    broken: dict[tuple[Side, Use], str] = field(default_factory=dict)

    def sides_of(self, span: tuple[int, int] | None) -> frozenset[Side]:
        """Return where a drill through these copper layers comes out, as far as the copper's X2 numbers tell."""
        functions = [a.get(".FileFunction", []) for a in self.attributes.values()]
        numbers = [
            int(n[1:]) for _, n, *_ in (f for f in functions if f[:1] == ["Copper"] and len(f) > 2) if n[1:].isdigit()
        ]
        if span is None or len(numbers) < 2:
            return frozenset(("top", "bottom"))
        sides: list[Side] = ["top"] if 1 in span else []
        return frozenset([*sides, "bottom"] if max(numbers) in span else sides)

    def copper(self) -> dict[Side, Sequence[Shape]]:
        """Return the copper by side."""
        return {side: self.shapes[side, "copper"] for side in ("top", "bottom") if (side, "copper") in self.shapes}

    def pads(self) -> dict[Side, Places]:
        """Return the places of each side's pads."""
        return {side: pad_places(shapes) for side, shapes in self.copper().items()}


def draw_layers(folder: CadFolder, roles: Roles) -> Layers:
    """Draw all layers with a role; a broken one that can be done without is left out and named."""
    found = Layers()
    for role in SIDED:
        side, use = cast("tuple[Side, Use]", tuple(role.split()))
        files = _only(folder, roles, role)
        drawn = [(f, layer) for f in files if (layer := _draw(found, roles, f))]
        if drawn:
            found.shapes[side, use] = tuple(s for _, layer in drawn for s in layer.shapes)
            if use == "mask":
                _openings_alone(found, side, files[0].name)
            found.attributes |= {f.name: layer.attributes for f, layer in drawn}
    _tell_empty(found, roles)
    edges = _files(folder, roles, "outline")
    for file in sorted(edges, key=lambda f: (_SURE.index(roles.told_by[f.name]), outline_strength(f.name))):
        if (layer := _draw(found, roles, file)) is not None:
            found.outlines.append((file.name, layer))
    if not found.outlines:
        found.drawings = list(_other_drawings(folder, roles))
    _require(found, folder, roles)
    return found


def _other_drawings(folder: CadFolder, roles: Roles) -> Iterator[tuple[str, GerberLayer]]:
    """Read the Gerbers that are no layer of metal: a drawing of the board may hold its edge."""
    for file in folder.files:
        use = roles.of.get(file.name, "ignored").split()[-1]
        if use not in ("ignored", "fabrication", "silk") or not (file.is_text and "%FS" in file.text[:40_000]):
            continue
        with suppress(ValueError):  # told elsewhere, where it matters
            yield file.name, read_gerber(file.text)


def _openings_alone(found: Layers, side: Side, name: str) -> None:
    """Turn a mask that is drawn as it lies (all of the board, its openings cleared) into its openings."""
    shapes = found.shapes[side, "mask"]
    box = box_of(s.points_mm for s in shapes) or _NOWHERE
    whole = 0.8 * (box[2] - box[0]) * (box[3] - box[1])
    grounds = [s for s in shapes if s.dark and abs(area(s.points_mm)) > whole]
    cleared = sum(not s.dark for s in shapes)
    if grounds and cleared > len(shapes) // 2:
        kept = [replace(s, dark=not s.dark) for s in shapes if not any(s is g for g in grounds)]
        found.shapes[side, "mask"] = tuple(kept)
        found.notes.append(f"{name} draws the mask itself: its cleared places were taken as the openings")


def _files(folder: CadFolder, roles: Roles, role: str) -> list[CadFile]:
    names = set(roles.files(role))
    return [f for f in folder.files if f.name in names]


_SURE = ("option", "roles file", "X2", "job file", "name")
"""Who says a role, the surest first."""
_SEVERAL = ("silk", "paste", "courtyard", "fabrication")
"""Uses of which a board may have several files that are drawn on top of each other."""


def _only(folder: CadFolder, roles: Roles, role: str) -> list[CadFile]:
    """Return the file of a role; several are asked about, unless they are the same file twice or known from better."""
    files = _files(folder, roles, role)
    for by in _SURE[:-1]:
        sure = [f for f in files if roles.told_by[f.name] == by]
        if sure:
            files = sure
            break
    files = list({f.sha256: f for f in reversed(files)}.values())[::-1]
    if len(files) > 1 and not role.endswith(_SEVERAL):
        names = ", ".join(f.name for f in files)
        raise ValueError(
            f"{folder.path} has {len(files)} files for {role}: {names}; "
            f"say which one counts: --layer {role.replace(' ', '_')}=FILE"
        )
    roles.unused |= set(roles.files(role)) - {f.name for f in files}
    return files


def _draw(found: Layers, roles: Roles, file: CadFile) -> GerberLayer | None:
    """Draw a file; one that cannot be drawn is left out and named, or refused if a person named it."""
    role = roles.of[file.name]
    needed = role.endswith(_METAL)
    try:
        layer = read_gerber(file.text)
        if layer.torn and needed and layer.shapes:
            raise ValueError("it is cut off in the middle of a command; copy or export it again")
    except ValueError as exc:
        told = f"{file.name} ({role}) cannot be read: {exc}"
        if roles.told_by[file.name] == "option":
            raise ValueError(told) from exc
        if needed:
            side, use = cast("tuple[Side, Use]", tuple(role.split()))
            found.broken[side, use] = told
        found.notes.append(f"{file.name} ({role}) was left out: {exc}")
        roles.unused.add(file.name)
        return None
    if not layer.ended and not layer.paths and not layer.shapes and roles.told_by[file.name] == "option":
        raise ValueError(f"{file.name} is no Gerber, and cannot be the {roles.of[file.name]}; give another file")
    if not layer.ended:
        found.notes.append(f"{file.name} ({roles.of[file.name]}) has no end (M02) and may be cut off: compare its size")
    if not layer.shapes and needed:
        found.notes.append(f"{file.name} ({roles.of[file.name]}) draws nothing")
    return layer


def _tell_empty(found: Layers, roles: Roles) -> None:
    """Say of copper or a mask that is missing which file would be it, and is empty."""
    for name in roles.empty:
        side, _, use = (role_by_name(name) or "").partition(" ")
        key = cast("tuple[Side, Use]", (side, use))
        if use in _METAL and key not in found.shapes:
            found.broken.setdefault(key, f"{name} ({side} {use}) is empty; export it again")


def _require(found: Layers, folder: CadFolder, roles: Roles) -> None:
    """Refuse a folder of which neither side has copper and mask."""
    missing = {
        side: [use for use in ("copper", "mask") if (side, use) not in found.shapes] for side in ("top", "bottom")
    }
    if not all(missing.values()):
        for side, uses in missing.items():
            if uses:
                found.notes.append(f"no {side} {' and no '.join(uses)}: nothing is known of the {side}'s bare metal")
        return
    for told in found.broken.values():
        raise ValueError(told)
    wanted = ", ".join(f"{side} {use}" for side, uses in missing.items() for use in uses)
    if not roles.unknown and roles.foreign and not found.shapes:
        (name, kind), *_ = roles.foreign.items()
        raise ValueError(f"{name} is {kind}, which is not read; {INSTEAD}")
    packed = [name for name in (*folder.left_out, *(f.name for f in folder.files)) if is_packed(name)]
    if packed and not roles.unknown and not found.shapes:
        raise ValueError(f"{packed[0]} is {PACKED}")
    unknown = f"; it is not known what {', '.join(roles.unknown[:8])} are" if roles.unknown else ""
    first = wanted.split(", ")[0].replace(" ", "_")
    raise ValueError(
        f"{folder.path} has no Gerber for {wanted}{unknown}; "
        f"export Gerber X2, or say which file it is: --layer {first}=FILE"
    )


# --- outline ---------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Outline:
    """The board's edge. file: where it was taken from, None where it was made up. note: to be told."""

    shapes: tuple[Shape, ...]
    box: Box
    file: str | None
    note: str | None = None


def find_outline(layers: Layers, pads: Places) -> Outline:
    """Find edge and cut-outs; raise ValueError where an outline was given that does not hold the pads."""
    for name, layer in layers.outlines:
        edges = board_edges(closed_polygons(layer.paths), pads)
        if edges:
            box = box_of(s.points_mm for s in edges) or _NOWHERE
            outside = 1.0 - _held(pads, box) if len(pads) else 0.0
            note = f"{outside:.0%} of the pads lie outside the edge that {name} draws" if outside > 0.005 else None
            return Outline(edges, box, name, note)
    wrong = None
    for name, layer in layers.outlines:
        drawn = box_of(p.points for p in layer.paths)
        if drawn is not None and len(pads):
            if _held(pads, drawn) >= MOST_PADS:
                return Outline(
                    (box_shape(drawn),), drawn, name, f"the outline in {name} is not closed: its box was taken"
                )
            wrong = wrong or _how_far(name, pads, drawn)
    if wrong is not None and any(outline_strength(name) == 0 for name, _ in layers.outlines):
        raise ValueError(wrong)
    box = box_of(s.points_mm for (_, use), shapes in layers.shapes.items() if use in _METAL for s in shapes) or _NOWHERE
    if (drawn_by := _drawn_elsewhere(layers, pads, box)) is not None:
        return drawn_by
    note = (
        "no outline file was found: the board's edge was taken from the extents of copper and mask; "
        "export the outline (Edge.Cuts, profile) or say --layer outline=FILE"
    )
    return Outline((box_shape(box),), box, None, note)


def _drawn_elsewhere(layers: Layers, pads: Places, metal: Box) -> Outline | None:
    """Return the narrowest edge round the pads in a drawing; a sheet's frame, far wider than the metal, is none."""
    found = []
    for name, layer in layers.drawings:
        edges = board_edges(closed_polygons(layer.paths), pads) if len(pads) else ()
        box = box_of(s.points_mm for s in edges)
        if box is not None and all(
            box[k + 2] - box[k] <= _WIDEST * (metal[k + 2] - metal[k]) + _RIM_MM for k in (0, 1)
        ):
            note = (
                f"no outline file was found: the board's edge is the one that {name} draws; "
                "export the outline (Edge.Cuts, profile) or say --layer outline=FILE"
            )
            found.append(Outline(edges, box, name, note))
    return min(found, key=lambda o: (o.box[2] - o.box[0]) * (o.box[3] - o.box[1]), default=None)


_WIDEST, _RIM_MM = 1.2, 10.0
"""A board is at most this much wider than its metal, and this much more for its rims."""
_NOWHERE: Box = (0.0, 0.0, 1.0, 1.0)
_METAL = ("copper", "mask")


def _held(pads: Places, box: Box) -> float:
    x0, y0, x1, y1 = box
    inside = (pads[:, 0] >= x0 - 0.1) & (pads[:, 0] <= x1 + 0.1) & (pads[:, 1] >= y0 - 0.1) & (pads[:, 1] <= y1 + 0.1)
    return float(inside.mean())


def _how_far(name: str, pads: Places, box: Box) -> str:
    middle = (pads.min(axis=0) + pads.max(axis=0)) / 2.0
    dx, dy = (box[0] + box[2]) / 2.0 - middle[0], (box[1] + box[3]) / 2.0 - middle[1]
    return (
        f"the outline {name} does not hold the copper's pads ({_held(pads, box):.0%} of them, its middle lies "
        f"{dx:.2f}, {dy:.2f} mm from theirs): export both with the same origin, or say --layer outline=FILE"
    )
