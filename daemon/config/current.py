"""The configuration and the board in force: replaced whole by the reloader, read by everybody else."""

from __future__ import annotations

from daemon.config.model import Config
from daemon.config.reload import Change
from daemon.domain.board import Board


class CurrentSettings:
    """What is in force now. Ask each time: another configuration may be taken over between two jobs."""

    def __init__(self, config: Config, board: Board) -> None:
        self._config, self._board = config, board
        self._refused: tuple[str, ...] = ()

    @property
    def config(self) -> Config:
        """The configuration."""
        return self._config

    @property
    def board(self) -> Board:
        """The board it names."""
        return self._board

    @property
    def refused(self) -> tuple[str, ...]:
        """What is wrong with the file, which is not in force; empty when it is, or nobody asked for it."""
        return self._refused

    def note_reload(self, what: str, facts: dict[str, object]) -> None:
        """Take note of how a reload went: what was refused stands until a file is taken."""
        problems = facts.get("problems")
        if what == "refused" and isinstance(problems, list):
            self._refused = tuple(f"{where}: {said}" for where, said in problems)
        elif what == "taken":
            self._refused = ()

    def replace(self, change: Change) -> None:
        """Put another configuration in force, with its board."""
        self._config, self._board = change.config, change.board
