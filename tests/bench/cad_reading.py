"""Reading of a large board's CAD folder: CPU seconds and memory (`python -m tests.bench.cad_reading`).

The board is drawn here: 200 x 150 mm, six ball grids, some 1100 small parts on both sides, 2000 vias, 24,000 traces,
25,000 strokes of ink, 60 copper areas; 5,763 records in the netlist, which has another origin.
"""

from __future__ import annotations

import argparse
import math
import random
import resource
import tempfile
import time
from pathlib import Path

from daemon.tools.cad import read_cad
from tests.daemon.tools.cad.small_board import GerberStyle, Pad, SmallBoard, ToolFolder, netlist, strokes, write

RECORDS = 5763
WIDTH, HEIGHT = 200.0, 150.0
_NAMES = {
    "top copper": "b.GTL", "bottom copper": "b.GBL", "top mask": "b.GTS", "bottom mask": "b.GBS", "top silk": "b.GTO",
    "drill": "b.drl",
}  # fmt: skip


def large_board(seed: int = 1) -> SmallBoard:
    """Draw parts and vias."""
    draw = random.Random(seed)
    pads: list[Pad] = []
    for part in range(6):
        x0, y0 = 20.0 + 30.0 * part, 30.0 + (part % 2) * 60.0
        pads += [
            Pad(f"U{part}", f"{i}_{j}", f"NET{draw.randrange(900)}", x0 + 0.8 * i, y0 + 0.8 * j, 0.4)
            for i in range(16) for j in range(16)
        ]  # fmt: skip
    taken = {(round(p.x), round(p.y)) for p in pads}
    while len(pads) < 3800:
        x, y = draw.uniform(5.0, WIDTH - 5.0), draw.uniform(5.0, HEIGHT - 5.0)
        cells = {(round(x), round(y)), (round(x + 1.0), round(y))}
        if not cells & taken:
            taken |= cells
            side = draw.choice(("top", "bottom"))
            for pin, dx in (("1", 0.0), ("2", 1.0)):
                pads.append(Pad(f"R{len(pads)}", pin, f"NET{draw.randrange(900)}", x + dx, y, 0.6, 0.5, side=side))
    while len(pads) < RECORDS:
        x, y = draw.uniform(3.0, WIDTH - 3.0), draw.uniform(3.0, HEIGHT - 3.0)
        pads.append(Pad("", "", f"NET{draw.randrange(900)}", x, y, 0.5, 0.0, 0.25, open=False))
    corners = ((3.0, 3.0, 3.2), (197.0, 3.0, 3.2), (3.0, 147.0, 3.2), (197.0, 147.0, 3.2))
    return SmallBoard(tuple(pads), corners, (0.0, 0.0))


def _lines(draw: random.Random, count: int) -> str:
    places = [(draw.uniform(5.0, WIDTH - 8.0), draw.uniform(5.0, HEIGHT - 8.0)) for _ in range(count)]
    return "".join(
        f"X{round(x * 1e6)}Y{round(y * 1e6)}D02*\n"
        f"X{round((x + draw.uniform(-3, 3)) * 1e6)}Y{round((y + draw.uniform(-3, 3)) * 1e6)}D01*\n"
        for x, y in places
    )


def _areas(count: int) -> str:
    rim = [(50.0 + 10.0 * math.cos(a / 20.0), 50.0 + 10.0 * math.sin(a / 20.0)) for a in range(126)]
    one = "".join(f"X{round(x * 1e6)}Y{round(y * 1e6)}D0{1 if k else 2}*\n" for k, (x, y) in enumerate(rim))
    return f"G36*\n{one}G37*\n" * count


def write_large_board(folder: Path, seed: int = 1) -> Path:
    """Write the board's folder."""
    board, draw = large_board(seed), random.Random(seed)
    write(folder, ToolFolder(_NAMES, GerberStyle(x2="command", names=True)), board)
    for name, count, areas in (("b.GTL", 12_000, 30), ("b.GBL", 12_000, 30), ("b.GTO", 25_000, 0)):
        text = (folder / name).read_text().replace("%LPD*%\n", "%LPD*%\n%ADD77C,0.15*%\n", 1)
        (folder / name).write_text(text.replace("M02*\n", f"D77*\n{_lines(draw, count)}{_areas(areas)}M02*\n"))
    corners = [(0.0, 0.0), (WIDTH, 0.0), (WIDTH, HEIGHT), (0.0, HEIGHT), (0.0, 0.0)]
    (folder / "b.GKO").write_text(strokes(board, GerberStyle(), "Profile,NP", [corners]))
    (folder / "b.ipc").write_text(netlist(board, shift=(-33.0, 12.0)))
    return folder


def main() -> None:
    """Read the board, or a folder that is given, and print what it took."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", nargs="?", type=Path, help="a folder or zip of CAD; none: the large board drawn here")
    given = parser.parse_args().folder
    with tempfile.TemporaryDirectory() as place:
        path = given or write_large_board(Path(place))
        before = time.process_time()
        cad = read_cad(path)
        cpu_s = time.process_time() - before
    memory_mb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0
    shapes = sum(len(s) for s in cad.layers.values())
    what = f"{len(cad.pins)} pins, {shapes} shapes, {len(cad.drills)} drills"
    print(f"{what}: {cpu_s:.2f} s CPU, {memory_mb:.0f} MB at most")
    for note in cad.notes:
        print(f"- {note}")


if __name__ == "__main__":
    main()
