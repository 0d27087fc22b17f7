"""Mutation operators: every small fault that can be put into a source text, each at exactly one place.

A comparison is moved by its boundary or turned round, a condition is fixed, a sign is swapped, `and` becomes `or`, a
`not` goes, a table loses an entry, a number in a function is off by one. Left alone is what decides nothing: texts
(f-strings included), annotations, and the values of module-level constants, which measurements judge and no test of
logic should repeat.
"""

from __future__ import annotations

import ast
import io
import tokenize
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from itertools import pairwise

COMPARISONS: dict[str, tuple[str, ...]] = {
    "<": ("<=", ">"),
    "<=": ("<", ">"),
    ">": (">=", "<"),
    ">=": (">", "<"),
    "==": ("!=",),
    "!=": ("==",),
    "is": ("is not",),
    "is not": ("is",),
    "in": ("not in",),
    "not in": ("in",),
}
SIGNS = {"+": "-", "-": "+", "+=": "-=", "-=": "+="}
LOGIC = {"and": "or", "or": "and"}
JOINED = (ast.JoinedStr, ast.List, ast.ListComp)
NO_CODE = frozenset({tokenize.NL, tokenize.NEWLINE, tokenize.COMMENT, tokenize.INDENT, tokenize.DEDENT})


@dataclass(frozen=True, slots=True)
class Mutant:
    """One place of a text and what stands there instead; start and end in characters, lines counted from 1."""

    operator: str
    line: int
    start: int
    end: int
    old: str
    new: str

    def apply(self, source: str) -> str:
        """Return the text with this one place changed."""
        return source[: self.start] + self.new + source[self.end :]


@dataclass(slots=True)
class Source:
    """A text, its syntax tree, and where its tokens are."""

    text: str
    tree: ast.Module = field(init=False)
    _lines: list[str] = field(init=False)
    _starts: list[int] = field(init=False)
    _tokens: list[tuple[int, int, str]] = field(init=False)

    def __post_init__(self) -> None:
        self.tree = ast.parse(self.text)
        self._lines = self.text.splitlines(keepends=True)
        self._starts = [0]
        for line in self._lines:
            self._starts.append(self._starts[-1] + len(line))
        self._tokens = [
            (self._starts[t.start[0] - 1] + t.start[1], self._starts[t.end[0] - 1] + t.end[1], t.string)
            for t in tokenize.generate_tokens(io.StringIO(self.text).readline)
            if t.type not in NO_CODE and t.type != tokenize.ENDMARKER
        ]

    def span(self, node: ast.expr) -> tuple[int, int]:
        """Return where an expression starts and ends."""
        assert node.end_lineno is not None
        assert node.end_col_offset is not None
        return self._offset(node.lineno, node.col_offset), self._offset(node.end_lineno, node.end_col_offset)

    def between(self, left: ast.expr, right: ast.expr) -> tuple[int, int, str]:
        """Return the operator between two operands: its start, end and words."""
        after, before = self.span(left)[1], self.span(right)[0]
        words = [t for t in self._tokens if after <= t[0] and t[1] <= before and t[2] not in "()"]
        return words[0][0], words[-1][1], " ".join(word for *_, word in words)

    def mutant(self, operator: str, start: int, end: int, new: str) -> Mutant:
        """Describe a change of this text."""
        return Mutant(operator, self.text.count("\n", 0, start) + 1, start, end, self.text[start:end], new)

    def _offset(self, line: int, column_bytes: int) -> int:
        return self._starts[line - 1] + len(self._lines[line - 1].encode()[:column_bytes].decode())


Found = Iterator[Mutant]


def comparisons(source: Source, node: ast.AST) -> Found:
    """Move a comparison's boundary, or turn it round."""
    if isinstance(node, ast.Compare):
        for left, right in pairwise([node.left, *node.comparators]):
            start, end, word = source.between(left, right)
            for new in COMPARISONS[word]:
                yield source.mutant("comparison", start, end, new)


def conditions(source: Source, node: ast.AST) -> Found:
    """Fix a condition: the guarded lines always run, or never; a filter lets all through."""
    if isinstance(node, ast.If | ast.IfExp):
        if ast.unparse(node.test) != "TYPE_CHECKING":
            for new in ("True", "False"):
                yield source.mutant("condition", *source.span(node.test), new)
    elif isinstance(node, ast.comprehension):
        for test in node.ifs:
            yield source.mutant("condition", *source.span(test), "True")


def signs(source: Source, node: ast.AST) -> Found:
    """Swap plus and minus."""
    if isinstance(node, ast.BinOp) and isinstance(node.op, ast.Add | ast.Sub) and not _joins(node):
        start, end, word = source.between(node.left, node.right)
        yield source.mutant("sign", start, end, SIGNS[word])
    elif isinstance(node, ast.AugAssign) and isinstance(node.op, ast.Add | ast.Sub) and not _joins(node):
        start, end, word = source.between(node.target, node.value)
        yield source.mutant("sign", start, end, SIGNS[word])
    elif isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.USub):
        start = source.span(node)[0]
        yield source.mutant("sign", start, start + 1, "+")


def logic(source: Source, node: ast.AST) -> Found:
    """Exchange `and` and `or`; let a `not` go."""
    if isinstance(node, ast.BoolOp):
        for left, right in pairwise(node.values):
            start, end, word = source.between(left, right)
            yield source.mutant("logic", start, end, LOGIC[word])
    elif isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.Not):
        yield source.mutant("logic", source.span(node)[0], source.span(node.operand)[0], _opening(source, node))


def entries(source: Source, node: ast.AST) -> Found:
    """Take one entry out of a table of two or more."""
    if isinstance(node, ast.Dict | ast.Set):
        firsts = [key for key in node.keys if key is not None] if isinstance(node, ast.Dict) else node.elts
        lasts = node.values if isinstance(node, ast.Dict) else node.elts
        if len(firsts) == len(lasts):  # nothing is unpacked into it
            starts, ends = [source.span(n)[0] for n in firsts], [source.span(n)[1] for n in lasts]
            spans = [*pairwise(starts), *[*pairwise(ends)][-1:]]
            found = [source.mutant("entry", start, end, "") for start, end in spans]
            yield from (m for m in found if _parses(m.apply(source.text)))  # not where a bracket of its own is left


def numbers(source: Source, node: ast.AST) -> Found:
    """Put a number off by one."""
    if isinstance(node, ast.Constant) and isinstance(node.value, int | float) and not isinstance(node.value, bool):
        yield source.mutant("number", *source.span(node), repr(node.value + 1))


OPERATORS: tuple[Callable[[Source, ast.AST], Found], ...] = (comparisons, conditions, signs, logic, entries, numbers)


def mutants(text: str) -> list[Mutant]:
    """List every mutant of a source text, in the order of its lines; each is a program that differs from the text."""
    source = Source(text)
    found = [m for node in _deciding(source.tree) for operator in OPERATORS for m in operator(source, node)]
    return sorted((m for m in found if m.old != m.new), key=lambda m: (m.start, m.end, m.new))


def _deciding(node: ast.AST, *, inside: bool = False) -> Iterator[ast.AST]:
    """Walk a tree but for texts, annotations and the numbers of module-level or class-level constants."""
    yield node
    for name, value in ast.iter_fields(node):
        if name in ("annotation", "returns"):
            continue
        for child in value if isinstance(value, list) else [value]:
            if not isinstance(child, ast.AST) or isinstance(child, ast.JoinedStr):
                continue
            if isinstance(child, ast.Constant) and not inside:
                continue
            yield from _deciding(child, inside=inside or isinstance(child, ast.FunctionDef | ast.AsyncFunctionDef))


def _joins(node: ast.BinOp | ast.AugAssign) -> bool:
    """Tell whether a plus joins texts or lists: turning it round is a type error that any call shows."""
    sides = (node.left, node.right) if isinstance(node, ast.BinOp) else (node.value,)
    return any(isinstance(s, JOINED) or (isinstance(s, ast.Constant) and isinstance(s.value, str)) for s in sides)


def _opening(source: Source, node: ast.UnaryOp) -> str:
    """Return the brackets between a `not` and its operand: they are no part of the operand's node."""
    between = source.text[source.span(node)[0] : source.span(node.operand)[0]]
    return between.removeprefix("not").lstrip()


def _parses(text: str) -> bool:
    try:
        ast.parse(text)
    except SyntaxError:
        return False
    return True
