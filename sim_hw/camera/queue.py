"""Camera buffers, filled the way V4L2 fills them: oldest first, and nothing is filled while none is free.

Time is an argument (simulated seconds) and must not go back. A frame needs a free buffer when it has been read
out; otherwise it is dropped, its sequence number with it. So who paused gets the OLD frames first.
"""

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass

from sim_hw.camera.controls import Taken
from sim_hw.scene.optics import Head

_READOUT_S = 0.012
_LONG_PAUSE_FRAMES = 100


@dataclass(frozen=True)
class Captured:
    """A filled buffer: when and how it was exposed and what was true meanwhile, not its pixels."""

    sequence: int
    start_s: float
    taken: Taken
    states: tuple[Head, ...]


@dataclass(frozen=True)
class _Coming:
    sequence: int
    start_s: float
    taken: Taken

    @property
    def ready_s(self) -> float:
        return self.start_s + self.taken.exposure_s + _READOUT_S


class FrameQueue:
    """A stream from its STREAMON at `start_s`.

    `expose(t_s)` says how a frame that begins at a time is taken; `watch(start_s, exposure_s)` what it sees;
    `period_s()` is the frame period.
    """

    def __init__(
        self,
        buffers: int,
        start_s: float,
        period_s: Callable[[], float],
        expose: Callable[[float], Taken],
        watch: Callable[[float, float], tuple[Head, ...]],
    ) -> None:
        self._free = buffers
        self._filled: deque[Captured] = deque()
        self.held: Captured | None = None
        self._period_s = period_s
        self._expose = expose
        self._watch = watch
        self._sequence = 0
        self._next_start_s = start_s
        self._coming: _Coming | None = None

    def advance(self, now_s: float) -> None:
        """Let the camera do what it did up to now."""
        self._skip_pause(now_s)
        while True:
            if self._coming is None:
                if self._next_start_s > now_s:
                    return
                taken = self._expose(self._next_start_s)
                self._coming = _Coming(self._sequence, self._next_start_s, taken)
                self._sequence += 1
                self._next_start_s += max(self._period_s(), taken.exposure_s)
            if self._coming.ready_s > now_s:
                return
            self._finish(self._coming)
            self._coming = None

    def dequeue(self, now_s: float) -> Captured | None:
        """Give the held buffer back and take the oldest filled one, if there is one."""
        self.advance(now_s)
        self.give_back()
        if self._filled:
            self.held = self._filled.popleft()
        return self.held

    def give_back(self) -> None:
        """Queue the held buffer again."""
        if self.held is not None:
            self.held = None
            self._free += 1

    def next_event_s(self) -> float:
        """Return when something may be ready that is not yet."""
        return self._next_start_s if self._coming is None else self._coming.ready_s

    def _finish(self, frame: _Coming) -> None:
        if self._free <= 0:
            return
        self._free -= 1
        states = self._watch(frame.start_s, frame.taken.exposure_s)
        self._filled.append(Captured(frame.sequence, frame.start_s, frame.taken, states))

    def _skip_pause(self, now_s: float) -> None:
        """Pass over a long time in which all frames were dropped."""
        period_s = self._period_s()
        behind = int((now_s - self._next_start_s) / period_s) - 8
        if self._free <= 0 and behind > _LONG_PAUSE_FRAMES:
            self._coming = None
            self._sequence += behind
            self._next_start_s += behind * period_s
