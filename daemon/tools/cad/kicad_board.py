"""KiCad board reader: pads and vias of a `.kicad_pcb` with their nets; nothing is drawn from it.

Source: the board file format's page of KiCad's developer documentation (versions 5 to 9). y runs down there.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from typing import Literal, TypeAlias

from daemon.tools.cad.model import Pin, Side
from daemon.tools.cad.pins import unescaped

_TOKEN = re.compile(r'[()]|"((?:[^"\\]|\\.)*)"|[^\s()"]+')
_WANTED = {"net", "footprint", "module", "via"}
Node: TypeAlias = "list[str | Node]"


def read_kicad_board(name: str, text: str) -> list[Pin]:
    """Return pads and vias in mm, y up; raise ValueError if the file names none."""
    nets: dict[str, str] = {}
    pins: list[Pin] = []
    for node in _top_nodes(text):
        match node[0]:
            case "net":
                nets[str(node[1])] = str(node[2]) if len(node) > 2 else ""
            case "via":
                pins.append(_via(node, nets))
            case _:
                pins += _footprint(node, nets)
    if not pins:
        raise ValueError(f"{name} has no pads; give a KiCad board, or export an IPC-D-356 netlist")
    return pins


def _top_nodes(text: str) -> Iterator[Node]:
    """Yield the wanted nodes right below the root, the others are not even built."""
    stack: list[Node] = []
    depth = 0
    fresh = False
    for found in _TOKEN.finditer(text):
        word = found[0]
        if word == "(":
            depth += 1
            fresh = depth == 2
            if stack:
                child: Node = []
                stack[-1].append(child)
                stack.append(child)
        elif word == ")":
            depth -= 1
            if stack:
                done = stack.pop()
                if not stack:
                    yield done
        elif stack:
            stack[-1].append(found[1].replace('\\"', '"') if found[1] is not None else word)
        elif fresh:
            fresh = False
            if word in _WANTED:
                stack.append([word])


def _children(node: Node, name: str) -> Iterator[Node]:
    for child in node:
        if isinstance(child, list) and child and child[0] == name:
            yield child


def _numbers(node: Node, name: str) -> list[float]:
    for child in _children(node, name):
        found = []
        for value in child[1:]:
            try:
                found.append(float(str(value)))
            except ValueError:
                continue
        return found
    return []


def _net(node: Node, nets: dict[str, str]) -> str:
    for child in _children(node, "net"):
        said = str(child[-1])
        return unescaped(nets.get(said, said) if len(child) == 2 else said)
    return ""


def _via(node: Node, nets: dict[str, str]) -> Pin:
    x, y = (*_numbers(node, "at"), 0.0, 0.0)[:2]
    size, drill = (*_numbers(node, "size"), 0.0)[0], (*_numbers(node, "drill"), 0.0)[0]
    return Pin(
        "", "", _net(node, nets), x, -y, is_via=True, hole_mm=drill or None, access=frozenset(("top", "bottom")),
        covered=frozenset(), width_mm=size or None, height_mm=0.0, feature="via",
    )  # fmt: skip


def _reference(node: Node) -> str:
    for child in _children(node, "property"):
        if child[1] == "Reference":
            return str(child[2])
    for child in _children(node, "fp_text"):
        if child[1] == "reference":
            return str(child[2])
    return ""


def _footprint(node: Node, nets: dict[str, str]) -> Iterator[Pin]:
    x0, y0, turn_deg = (*_numbers(node, "at"), 0.0, 0.0, 0.0)[:3]
    reference = _reference(node)
    c, s = math.cos(math.radians(turn_deg)), math.sin(math.radians(turn_deg))
    for pad in _children(node, "pad"):
        x, y = (*_numbers(pad, "at"), 0.0, 0.0)[:2]
        width, height = (*_numbers(pad, "size"), 0.0, 0.0)[:2]
        kind, shape = str(pad[2]), str(pad[3])
        number = str(pad[1])
        sides, opened = _sides(pad, "Cu"), _sides(pad, "Mask")
        if not sides or (kind == "np_thru_hole" and not number):
            continue
        drill = _numbers(pad, "drill")
        yield Pin(
            reference, number, _net(pad, nets), x0 + x * c + y * s, -(y0 - x * s + y * c), is_via=False,
            hole_mm=drill[0] if drill else None, access=sides, covered=sides - opened,
            width_mm=width or None, height_mm=0.0 if shape == "circle" else height,
            feature=_feature(pad),
        )  # fmt: skip


def _sides(pad: Node, kind: str) -> frozenset[Side]:
    names = {str(n) for child in _children(pad, "layers") for n in child[1:]}
    sides: list[Side] = []
    if names & {f"F.{kind}", f"*.{kind}", f"F&B.{kind}"}:
        sides.append("top")
    if names & {f"B.{kind}", f"*.{kind}", f"F&B.{kind}"}:
        sides.append("bottom")
    return frozenset(sides)


def _feature(pad: Node) -> Literal["pad", "test_point", "fiducial"]:
    properties = {str(child[1]) for child in _children(pad, "property") if len(child) > 1}
    if "pad_prop_testpoint" in properties:
        return "test_point"
    return "fiducial" if properties & {"pad_prop_fiducial_glob", "pad_prop_fiducial_loc"} else "pad"
