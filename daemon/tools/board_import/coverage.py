"""Net coverage of a board: which nets can be probed from which side."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from daemon.domain.board import Board


@dataclass(frozen=True)
class Coverage:
    """How many nets there are, and which have a point on each side; neither: net -> why."""

    nets: int
    top: frozenset[str]
    bottom: frozenset[str]
    neither: dict[str, str]

    @property
    def either(self) -> frozenset[str]:
        """Nets that have a point on one side or the other."""
        return self.top | self.bottom


def net_coverage(boards: Sequence[Board]) -> Coverage:
    """Count the nets of a board from the board files of its sides."""
    served: dict[str, frozenset[str]] = {"top": frozenset(), "bottom": frozenset()}
    reasons: dict[str, list[str]] = {}
    for board in boards:
        served[board.side] = frozenset(p.net for p in board.test_points() if p.net is not None)
        for net, why in board.unserved.items():
            reasons.setdefault(net, []).append(f"{board.side}: {why}")
    either = served["top"] | served["bottom"]
    neither = {net: "; ".join(whys) for net, whys in reasons.items() if net not in either}
    return Coverage(len(either) + len(neither), served["top"], served["bottom"], neither)
