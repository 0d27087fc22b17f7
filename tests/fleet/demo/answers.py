"""Questions of a fleet, put to the centre's engines, each answer held against what was planted.

The SQL reads the views that `reprobe collect` makes, as psql and dashboards do; the rest is Prometheus'.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Literal

from tests.fleet.demo.planted import (
    BAD_BOARD,
    BAD_POINT,
    BOARD,
    DRIFTS,
    OLDER,
    POINTS,
    SILENT,
    TESTED_AT,
    WORN,
    WORN_NEEDLE,
)
from tests.fleet.demo.station import ALERT

Rows = Sequence[Sequence[Any]]
Engine = Literal["PostgreSQL", "Prometheus"]


@dataclass(frozen=True)
class Question:
    """What is asked, how, and what the answer has to be."""

    words: str
    query: str
    say: Callable[[Rows], str]
    """The answer in words; of rows, the first of which leads."""
    right: Callable[[Rows], bool]
    engine: Engine = "PostgreSQL"

    def holds(self, rows: Rows) -> bool:
        """Whether an answer is what was planted; too few rows are none."""
        try:
            return self.right(rows)
        except IndexError:
            return False


def _apart(rows: Rows) -> bool:
    """Whether the first leads clearly: what drifts is no matter of chance."""
    return bool(rows[0][0] == DRIFTS and abs(rows[0][2]) > 3 * abs(rows[1][2]))


def _only(*expected: str) -> Callable[[Rows], bool]:
    return lambda rows: [row[0] for row in rows] == list(expected)


def _names(rows: Rows) -> str:
    return ", ".join(str(row[0]) for row in rows) or "none"


QUESTIONS: tuple[Question, ...] = (
    Question(
        "which station drifts, which stands apart from its sisters",
        # Over days: midnight may fall into the demonstration.
        "SELECT station, sum(looks * median_um) / sum(looks), sum(looks * apart_um) / sum(looks) AS apart,"
        " sum(looks * sisters_um) / sum(looks) FROM station_drift GROUP BY station"
        " ORDER BY abs(sum(looks * apart_um)) / sum(looks) DESC",
        lambda rows: f"{rows[0][0]}: first looks find {rows[0][1]:.0f} um, its sisters {rows[0][3]:.0f} um",
        _apart,
    ),
    Question(
        "which needle brings false opens, and what cures them",
        "SELECT needle, sum(false_opens)::float / sum(points) AS share, sum(by_reference)::int FROM false_opens"
        " GROUP BY needle ORDER BY share DESC",
        lambda rows: f"{rows[0][0]}: {rows[0][1]:.0%} of its points, {rows[0][2]} cured at the reference pad",
        lambda rows: rows[0][0] == WORN_NEEDLE and rows[0][1] > 2 * rows[1][1] and rows[0][2] > 0,
    ),
    Question(
        "worst pads of a board design, over all stations",
        "SELECT board, point, misses, tests, stations_missing FROM worst_pads ORDER BY miss_rate_at_least DESC",
        lambda rows: f"{rows[0][0]} {rows[0][1]}: {rows[0][2]} of {rows[0][3]} missed, at {rows[0][4]} stations",
        lambda rows: tuple(rows[0][:2]) == (BAD_BOARD, BAD_POINT) and rows[0][4] == 5,
    ),
    Question(
        "how long does a needle last, which is due",
        "SELECT needle, station, touches FROM needle_life ORDER BY touches DESC",
        lambda rows: f"{rows[0][0]} at {rows[0][1]}: {rows[0][2]} touches",
        lambda rows: tuple(rows[0][:2]) == (WORN_NEEDLE, WORN),
    ),
    Question(
        "which software where",
        "SELECT station, program FROM software WHERE program <> (SELECT mode() WITHIN GROUP (ORDER BY program)"
        " FROM software)",
        lambda rows: f"{_names(rows)} runs another one: {rows[0][1]}",
        _only(OLDER),
    ),
    Question(
        f"everything of board {BOARD}, in any line",
        "SELECT station, count(*) FILTER (WHERE kind = 'point') AS points, count(*) FROM board_history"  # noqa: S608  # our names
        f" WHERE board_id = '{BOARD}' GROUP BY station ORDER BY station",
        lambda rows: "; ".join(f"{row[2]} records at {row[0]}" for row in rows),
        lambda rows: [tuple(row[:2]) for row in rows] == [(name, len(POINTS)) for name in sorted(TESTED_AT)],
    ),
    Question(
        "who is silent now",
        "SELECT station FROM stations_now WHERE NOT online ORDER BY station",
        _names,
        _only(SILENT),
    ),
    Question(
        "who is alarmed now",
        "SELECT station, alerts FROM stations_now WHERE alerts <> '{}' ORDER BY station",
        lambda rows: "; ".join(f"{row[0]}: {', '.join(row[1])}" for row in rows) or "none",
        lambda rows: [(row[0], list(row[1])) for row in rows] == [(DRIFTS, [ALERT])],
    ),
    Question(
        f"is it the board, the needle or the station: {BAD_POINT} at another station of {BAD_BOARD}",
        f"SELECT suspect, station, misses, tests FROM who_is_to_blame WHERE point = '{BAD_POINT}'"  # noqa: S608  # our names
        f" AND board = '{BAD_BOARD}' AND station <> '{WORN}' ORDER BY station",
        lambda rows: f"the {rows[0][0]}, said at {len(rows)} stations",
        _only(*["board"] * 4),
    ),
    Question(
        f"the same: the point {WORN} misses most, but {BAD_POINT}",
        f"SELECT suspect, point, misses, tests FROM who_is_to_blame WHERE station = '{WORN}'"  # noqa: S608  # our names
        f" AND point <> '{BAD_POINT}' ORDER BY misses DESC LIMIT 1",
        lambda rows: f"{rows[0][1]}, {rows[0][2]} of {rows[0][3]}: the {rows[0][0]}",
        _only("needle or station"),
    ),
    Question(
        "what never arrived, or was refused",
        "SELECT station FROM lost_records UNION ALL SELECT topic FROM refused",
        _names,
        _only(),
    ),
    Question(
        "who does not answer Prometheus",
        'up{job="reprobe"} == 0',
        _names,
        _only(SILENT),
        "Prometheus",
    ),
    Question(
        "whose alerts stand",
        "reprobe_alert_active == 1",
        _names,
        _only(DRIFTS),
        "Prometheus",
    ),
)
"""What a fleet is asked."""
