"""Circumstances of a record: program, configuration, board, needle and calibrations in force when it was written."""

from __future__ import annotations

import hashlib
import json
from typing import Any

from daemon.config.current import CurrentSettings
from daemon.config.model import Config
from daemon.storage.calibration_store import Calibrations
from daemon.storage.record_stream import RecordStream


class CircumstancesWatch:
    """Have the stream's records carry what is in force; called at each transition, it writes what has changed."""

    def __init__(
        self, stream: RecordStream, program: str, settings: CurrentSettings, calibrations: Calibrations
    ) -> None:
        self._stream, self._program, self._settings, self._calibrations = stream, program, settings, calibrations
        self._hashed: tuple[Config, str] | None = None
        self._told: dict[str, Any] | None = None

    def refresh(self, _change: object = None) -> None:
        """Look at what is in force."""
        facts = self._facts()
        if facts != self._told:
            self._told = facts
            self._stream.set_circumstances(facts)

    def _facts(self) -> dict[str, Any]:
        board, calibrations = self._settings.board, self._calibrations
        return {
            "program": self._program,
            "configuration": self._configuration_hash(self._settings.config),
            "board": board.name,
            "board_side": board.side,
            "board_revision": board.revision,
            "needle": self._settings.config.station.needle,
            "tip": calibrations.fingerprint or None,
            "calibrated": calibrations.made_at(),
        }

    def _configuration_hash(self, config: Config) -> str:
        if self._hashed is None or self._hashed[0] is not config:
            text = json.dumps(config.model_dump(mode="json"), sort_keys=True)
            self._hashed = config, hashlib.sha256(text.encode()).hexdigest()[:16]
        return self._hashed[1]
