"""Dialogue of the guided set-up: questions with the answers of the last time, and a word before anything moves."""

from __future__ import annotations

import math
import sys
from collections.abc import Callable, Sequence
from typing import Any, Literal, TypeVar

from daemon.cli.formatting import as_commands
from daemon.cli.output import out
from daemon.tools.setup import Notes

T = TypeVar("T")
Choice = Literal["go", "skip", "quit"]


class Quit(Exception):
    """The person ends the set-up here; it can go on later."""


class StepFailed(Exception):
    """A step could not be done; `advice` says what to do before it is tried again."""

    def __init__(self, message: str, advice: str) -> None:
        super().__init__(message)
        self.advice = advice


class Back(Exception):
    """The person goes back, to the question before or, from the first one, to the step before."""


BACK = "<"
LONGEST_ANSWER = 500
"""Letters; no name, path or address is longer, and a line of the file may have a thousand."""


class Dialogue:
    """Ask and tell on a terminal, or by lines of a pipe."""

    def __init__(self, notes: Notes) -> None:
        self.notes = notes
        self._given: list[str] | None = None
        """Answers in the form under way; None: there is none, and nothing to go back in."""
        self._again: list[str] = []
        """Answers that are given once more, without being asked for or shown: the person saw them."""
        self._found: dict[str, Any] = {}
        """What a form under way has found out; who goes back in it need not wait for that twice."""
        self._can_leave = self._told_back = False

    def fill_in(self, form: Callable[[], None], *, back: bool = True) -> None:
        """Have a form's questions answered; who goes back by one is asked that one, and keeps the answers before it.

        The form begins again for that, so it may do nothing that must not be done twice. From the first question
        `Back` is raised, if `back`: there is a step before.
        """
        again: list[str] = []
        self._found, self._can_leave, self._told_back = {}, back, False
        while True:
            self._given, self._again = [], again
            try:
                form()
            except Back:
                if not self._given:
                    raise
                again = self._given[:-1]
            else:
                return
            finally:
                self._given, self._again = None, []

    def once(self, key: str, find_out: Callable[[], T]) -> T:
        """Return what is found out, in this form at most once for a key; what cannot be found is tried again."""
        if key not in self._found:
            self._found[key] = find_out()
        found: T = self._found[key]
        return found

    def say(self, text: str) -> None:
        """Print a text as it is; what was said before an answer that is given once more is not said twice."""
        if self._again:
            return
        out.print(text, markup=False, highlight=False, soft_wrap=True)

    def ask(
        self,
        key: str,
        question: str,
        default: str,
        check: Callable[[str], T],
        noted: Callable[[T], str] | None = None,
    ) -> T:
        """Ask until `check` takes the answer (else it raises ValueError); offer what was answered the last time.

        What is noted of it is what was typed, or what `noted` makes of the value.
        """
        offered = self.notes.answer(key) or default
        while True:
            said = self._answer(f"{question} [{offered}] > ") or offered
            try:
                value = check(_taken(said))
            except ValueError as exc:
                self._again.clear()
                self.say(f"  {exc}")
                continue
            said = said if noted is None else noted(value)
            self.notes.note_answer(key, said)
            self._keep(said)
            return value

    def choose(self, key: str, question: str, offered: Sequence[str], now: str = "") -> str:
        """Let one of a list be chosen by its number, or another be typed; offer `now`, or else the first.

        The device is noted by its name: the next time another may stand in its place in the list.
        """
        for number, one in enumerate(offered, 1):
            self.say(f"  {number}: {one}")
        if not offered:
            self.say("  (none was found here)")

        def chosen(said: str) -> str:
            if said.isdecimal() and 1 <= int(said) <= len(offered):
                return offered[int(said) - 1]
            if not said.strip():
                raise ValueError("name one; or plug it in, end with Ctrl-C, and go on here with the same command")
            return said.strip()

        return self.ask(key, question, now or (offered[0] if offered else ""), chosen, noted=str)

    def ready(self, what: str) -> None:
        """Say what moves next, and wait for Enter."""
        self.say(what)
        if self._line("Enter: move, q: end here > ").lower() == "q":
            raise Quit

    def yes(self, question: str, *, key: str | None = None, default: bool = True) -> bool:
        """Ask for yes or no; with a key, what was answered the last time is offered."""
        before = self.notes.answer(key) if key is not None else None
        offered = default if before is None else before == "y"
        while True:
            said = self._answer(f"{question} [{'Y/n' if offered else 'y/N'}] > ").lower()
            if said in ("", "y", "yes", "n", "no"):
                break
            self._again.clear()
            self.say("  answer y or n")
        answer = offered if not said else said[0] == "y"
        if key is not None:
            self.notes.note_answer(key, "y" if answer else "n")
        self._keep("y" if answer else "n")
        return answer

    def before(self, title: str, moves: str | None) -> Choice:
        """Say what a step is and what it moves, and ask where something moves."""
        self.say(f"\n== {title}")
        if moves is None:
            self.say("Nothing moves.")
            return "go"
        self.say(f"THIS MOVES: {moves}")
        self.say("Keep the emergency stop at hand; Ctrl-C stops the head.")
        return self._choice("Enter: go on, s: skip this step, q: end here", "go")

    def after_failure(self, failure: StepFailed, *, back: bool = False) -> Choice:
        """Tell why a step failed, and ask what now; `go` tries it again. If `back`, `Back` may be raised."""
        self.say(f"This did not work: {as_commands(str(failure))}")
        self.say(f"  -> {as_commands(failure.advice)}")
        before = f", {BACK}: the step before" if back else ""
        return self._choice(f"Enter: try again, s: skip this step, q: end here{before}", "go", back=back)

    def _choice(self, question: str, default: Choice, *, back: bool = False) -> Choice:
        answers: dict[str, Choice] = {"": default, "s": "skip", "q": "quit"}
        while (said := self._line(f"{question} > ").lower()) not in answers:
            if back and said == BACK:
                raise Back
            self.say("  press Enter, s or q")
        return answers[said]

    def _answer(self, question: str) -> str:
        """Return the next answer of a form; raise `Back` where the person goes back instead."""
        if self._again:
            return self._again.pop(0)
        can_go_back = self._given is not None and (self._can_leave or bool(self._given))
        if can_go_back and not self._told_back:
            self.say(f"({BACK} as an answer goes back to the question before.)")
            self._told_back = True
        while (said := self._line(question)) == BACK and self._given is not None:
            if can_go_back:
                raise Back
            self.say("  there is no question before this one")
        return said

    def _keep(self, said: str) -> None:
        if self._given is not None:
            self._given.append(said)

    def _line(self, question: str) -> str:
        out.print(question, markup=False, highlight=False, end="", soft_wrap=True)
        sys.stdout.flush()
        line = sys.stdin.readline()
        if not line:
            raise Quit
        return line.strip()


def _taken(said: str) -> str:
    """Return an answer that may be one; ValueError for what was pasted by mistake, or is no text."""
    if len(said) > LONGEST_ANSWER:
        raise ValueError(f"that has {len(said)} letters, and an answer at most {LONGEST_ANSWER}: type it again")
    if any(0xD800 <= ord(letter) < 0xE000 or letter == "\0" for letter in said):
        raise ValueError("that has bytes which are no text (UTF-8): type it again")
    return said


def number(low: float, high: float, unit: str) -> Callable[[str], float]:
    """Return a check for a number within limits."""

    def check(said: str) -> float:
        try:
            value = float(said)
        except ValueError:
            value = math.nan
        if not math.isfinite(value):
            raise ValueError(f"{said!r} is no number; write it alone, with a point, in {unit}")
        if not low <= value <= high:
            raise ValueError(f"{value:g} {unit} is not between {low:g} and {high:g}")
        return value

    return check


def whole(low: int, high: int, what: str) -> Callable[[str], int]:
    """Return a check for a whole number within limits; `what` it is, with its article."""

    def check(said: str) -> int:
        try:
            value = int(said)
        except ValueError:
            raise ValueError(f"{said!r} is not {what}: a whole number") from None
        if not low <= value <= high:
            raise ValueError(f"{value} is not {what}: those are {low} to {high}")
        return value

    return check


def text(said: str) -> str:
    """Take any text that is not empty."""
    if not said.strip():
        raise ValueError("this may not be empty")
    return said.strip()
