"""The configuration and the board in force: replaced whole by the reloader, read by everybody else."""

from __future__ import annotations

from daemon.config.model import Config
from daemon.config.reload import Change
from daemon.domain.board import Board


class CurrentSettings:
    """What is in force now. Ask each time: another configuration may be taken over between two jobs."""

    def __init__(self, config: Config, board: Board) -> None:
        self._config, self._board = config, board

    @property
    def config(self) -> Config:
        """The configuration."""
        return self._config

    @property
    def board(self) -> Board:
        """The board it names."""
        return self._board

    def replace(self, change: Change) -> None:
        """Put another configuration in force, with its board."""
        self._config, self._board = change.config, change.board
