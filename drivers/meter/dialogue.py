"""Questions and answers over a stream, kept in step: an answer that comes late is never taken for another question's.

Whatever ends a question early (no answer, a cancel, an answer that fits nothing) leaves the two out of step: an answer
may still come. Then the instrument is asked who it is, and all that comes before it says so is thrown away; answers
come in the order of their questions, so nothing older can follow.
"""

from __future__ import annotations

import time

from drivers.deadline import Deadline
from drivers.errors import MeterError, MeterTimeout, MeterTrouble
from drivers.meter.answers import shown
from drivers.meter.contract import TERMINATORS, MeterSettings
from drivers.meter.identify import Identity, parse_identity
from drivers.meter.lines import Lines, Lost, Overlong
from drivers.meter.streams import Stream, open_stream

WHO = "*IDN?"
_MOST_LEFT_OVER = 20
"""Lines before an identity that are believed to be left over from before."""


class Dialogue:
    """One stream to an instrument. Its owner lets one call at a time in."""

    def __init__(self, settings: MeterSettings) -> None:
        self._settings = settings
        self._end = TERMINATORS[settings.terminator]
        self._lines = Lines(self._end)
        self._stream: Stream | None = None
        self._in_step = False
        self._asked_s: float | None = None
        self._late_s: float | None = None
        self._identity: str | None = None

    @property
    def open(self) -> bool:
        """Tell whether there is a stream, as far as is known."""
        return self._stream is not None and not self._lines.lost

    @property
    def in_step(self) -> bool:
        """Tell whether no answer is on its way, and none lies there."""
        return self._in_step and not self._lines.waiting

    async def connect(self, deadline: Deadline) -> None:
        """Open the stream anew."""
        self.hang_up()
        limit = deadline.within(self._settings.answer_s)
        self._stream = await open_stream(self._settings.address, self._settings.baudrate, self._lines, limit)

    def hang_up(self) -> None:
        """Close the stream; who still waits for an answer is told."""
        self._lines.end("it was closed")
        if self._stream is not None:
            self._stream.close()
        self._stream = None
        self._lines = Lines(self._end)
        self._in_step = False

    def lose_step(self) -> None:
        """Trust no answer any more until the instrument has said who it is."""
        self._in_step = False

    def tell(self, command: str) -> None:
        """Send what has no answer."""
        if self._stream is None:
            raise MeterError("is not connected", MeterTrouble.LOST)
        try:
            self._stream.write((command + self._end).encode("ascii"))
        except OSError as exc:
            self.hang_up()
            raise MeterError(f"takes no commands: {exc}", MeterTrouble.LOST) from exc

    async def ask(self, question: str, deadline: Deadline) -> str:
        """Ask and return the answer."""
        if deadline.expired:
            raise MeterTimeout(f"no time was left to ask {question}", MeterTrouble.SLOW)
        limit = deadline.within(self._settings.answer_s)
        self._in_step = False
        self.tell(question)
        self._asked_s = time.monotonic()
        while True:
            text = await self._answer(question, limit)
            # Who it is may have been asked twice to get in step: the second answer is left over.
            if question == WHO or text != self._identity:
                self._in_step = True
                return text

    async def ask_who(self, deadline: Deadline) -> Identity:
        """Ask a stream that was just opened who it is; what was on its way before us may come first."""
        limit = deadline.within(self._settings.answer_s)
        self.tell(WHO)
        first: str | None = None
        for _ in range(_MOST_LEFT_OVER):
            try:
                text = await self._answer(WHO, limit)
            except MeterTimeout:
                if first is None:
                    raise
                break
            if (identity := parse_identity(text)) is not None:
                self._identity = identity.text
                self._in_step = True
                return identity
            first = first or text
        raise MeterError(f"says {shown(first or '')} when asked who it is", MeterTrouble.GARBAGE)

    async def get_in_step(self, deadline: Deadline) -> None:
        """Throw away all answers that are still to come; if that cannot be, hang up."""
        late = len(self._lines.drop())
        limit = deadline.within(self._settings.answer_s)
        try:
            self.tell(WHO)
            # An answer that was cut short may stand before it in the same line.
            while not (text := await self._answer(WHO, limit)).endswith(self._identity or text):
                late += 1
                if late > _MOST_LEFT_OVER:
                    raise MeterError(f"answers what was not asked, such as {shown(text)}", MeterTrouble.GARBAGE)
        except MeterError:
            self.hang_up()
            raise
        if late and self._asked_s is not None:
            self._late_s = time.monotonic() - self._asked_s
        self._asked_s = None
        self._in_step = True

    async def _answer(self, question: str, limit: Deadline) -> str:
        waited_s = limit.remaining_s
        try:
            return await self._lines.next(limit)
        except TimeoutError as exc:
            raise self._no_answer(question, waited_s) from exc
        except Overlong as exc:
            text = f"answers {question} without an end: {shown(self._lines.begun)}"
            raise MeterError(text, MeterTrouble.GARBAGE) from exc
        except Lost as exc:
            raise MeterError(f"is gone: {exc}", MeterTrouble.LOST) from exc

    def _no_answer(self, question: str, waited_s: float) -> MeterTimeout:
        if self._lines.begun:
            text = f"began to answer {question} with {shown(self._lines.begun)}, and no end came in {waited_s:.1f} s"
            return MeterTimeout(text, MeterTrouble.UNFINISHED)
        if self._late_s is not None:
            text = f"no answer to {question} within {waited_s:.1f} s; the last late one took up to {self._late_s:.1f} s"
            return MeterTimeout(text, MeterTrouble.SLOW)
        return MeterTimeout(f"no answer to {question} within {waited_s:.1f} s", MeterTrouble.SILENT)
