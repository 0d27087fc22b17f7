"""The map for engineers stays true: every path it names exists, every function is there, every layer is drawn."""

import ast
import re
import tomllib
from itertools import pairwise
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PAGES = ("doc/architecture.md", "doc/how-to-add.md")
READMES = (
    "README.md", "daemon/README.md", "daemon/procedures/calibrate/README.md", "drivers/README.md", "tests/README.md",
    "sim_hw/README.md", "vision/README.md",
)  # fmt: skip
FOLDERS = ("daemon", "drivers", "vision", "sim_hw", "tests", "systemd", "doc", "requirements")
QUOTED = re.compile(r"`([^`\n]+)`")
PATH = re.compile(rf"(?:{'|'.join(FOLDERS)})/[\w./-]*|[\w./-]+\.py")
LINK = re.compile(r"\]\(([^)#]+)\)")
TO_BE_MADE = "KIND"
"""Stands in a path for a name that the reader chooses."""


def _quoted(page: str) -> list[str]:
    """Return the texts in backticks, without those of code blocks."""
    text = re.sub(r"```.*?```", "", (ROOT / page).read_text(encoding="utf-8"), flags=re.DOTALL)
    return QUOTED.findall(text)


def _places(page: str) -> list[tuple[str, str]]:
    """Return path and dotted name ("" where none is given) of all that a page points to."""
    split = [quoted.partition(":") for quoted in _quoted(page)]
    return [(path, name) for path, _, name in split if PATH.fullmatch(path) and "/" in path]


def _defined(path: Path) -> set[str]:
    """Return the dotted names of what a module defines: classes, functions, methods, values."""
    found: set[str] = set()

    def visit(body: list[ast.stmt], within: str) -> None:
        for node in body:
            match node:
                case ast.ClassDef() | ast.FunctionDef() | ast.AsyncFunctionDef():
                    found.add(within + node.name)
                    if isinstance(node, ast.ClassDef):
                        visit(node.body, f"{within}{node.name}.")
                case ast.Assign(targets=[ast.Name(id=name)]) | ast.AnnAssign(target=ast.Name(id=name)):
                    found.add(within + name)
                case _:
                    pass

    visit(ast.parse(path.read_text(encoding="utf-8")).body, "")
    return found


def _missing(page: str) -> list[str]:
    wrong, folder = [], (ROOT / page).parent
    for path, name in _places(page):
        if TO_BE_MADE in path:
            parent = path[: path.index(TO_BE_MADE)].rpartition("/")[0]
            if not (ROOT / parent).is_dir():
                wrong.append(path)
            continue
        file = next((base / path for base in (ROOT, folder) if (base / path).exists()), None)
        if file is None or (name and name not in _defined(file)):
            wrong.append(f"{path}:{name}")
    return wrong


@pytest.mark.parametrize("page", PAGES)
def test_every_path_and_function_that_a_page_names_is_there(page: str) -> None:
    assert len(_places(page)) > 20
    assert _missing(page) == []


@pytest.mark.parametrize("page", PAGES)
def test_every_name_that_a_page_gives_without_its_file_is_in_the_code(page: str) -> None:
    sources = [path.read_text(encoding="utf-8") for folder in FOLDERS for path in (ROOT / folder).rglob("*.py")]
    known = set(re.findall(r"\w+", "\n".join(sources)))
    names = [name for name in _quoted(page) if re.fullmatch(r"_?[A-Za-z]+(_\w+)?", name)]
    assert names
    assert [name for name in names if name not in known and name != TO_BE_MADE] == []


@pytest.mark.parametrize("page", READMES)
def test_every_path_that_a_readme_names_is_there(page: str) -> None:
    assert _missing(page) == []


@pytest.mark.parametrize("page", [*PAGES, *READMES])
def test_every_link_to_a_file_leads_somewhere(page: str) -> None:
    links = [link for link in LINK.findall((ROOT / page).read_text(encoding="utf-8")) if "://" not in link]
    folder = (ROOT / page).parent
    assert [link for link in links if not (folder / link).exists()] == []


@pytest.mark.parametrize("folder", ["daemon", "vision", "drivers", "sim_hw"])
def test_the_layers_are_drawn_as_the_contracts_have_them(folder: str) -> None:
    contracts = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["tool"]["importlinter"][
        "contracts"
    ]
    (layers,) = [c["layers"] for c in contracts if c.get("containers") == [folder]]
    boxes = [f'{folder}{n}["{layer}"]' for n, layer in enumerate(layers, start=1)]
    arrows = [f"        {upper} --> {lower}" for upper, lower in pairwise(boxes)]
    drawn = "\n".join([f"    subgraph {folder}", *arrows, "    end"])
    assert drawn in (ROOT / "doc/architecture.md").read_text(encoding="utf-8")
