"""Marks of points: what people said of a point of a board, that the needle must not touch it or may again, and why."""

from __future__ import annotations

from typing import Any

from daemon.domain.point_mark import PointMark
from daemon.storage.journal_work import Work

MARKS_TABLE = """
CREATE TABLE marks (
    n INTEGER PRIMARY KEY AUTOINCREMENT, at TEXT NOT NULL, board TEXT NOT NULL, side TEXT NOT NULL, point TEXT NOT NULL,
    mark TEXT NOT NULL CHECK (mark IN ('forbidden', 'approved')), reason TEXT NOT NULL, by TEXT NOT NULL
) STRICT;
CREATE INDEX marks_of_point ON marks(board, side, point, n);
"""
_COLUMNS = "point, mark, reason, by, at"


def _mark(row: tuple[Any, ...]) -> PointMark:
    point, mark, reason, by, at = row
    return PointMark(point=point, mark=mark, reason=reason, by=by, at=at)


class PointMarks:
    """Keep marks by board, side and point; the newest of a point counts, the older ones stay for who asks why."""

    def __init__(self, work: Work) -> None:
        self._work = work

    async def add(self, board: str, side: str, mark: PointMark) -> None:
        """Write a mark down."""
        row = (mark.at, board, side, mark.point, mark.mark, mark.reason, mark.by)
        sql = "INSERT INTO marks(at, board, side, point, mark, reason, by) VALUES (?,?,?,?,?,?,?)"
        await self._work(lambda db: db.execute(sql, row))

    async def of_point(self, board: str, side: str, point: str) -> PointMark | None:
        """Return what counts of a point; None where nobody said anything."""
        sql = f"SELECT {_COLUMNS} FROM marks WHERE board=? AND side=? AND point=? ORDER BY n DESC LIMIT 1"  # noqa: S608
        row = await self._work(lambda db: db.execute(sql, (board, side, point)).fetchone())
        return _mark(row) if row else None

    async def of_board(self, board: str, side: str) -> list[PointMark]:
        """Return what counts of each point of a board that has a mark, by its name."""
        sql = (
            f"SELECT {_COLUMNS} FROM marks WHERE n IN"  # noqa: S608
            " (SELECT max(n) FROM marks WHERE board=? AND side=? GROUP BY point) ORDER BY point"
        )
        rows = await self._work(lambda db: db.execute(sql, (board, side)).fetchall())
        return [_mark(row) for row in rows]
