"""Words instead of a traceback for whatever a command did not foresee.

A file that cannot be read or written is told with its name; anything else is a defect, and is told as one, with what
helps to mend it. `REPROBE_TRACEBACK=1` shows the traceback.
"""

from __future__ import annotations

import functools
import inspect
import os
from collections.abc import Callable
from typing import Any

import typer
import zmq

from daemon.cli.output import USAGE, fail

SHOW = "REPROBE_TRACEBACK"
UNFORESEEN = "this was not foreseen"


def with_words(app: typer.Typer) -> None:
    """Let no command of an application end in a traceback."""
    for command in app.registered_commands:
        if command.callback is not None:
            command.callback = _guarded(command.callback)
    for group in app.registered_groups:
        if group.typer_instance is not None:
            with_words(group.typer_instance)


def _guarded(callback: Callable[..., Any]) -> Callable[..., Any]:
    @functools.wraps(callback)
    def command(*args: Any, **fields: Any) -> Any:
        try:
            return callback(*args, **fields)
        except BrokenPipeError:
            raise  # the reader went away: nobody is there to be told
        except OSError as exc:
            if os.environ.get(SHOW):
                raise
            fail(_of_file(exc), advice=_cure(exc), code=USAGE)
        except zmq.ZMQError as exc:
            fail(str(exc), advice="write tcp://127.0.0.1:5555 or ipc:///run/reprobe/control", code=USAGE)
        except Exception as exc:  # whatever it is: a library's own kind is no child of any other
            # What typer itself ends a command with is a RuntimeError, and no defect
            if isinstance(exc, typer.Exit | typer.Abort) or os.environ.get(SHOW):
                raise
            fail(
                f"{UNFORESEEN}: {type(exc).__name__}: {str(exc)[:200]}",
                advice=f"it is a defect: try again with {SHOW}=1 and hand on what it prints, with `reprobe bundle`",
            )

    command.__signature__ = inspect.signature(callback, eval_str=True)  # type: ignore[attr-defined]
    return command


def _of_file(exc: OSError) -> str:
    """Say which file; of a rename the second is the one that was asked for, the first a passing one of our own."""
    file = exc.filename2 or exc.filename
    return f"{file}: {exc.strerror or exc}" if file else f"{exc.strerror or exc}"


def _cure(exc: OSError) -> str:
    if isinstance(exc, IsADirectoryError):
        return "it is a folder, and a file is wanted: give the name of one"
    return "see that the path is right and may be read or written"
