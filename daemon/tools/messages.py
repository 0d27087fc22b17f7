"""Page `messages.md`: every message of wire, command line, journal and drivers, read out of the program's source.

A message is what the code says where it raises: a text, or a text with places that are filled in, which the page shows
as <name>. Its cause and cure are those of its kind, and its own where it has some. So no message is left out, and none
stands there that is not said any more.
"""

from __future__ import annotations

import ast
import inspect
from collections import defaultdict
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from daemon.domain.errors import FaultCode
from daemon.maintenance.catalogue import all_specs
from daemon.station.device_errors import KINDS
from drivers import errors

ROOT = Path(__file__).parents[2]
INTRO = """# Messages

Made from the code by `reprobe schema --out doc`; do not edit. What a person reads when something is wrong, with what it
means and what to do next. `<name>` stands for what is filled in. In this page a word like `home` is an operation of the
wire; on the command line it is typed `reprobe home`.

Where a message has a number, that is its code on the wire (`error.code`), and the word beside it its name. The journal
keeps both with every job (`reprobe journal show JOB`).
"""
LONGEST = 400
_METERS = {"MeterError", "MeterTimeout"}


@dataclass(frozen=True, order=True)
class Said:
    """One message in the code; `kind` is the fault, the error's class or the command it belongs to."""

    kind: str
    text: str
    advice: str


def page() -> str:
    """Return the whole page."""
    jobs, devices, commands = _by_kind(faults()), _by_kind(_raised()), _by_kind(_failed())
    parts = [INTRO, "## What a job or a request ends with\n"]
    parts += [_fault(kind, jobs[kind.name], devices) for kind in FaultCode]
    parts += ["## Alerts of maintenance\n", "`reprobe health` shows them with their evidence.\n", _alerts()]
    parts += ["## What a command refuses\n", *(_command(name, said) for name, said in sorted(commands.items()))]
    return "\n".join(parts)


# --- what is said -------------------------------------------------------------------------------------------------


def faults() -> Iterator[Said]:
    """Yield what jobs and requests end with."""
    for call in _calls("daemon", "Fault"):
        if call.node.args and isinstance(call.node.args[0], ast.Attribute):
            yield from call.said(call.node.args[0].attr, 1)


def _raised() -> Iterator[Said]:
    yield from _of_meters()
    names = {name for name, one in vars(errors).items() if inspect.isclass(one) and issubclass(one, errors.DeviceError)}
    for name in sorted(names - _METERS):
        for folder in ("drivers", "daemon"):
            for call in _calls(folder, name):
                yield from call.said(name, 0)


def _of_meters() -> Iterator[Said]:
    """Yield what is said of instruments: the cure is that of the trouble each is raised with."""
    for name in sorted(_METERS):
        for call in _calls("drivers", name):
            trouble = call.node.args[1] if len(call.node.args) > 1 else None
            known = trouble.attr if isinstance(trouble, ast.Attribute) else ""
            cure = errors.MeterTrouble[known].value if known in errors.MeterTrouble.__members__ else ""
            for said in call.said(name, 0):
                yield Said(name, said.text, cure)


def _failed() -> Iterator[Said]:
    for call in _calls("daemon/cli", "fail"):
        yield from call.said(call.path.stem.replace("_", "-"), 0)


def _by_kind(all_said: Iterator[Said]) -> dict[str, list[Said]]:
    found: dict[str, set[Said]] = defaultdict(set)
    for said in all_said:
        if said.text:
            found[said.kind].add(said)
    return defaultdict(list, {kind: sorted(said) for kind, said in found.items()})


@dataclass(frozen=True)
class _Call:
    """One call, with the texts that the function around it gives to its names."""

    node: ast.Call
    path: Path
    named: dict[str, list[ast.expr]]

    def said(self, kind: str, index: int) -> Iterator[Said]:
        """Yield what it says: its argument at that place, with its own advice."""
        advice = next((one.value for one in self.node.keywords if one.arg == "advice"), None)
        cures = self._texts(advice) if advice is not None else []
        for text in self._texts(self.node.args[index]) if len(self.node.args) > index else []:
            yield Said(kind, text, cures[0] if len(cures) == 1 else "")

    def _texts(self, of: ast.expr) -> list[str]:
        if isinstance(of, ast.IfExp):
            return [*self._texts(of.body), *self._texts(of.orelse)]
        if isinstance(of, ast.Name):
            return [text for value in self.named.get(of.id, ()) for text in self._texts(value)]
        return [text] if (text := _words(of)) else []


def _calls(folder: str, name: str) -> Iterator[_Call]:
    """Yield every call of that name in a folder's modules."""
    for path in sorted((ROOT / folder).rglob("*.py")):
        source = path.read_text(encoding="utf-8")
        if f"{name}(" in source:
            yield from _calls_in(ast.parse(source), path, name)


def _calls_in(tree: ast.Module, path: Path, name: str) -> Iterator[_Call]:
    functions = (node for node in ast.walk(tree) if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef))
    for scope in (tree, *functions):
        named: dict[str, list[ast.expr]] = defaultdict(list)
        for node in ast.walk(scope):
            if isinstance(node, ast.Assign) and scope is not tree:
                for target in node.targets:
                    named[_name(target)].append(node.value)
        for node in ast.walk(scope):
            if isinstance(node, ast.Call) and _name(node.func) == name:
                yield _Call(node, path, named)


def _name(of: ast.expr) -> str:
    return of.id if isinstance(of, ast.Name) else of.attr if isinstance(of, ast.Attribute) else ""


def _words(of: ast.expr) -> str:
    """Return a text with its places named; empty for what is no text in the code."""
    match of:
        case ast.Constant(value=str() as text):
            return text
        case ast.JoinedStr(values=parts):
            return "".join(_words(part) for part in parts)
        case ast.FormattedValue(value=value):
            return f"<{_place(value)}>"
        case ast.BinOp(left=left, op=ast.Add(), right=right):
            return _words(left) + _words(right)
        case ast.Subscript(value=value):
            return _words(value)
        case ast.Call(func=ast.Name(id="escape"), args=[inner, *_]):
            return _words(inner)
        case _:
            return ""


def _place(of: ast.expr) -> str:
    """Return a name for what is filled in."""
    match of:
        case ast.Name(id=name) | ast.Attribute(attr=name):
            return name.strip("_")
        case ast.Subscript(slice=ast.Constant(value=str() as name)):
            return name
        case ast.Call(args=[first, *_]):
            return _place(first)
        case ast.Call(func=func):
            return _name(func)
        case ast.BinOp(left=left, right=right):
            return _place(left) if not isinstance(left, ast.Constant) else _place(right)
        case ast.UnaryOp(operand=inner) | ast.Subscript(value=inner):
            return _place(inner)
        case _:
            return "..."


# --- how it is written --------------------------------------------------------------------------------------------


def _fault(kind: FaultCode, said: list[Said], devices: dict[str, list[Said]]) -> str:
    lines = [
        f"### {kind.wire_name} ({kind.code})\n",
        f"**What happened:** {kind.value.cause}.  ",
        f"**What to do:** {kind.value.advice}.  ",
        f"**Ends:** {_end(kind)}.\n",
        *map(_line, said),
    ]
    for error in (raised for raised, code in KINDS if code is kind):
        for one in (error, *_only_below(error)):
            usual = "" if one.__name__ in _METERS else one.default_advice
            lines += [_line(each, usual) for each in devices[one.__name__]]
    return "\n".join(lines) + "\n"


def _only_below(error: type[errors.DeviceError]) -> Iterator[type[errors.DeviceError]]:
    """Yield the error's heirs that have no kind of their own."""
    own = {raised for raised, _ in KINDS}
    for heir in error.__subclasses__():
        if heir not in own:
            yield heir
            yield from _only_below(heir)


def _end(kind: FaultCode) -> str:
    if not kind.latched:
        return "by itself; the next job may begin at once"
    if kind.cured_by:
        return f"when {' or '.join(f'`{op}`' for op in sorted(kind.cured_by))} has come to its end"
    return "with `reset`, once its cause is gone"


def _line(said: Said, default: str = "") -> str:
    advice = said.advice or default
    return f"- {_shown(said.text)}{f' -> {_shown(advice)}' if advice else ''}"


def _alerts() -> str:
    rows = [f"| `{spec.name}` | {spec.what} | {_shown(spec.advice)} |" for spec in all_specs(["main"])]
    return "| alert | what is not what it was | what to do |\n|---|---|---|\n" + "\n".join(rows) + "\n"


def _command(name: str, said: list[Said]) -> str:
    return f"### {name}\n\n" + "\n".join(map(_line, said)) + "\n"


def _shown(text: str) -> str:
    return " ".join(text.split()).replace("<", "&lt;").replace("|", "\\|")[:LONGEST]
