"""Profile position mode: the set-point handshake of controlword bits 4, 5, 6, 8 and statusword bits 10, 11, 12."""

from __future__ import annotations

from collections.abc import Callable, Iterator

from sim_hw.drive.stage import CYCLE_S, Due, Stage
from sim_hw.plant.motion import Ramps

_SET_POINT, _AT_ONCE, _RELATIVE, _HALT = 1 << 4, 1 << 5, 1 << 6, 1 << 8


class Positioning:
    """Take set-points and travel to them; one more may wait in the buffer."""

    def __init__(self, stage: Stage, started: Callable[[], None]) -> None:
        self._stage = stage
        self._started = started
        self.refused = False
        self.reset(reached=False)

    def reset(self, *, reached: bool) -> None:
        """Drop every order; what turns keeps turning until it is stopped."""
        self._due_s: float | None = None
        self._acknowledged = False
        self._buffer: float | None = None
        self._target: float | None = None
        self._reached = reached
        self._travelling = False
        self.refused = False

    def operate(self, word: int, rising: int) -> None:
        """Act on a new controlword in "operation enabled"."""
        stage = self._stage
        if rising & _SET_POINT and not self._acknowledged and self._due_s is None:
            self._due_s = stage.now_s + CYCLE_S
        elif not word & _SET_POINT and self._buffer is None:
            self._acknowledged = False
        if rising & _HALT and stage.moving():
            self._travelling = False
            stage.stop(0x6084)
        elif not word & _HALT and self._target is not None and not self._travelling and not self._reached:
            self._travel(self._target)

    def due(self) -> Iterator[Due]:
        """Yield what is going to happen by itself."""
        if self._due_s is not None:
            yield self._due_s, self._take
        if self._travelling:
            window_s = self._stage.objects.get(0x6068) / 1000.0
            yield max(self._stage.now_s, self._stage.motor.demand.end_s + window_s), self._arrived

    def status_bits(self) -> int:
        """Return statusword bits 10 and 12."""
        halted = bool(self._stage.controlword & _HALT)
        reached = not self._stage.moving() if halted else self._reached
        return self._acknowledged << 12 | reached << 10

    def _take(self) -> None:
        """Take 607Ah over, one cycle after the edge of bit 4; this also withdraws the last move's "reached"."""
        word = self._stage.controlword
        self._due_s = None
        self._acknowledged = bool(word & _SET_POINT)
        target = self._checked(self._wanted(word))
        if target is not None and self._travelling and not word & _AT_ONCE:
            self._buffer, self._acknowledged = target, True
            return
        self._reached = False
        if target is None:
            self._target = self._target if self._travelling else None
            return
        self._target = target
        if not word & _HALT:
            self._travel(target)

    def _wanted(self, word: int) -> float:
        """Return the position ordered by 607Ah; relative ones count from what 60F2h says."""
        stage = self._stage
        position = stage.position(0x607A)
        if not word & _RELATIVE:
            return position
        from_target = stage.objects.get(0x60F2) & 3 == 0 and self._target is not None
        return position + (self._target or 0.0 if from_target else stage.motor.position(stage.now_s))

    def _checked(self, target: float) -> float | None:
        """Hold a target against 607Dh (0/0 is no limit): None if refused."""
        low, high = self._stage.position(0x607D, 1), self._stage.position(0x607D, 2)
        self.refused = (low, high) != (0.0, 0.0) and not low <= target <= high
        if not self.refused:
            return target
        return None if self._stage.plant.knobs.outside_limits == "refuse" else min(max(target, low), high)

    def _travel(self, target: float) -> None:
        stage, speed = self._stage, self._stage.speed(0x6081)
        if speed <= 0.0:
            return
        self._travelling = True
        stage.motor.go(stage.now_s, target, Ramps(speed, stage.rate(0x6083), stage.rate(0x6084)))
        if stage.moving():
            self._started()

    def _arrived(self) -> None:
        self._travelling = False
        if self._buffer is None:
            # 6067h: reached is what is near enough; a rotor that fell behind is not there
            self._reached = abs(self._stage.lag()) <= self._stage.position(0x6067)
            return
        self._target, self._buffer = self._buffer, None
        self._acknowledged = bool(self._stage.controlword & _SET_POINT)
        self._travel(self._target)
