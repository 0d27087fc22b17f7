"""Manual page `reprobe(1)`, in the language of man(7), with every command and option in it."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator

from daemon.cli.command_tree import Command, Parameter

_HEAD = """.\\" Made by `reprobe manual`.
.TH REPROBE 1 "" "reprobe {version}" "User Commands"
.SH NAME
reprobe \\- station daemon that makes a missed probe touch land
.SH SYNOPSIS
.B reprobe
.I COMMAND
[\\fIARGUMENT\\fR|\\fIOPTION\\fR]...
.SH DESCRIPTION
A robot touches test points on a board with a needle. When the tester reads an open circuit, the daemon looks through
the camera, finds the needle's tip and the pad, moves by the error, looks again and answers. The commands below start
it, ask it, calibrate it and look after it.
.PP
Every command has
.BR \\-\\-help .
.SH COMMANDS
"""
_TAIL = """.SH EXIT STATUS
.TP
0
What was asked for was done or found.
.TP
1
It was not; the error says why and what to do next.
.TP
2
It was asked for wrongly, or a file that was named cannot be used.
.SH ENVIRONMENT
.TP
.B REPROBE_CONTROL
Control socket of the daemon, instead of \\-\\-endpoint.
.TP
.B REPROBE_KEY
Private key of this client, instead of \\-\\-key.
.TP
.B REPROBE_CONFIG
The station's TOML file, instead of \\-\\-config.
.TP
.B REPROBE_TRACEBACK
Set to 1: a defect shows its traceback, for a report.
.SH FILES
.TP
.I /etc/reprobe/station.toml
Configuration of the station, of the instance NAME in
.IR /etc/reprobe/NAME/station.toml .
.TP
.I /var/lib/reprobe
Journal, calibrations and pictures.
.SH SEE ALSO
.BR systemctl (1),
.BR journalctl (1)
"""


def manual(commands: Iterable[Command], version: str) -> str:
    """Return the page."""
    return _HEAD.format(version=_plain(version)) + "".join(_command(one) for one in commands) + _TAIL


def _command(command: Command) -> str:
    lines = [f".SS {_plain('reprobe ' + ' '.join(command.path))}"]
    for paragraph in command.help.split("\n\n"):
        lines += [_text(paragraph), ".PP"]
    for parameter in command.parameters:
        lines += _parameter(parameter)
    return "\n".join(lines) + "\n"


def _parameter(parameter: Parameter) -> Iterator[str]:
    value = f"\\fI{_plain(parameter.value)}\\fR"
    yield ".TP"
    if not parameter.flags:
        yield value
    else:
        flags = ", ".join(f"\\fB{_plain(flag)}\\fR" for flag in parameter.flags)
        yield flags if parameter.is_switch else f"{flags} {value}"
    default = f" Default: {parameter.default}." if parameter.default else ""
    needed = " Required." if parameter.required and parameter.flags else ""
    yield _text(f"{parameter.help}{needed}{default}".strip() or "\\&")


def _text(text: str) -> str:
    """Return running text; `words` of the command line are set in bold."""
    plain = _plain(" ".join(text.split()))
    bold = re.sub(r"`([^`]+)`", r"\\fB\1\\fR", plain)
    return f"\\&{bold}" if bold[:1] in (".", "'") else bold


def _plain(text: str) -> str:
    return text.replace("\\", "\\e").replace("-", "\\-") if text != "\\&" else text
