"""Shell completion: scripts for bash, zsh and fish, with every command and option in them.

They ask no program: a key that is pressed at the prompt must not wait for Python to start.
"""

from __future__ import annotations

import shlex
from collections.abc import Callable, Iterable, Iterator

from daemon.cli.command_tree import Command

HELP = "--help"
_BASH = """# bash completion of reprobe; made by `reprobe completion bash`.
_reprobe() {{
    local word=${{COMP_WORDS[COMP_CWORD]}} before=${{COMP_WORDS[COMP_CWORD-1]}} path= one
    for one in "${{COMP_WORDS[@]:1:COMP_CWORD-1}}"; do
        case "$path $one" in
{paths}
        esac
    done
    COMPREPLY=()
    case "$path $before" in
{values}
    esac
    local words
    case "$path" in
{words}
    esac
    if [[ $word == -* || $path == "" || -z ${{words##[!-]*}} ]]; then
        COMPREPLY=($(compgen -W "$words" -- "$word"))
    fi
    if [[ ${{#COMPREPLY[@]}} -eq 0 ]]; then
        compopt -o default 2>/dev/null
    fi
}}
complete -F _reprobe reprobe
"""


def bash(commands: Iterable[Command]) -> str:
    """Return the script for bash."""
    known = list(commands)
    paths = sorted({path for command in known for path in _prefixes(command.path)})
    return _BASH.format(
        paths="\n".join(_case(_joined(path), f'path="{_joined(path)}"') for path in paths),
        values="\n".join(_bash_values(known)),
        words="\n".join(_case(_joined(path), f'words="{" ".join(_words(known, path))}"') for path in ((), *paths)),
    )


def zsh(commands: Iterable[Command]) -> str:
    """Return the script for zsh, which can use the one for bash."""
    return f"#compdef reprobe\nautoload -U +X bashcompinit && bashcompinit\n{bash(commands)}"


def fish(commands: Iterable[Command]) -> str:
    """Return the script for fish."""
    known = list(commands)
    lines = ["# fish completion of reprobe; made by `reprobe completion fish`."]
    tops = sorted({command.path[0] for command in known})
    for top in tops:
        of_it = [command for command in known if command.path[0] == top]
        said = _first_line(of_it[0]) if len(of_it[0].path) == 1 else ", ".join(one.path[1] for one in of_it)
        lines.append(f"complete -c reprobe -n __fish_use_subcommand -f -a {top} -d {shlex.quote(said)}")
    for command in known:
        lines += _fish_command(command)
    return "\n".join(lines) + "\n"


SHELLS: dict[str, Callable[[Iterable[Command]], str]] = {"bash": bash, "zsh": zsh, "fish": fish}


def _fish_command(command: Command) -> Iterator[str]:
    seen = "; and ".join(f"__fish_seen_subcommand_from {word}" for word in command.path)
    where = f"complete -c reprobe -n {shlex.quote(seen)}"
    if len(command.path) > 1:
        above = f"__fish_seen_subcommand_from {command.path[0]}"
        told = shlex.quote(_first_line(command))
        yield f"complete -c reprobe -n {shlex.quote(above)} -f -a {command.path[1]} -d {told}"
    for parameter in command.parameters:
        for flag in parameter.flags:
            name = f"-l {flag[2:]}" if flag.startswith("--") else f"-s {flag[1:]}"
            value = (
                "" if parameter.is_switch else f" -x -a '{' '.join(parameter.choices)}'" if parameter.choices else " -r"
            )
            yield f"{where} {name}{value} -d {shlex.quote(parameter.help)}"


def _bash_values(known: Iterable[Command]) -> Iterator[str]:
    """Yield what follows an option: one of its choices, a file, or a word that only the person knows."""
    for command in known:
        for parameter in command.parameters:
            if parameter.is_switch:
                continue
            for flag in parameter.flags:
                if parameter.choices:
                    does = f'COMPREPLY=($(compgen -W "{" ".join(parameter.choices)}" -- "$word")); return'
                else:
                    does = "compopt -o default 2>/dev/null; return" if parameter.is_file else "return"
                yield _case(f"{_joined(command.path)} {flag}", does)


def _words(known: Iterable[Command], path: tuple[str, ...]) -> list[str]:
    """Return what may stand after a path: the commands below it, or its options."""
    below = sorted({command.path[len(path)] for command in known if command.path[: len(path)] == path != command.path})
    own = next((command for command in known if command.path == path), None)
    choices = [one for p in own.parameters if not p.flags for one in p.choices] if own is not None else []
    return [*below, *choices, *(own.flags if own is not None else ()), HELP]


def _prefixes(path: tuple[str, ...]) -> Iterator[tuple[str, ...]]:
    for length in range(1, len(path) + 1):
        yield path[:length]


def _joined(path: tuple[str, ...]) -> str:
    return "".join(f" {word}" for word in path)


def _case(pattern: str, does: str) -> str:
    return f"        {shlex.quote(pattern)}) {does};;"


def _first_line(command: Command) -> str:
    return command.help.partition("\n")[0]
