"""Prints, for each CAD folder: nets, nets with bare metal by the independent count, nets offered, time and size."""

from __future__ import annotations

import sys
import tempfile
import time
from pathlib import Path

from daemon.tools.board_import import import_boards, net_coverage
from tests.bench.coverage.count import count, is_net

BOARDS = Path(__file__).parents[4] / "shared" / "boards"


def main(arguments: list[str]) -> int:
    """Print the table; 1 if a board stays below nine nets in ten, 2 if there is none."""
    folders = [Path(a) for a in arguments] or sorted(p for p in BOARDS.glob("*") if any(p.glob("*-F_Cu.*")))
    if not folders:
        print(f"no boards: name CAD folders, or put some into {BOARDS}")
        return 2
    print(f"{'board':24}{'nets':>6}{'bare':>6}{'of them offered':>17}{'share':>8}{'offered':>9}{'cpu s':>7}{'MB':>6}")
    good = True
    for folder in folders:
        began = time.process_time()
        boards = import_boards(folder, "top")
        seconds = time.process_time() - began
        counted = count(folder)
        offered = net_coverage(list(boards.values())).either
        served = {net for net in counted.bare_nets if any(is_net(net, whole) for whole in offered)}
        share = len(served) / max(len(counted.bare_nets), 1)
        good &= share >= 0.9
        with tempfile.NamedTemporaryFile(suffix=".json.gz") as file:
            boards["top"].save(Path(file.name))
            size = Path(file.name).stat().st_size / 1e6
        print(f"{folder.name:24}{len(counted.nets):6}{len(counted.bare_nets):6}{len(served):17}{share:8.1%}"
              f"{len(offered):9}{seconds:7.2f}{size:6.2f}")  # fmt: skip
    return 0 if good else 1


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
