"""The mutation bench: every operator changes one place, seeds repeat, a caught fault and a survivor are told apart."""

from __future__ import annotations

import ast
import tempfile
from pathlib import Path

import pytest

from tests.bench.mutants import equivalents
from tests.bench.mutants.__main__ import ROOT
from tests.bench.mutants.core_files import CORE_FILES, CoreFile, chosen
from tests.bench.mutants.equivalents import EQUIVALENTS, Equivalent, is_equivalent
from tests.bench.mutants.operators import mutants
from tests.bench.mutants.report import share, table
from tests.bench.mutants.runner import NotSoundError, check
from tests.bench.mutants.sampling import sample

TINY = '''"""Doc 1."""
LIMIT = 5


def is_low(value: float, limit: float = LIMIT) -> bool:
    return value < limit


def clipped(value: float) -> float:
    if value > 10:
        return 10.0
    return value
'''
TINY_TEST = """import pytest
from daemon.tiny import clipped, is_low


@pytest.mark.parametrize(("value", "low"), [(4.0, True), (5.0, False), (6.0, False)])
def test_low(value, low):
    assert is_low(value) is low


def test_clipped():
    assert clipped(12.0) == 10.0
"""
CORE = CoreFile("daemon/tiny.py", ("tests/test_tiny.py",))


@pytest.mark.parametrize(
    ("line", "changed"),
    [
        ("x = a < b", {"x = a <= b", "x = a > b"}),
        ("x = (a) >= (b)", {"x = (a) > (b)", "x = (a) < (b)"}),
        ("x = a == b", {"x = a != b"}),
        ("x = a is not b", {"x = a is b"}),
        ("x = a not in b", {"x = a in b"}),
        ("x = a is b in c", {"x = a is not b in c", "x = a is b not in c"}),
        ("x = a + b", {"x = a - b"}),
        ("x = a - (-b)", {"x = a + (-b)", "x = a - (+b)"}),
        ("x -= b", {"x += b"}),
        ("x = a and b or c", {"x = a or b or c", "x = a and b and c"}),
        ("x = not a", {"x = a"}),
        ("x = not (a or b)", {"x = (a or b)", "x = not (a and b)"}),
        ("x = a if b else c", {"x = a if True else c", "x = a if False else c"}),
        ("x = [a for a in b if c]", {"x = [a for a in b if True]"}),
        ("if a: b()", {"if True: b()", "if False: b()"}),
        ("x = {a, b, c}", {"x = {b, c}", "x = {a, c}", "x = {a, b}"}),
        ("x = {a: b, c: d}", {"x = {c: d}", "x = {a: b}"}),
        ("x = a * 2", {"x = a * 3"}),
        ("x = 0.5", {"x = 1.5"}),
        ("x = 'µ', a < b", {"x = 'µ', a <= b", "x = 'µ', a > b"}),
    ],
)
def test_each_operator_changes_exactly_one_place(line: str, changed: set[str]) -> None:
    text = f"def f() -> None:\n    {line}\n"
    found = mutants(text)
    assert {m.apply(text).splitlines()[1].strip() for m in found} == changed
    assert {m.line for m in found} == {2}


@pytest.mark.parametrize(
    "text",
    [
        '"""Is 1 < 2?"""\n',
        "LIMIT = 5.0\n",
        "class A:\n    limit: float = 0.5\n",
        "def f(a: int = b) -> Literal[1]:\n    return a * b  # not 1 < 2\n",
        "def f() -> None:\n    raise ValueError(f'{a - b} is {1 < 2}' + 'and not 3')\n",
        "if TYPE_CHECKING:\n    import a\n",
        "def f() -> None:\n    x = True, None, 'a', [1][:0] * 0\n".replace("[1][:0] * 0", "a"),
    ],
)
def test_texts_annotations_and_the_values_of_constants_are_left_alone(text: str) -> None:
    assert mutants(text) == []


def test_every_mutant_of_a_core_file_is_another_program_on_the_line_it_names() -> None:
    for core in CORE_FILES:
        text = (ROOT / core.path).read_text()
        found = mutants(text)
        assert found
        lines = text.splitlines()
        for mutant in found[::5]:
            changed = mutant.apply(text)
            assert ast.dump(ast.parse(changed)) != ast.dump(ast.parse(text))
            assert changed.splitlines()[: mutant.line - 1] == lines[: mutant.line - 1]
            assert text[mutant.start : mutant.end] == mutant.old


def test_at_least_twenty_core_files_are_there_and_found_by_the_end_of_their_path() -> None:
    assert len({core.path for core in CORE_FILES}) == len(CORE_FILES) >= 20
    assert [core.path for core in chosen(["gantry/path.py"])] == ["drivers/gantry/path.py"]
    assert chosen([]) == CORE_FILES
    with pytest.raises(ValueError, match="nowhere"):
        chosen(["nowhere.py"])


def test_every_known_equivalent_is_still_a_mutant_of_its_file_and_has_a_reason() -> None:
    for one in EQUIVALENTS:
        text = (ROOT / one.path).read_text()
        assert [m for m in mutants(text) if is_equivalent(one.path, text, m, (one,))], one
        assert len(one.reason) > 20


def test_the_same_seed_chooses_the_same_mutants_and_each_file_gets_its_share() -> None:
    files = chosen(["gantry/path.py", "pads/rules.py", "l4118/arrival.py"])
    first, again, other = (sample(ROOT, files, 30, seed) for seed in (1, 1, 2))
    assert first == again != other
    assert [sum(core is one for core, _ in first) for one in files] == [10, 10, 10]
    assert len(set(first)) == 30
    assert len({mutant.operator for _, mutant in first}) >= 4
    everything = sample(ROOT, files, 10_000, 1)
    assert len(everything) == sum(
        not is_equivalent(core.path, text, m)
        for core in files
        for text in [(ROOT / core.path).read_text()]
        for m in mutants(text)
    )


def test_a_mutant_known_to_change_nothing_is_not_chosen(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    root = _project(tmp_path)
    chosen_before = sample(root, [CORE], 100, 1)
    same = Equivalent(CORE.path, "if value > 10:", "if value >= 10:", "ten stays ten either way")
    monkeypatch.setattr(equivalents, "EQUIVALENTS", (same,))
    left = sample(root, [CORE], 100, 1)
    (gone,) = [m for _, m in chosen_before if m not in [m for _, m in left]]
    assert (gone.line, gone.old, gone.new) == (10, ">", ">=")


def _project(root: Path, test: str = TINY_TEST) -> Path:
    for name, text in {
        "pyproject.toml": "[tool.pytest.ini_options]\naddopts = ['--import-mode=importlib']\n",
        "daemon/__init__.py": "",
        "daemon/tiny.py": TINY,
        "tests/test_tiny.py": test,
    }.items():
        (root / name).parent.mkdir(parents=True, exist_ok=True)
        (root / name).write_text(text)
    return root


def test_a_caught_fault_and_a_survivor_are_told_apart_and_nothing_is_left_behind(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    root, temporary = _project(tmp_path / "project"), tmp_path / "temporary"
    temporary.mkdir()
    monkeypatch.setattr(tempfile, "tempdir", str(temporary))
    found = {(m.line, m.old, m.new): m for m in mutants(TINY)}
    # The first two are as long as the sound text: byte code of one must not be taken for another's
    planned = [(CORE, found[6, "<", ">"]), (CORE, found[10, "10", "11"]), (CORE, found[6, "<", "<="])]
    told: list[bool] = []
    outcomes = check(root, planned, 1, None, lambda outcome: told.append(outcome.caught))
    assert told == [o.caught for o in outcomes] == [True, False, True]
    assert share(outcomes) == pytest.approx(2 / 3)
    assert "daemon/tiny.py:10: 10  ->  11" in table(outcomes)
    assert "daemon/tiny.py:6" not in table(outcomes)
    assert (root / CORE.path).read_text() == TINY
    assert list(temporary.iterdir()) == []


def test_a_mutant_that_hangs_is_caught_by_the_limit(tmp_path: Path) -> None:
    endless = "from daemon.tiny import clipped\n\n\ndef test_end():\n    while clipped(20.0) != 10.0:\n        pass\n"
    hangs = next(m for m in mutants(TINY) if m.new == "11.0")
    (outcome,) = check(_project(tmp_path, endless), [(CORE, hangs)], 1, 3.0, lambda _: None)
    assert outcome.timed_out
    assert outcome.caught


def test_tests_that_fail_without_a_mutant_or_are_not_there_are_refused(tmp_path: Path) -> None:
    root = _project(tmp_path, TINY_TEST.replace("== 10.0", "== 11.0"))
    planned = [(CORE, mutants(TINY)[0])]
    with pytest.raises(NotSoundError, match="do not pass"):
        check(root, planned, 1, None, lambda _: None)
    (root / CORE.tests[0]).unlink()
    with pytest.raises(NotSoundError, match="there is no tests/test_tiny"):
        check(root, planned, 1, None, lambda _: None)


def test_an_interrupt_leaves_no_copy_behind(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    root, temporary = _project(tmp_path / "project"), tmp_path / "temporary"
    temporary.mkdir()
    monkeypatch.setattr(tempfile, "tempdir", str(temporary))

    def interrupted(_: object) -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        check(root, [(CORE, m) for m in mutants(TINY)], 2, None, interrupted)
    assert list(temporary.iterdir()) == []
