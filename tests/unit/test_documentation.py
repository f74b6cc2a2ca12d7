"""Documentation: code blocks run or are marked as not run, links resolve, public names have docstrings."""

import ast
import importlib
import importlib.util
import inspect
import pkgutil
import re
import shlex
import tomllib
from pathlib import Path
from urllib.parse import urlparse

import pytest
from typer.completion import get_completion_script
from typer.testing import CliRunner

import consilience
from consilience.case import shipped_cases
from consilience.case.file.reader import load_file
from consilience.cli.examples import EXAMPLES, START
from consilience.cli.main import LAZY_COMMANDS, app, command_of
from consilience.engine import Question, defects
from consilience.mechanism import JOINT_KINDS
from consilience.pytest_plugin.known import read_known
from mechanisms import chain, four_bar, states_of
from pages import LANGUAGES, MARKED, PAGES, ROOT, SITE, Block, blocks, mark
from truth import solve

BLOCKS = [block for page in PAGES for block in blocks(page)]
RUN_ELSEWHERE = ("README.md", "docs/tutorials/", "docs/add-a-question.md")
"""Pages whose Python blocks other tests run: test_readme.py, test_tutorials.py, test_add_a_question.py."""

PROGRAMS = ("dask", "for", "pip", "python", "python3", ".venv/bin/pip", ".", "pytest")
CHEAP = ("consilience explain", "consilience schema", "consilience new", "consilience show ", "consilience list")


def commands(block: Block) -> list[str]:
    return block.commands if block.language == "sh" else []


COMMANDS = sorted({(block.page, command) for block in BLOCKS for command in commands(block)})


# ---------------------------------------------------------------- blocks


@pytest.mark.parametrize("page", PAGES, ids=lambda p: str(p.relative_to(ROOT)))
def test_every_block_says_what_it_is(page):
    for block in blocks(page):
        assert block.language in (*LANGUAGES, *SITE), f"{block.page}:{block.line}: '{block.language}'"
        code = re.search(r"^(consilience|pip|pytest|python3?) [\w.-]", block.text, re.MULTILINE)
        assert block.language != "text" or not code, f"{block.page}:{block.line}: a command, but not as sh"


def test_every_mark_marks_something_and_has_a_reason():
    texts = [(page, command) for page, command in COMMANDS] + [(b.page, b.text) for b in BLOCKS]
    for (page, start), why in MARKED.items():
        assert why
        assert any(where == page and text.startswith(start) for where, text in texts), (
            f"{page}: {start}: no such command"
        )
    for block in BLOCKS:
        assert block.language != "yaml" or mark(block.page, block.text), (
            f"{block.page}:{block.line}: neither run nor marked"
        )


def parsed(words: list[str]) -> object:
    """Return the click context of a `consilience` command; raise what the command line would raise."""
    name, *arguments = words
    command = command_of(name)
    return command.make_context(name, [a for a in arguments if a != "--help"], resilient_parsing="--help" in arguments)


def of_ours(command: str) -> list[str]:
    """Return the words after `consilience`, without environment, pipe and redirection; empty for other programs."""
    words = shlex.split(command, comments=True)
    while words and re.fullmatch(r"[A-Z_]+=\S*", words[0]):
        words.pop(0)
    stop = next((n for n, word in enumerate(words) if word in (">", "|", "&&")), len(words))
    return words[1:stop] if words and words[0] == "consilience" else []


@pytest.mark.parametrize(("page", "command"), COMMANDS)
def test_every_command_exists(page, command):
    words = of_ours(command)
    if words and words[0].startswith("--"):
        assert words[0] in ("--help", "--install-completion", "--show-completion")
    elif words:
        parsed(words)
    else:
        program, *rest = [w for w in shlex.split(command, comments=True) if "=" not in w]
        assert program in PROGRAMS, f"{page}: {command}"
        scripts = [word for word in rest if word.startswith("tests/")]
        assert all((ROOT / script).exists() for script in scripts), f"{page}: {command}"


def test_a_command_that_does_not_exist_is_noticed():
    with pytest.raises(Exception, match="No such option: --nonsense"):
        parsed(["run", "--nonsense"])
    with pytest.raises(KeyError):
        parsed(["ruin"])


@pytest.mark.parametrize("page", sorted({page for page, command in COMMANDS if command.startswith(CHEAP)}))
def test_cheap_commands_do_what_the_page_says(page, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for block in (b for b in BLOCKS if b.page == page):
        if block.file:
            Path(block.file).write_text(block.text)
        for command in commands(block):
            if command.startswith(CHEAP) and not mark(page, command):
                done = CliRunner().invoke(app, of_ours(command))
                assert done.exit_code == 0, f"{page}: {command}: {done.exception or done.output}"


@pytest.mark.parametrize("name", LAZY_COMMANDS)
def test_the_help_of_every_command_has_examples_that_parse(name):
    assert set(EXAMPLES) == set(LAZY_COMMANDS)
    for call, what in (*EXAMPLES[name], *START):
        assert what
        parsed(of_ours(call))
    shown = CliRunner().invoke(app, [name, "--help"], env={"COLUMNS": "200"}).output
    assert all(call in shown for call, _ in EXAMPLES[name])


PYTHON = [
    page
    for page in PAGES
    if any(b.language == "python" for b in blocks(page)) and not str(page.relative_to(ROOT)).startswith(RUN_ELSEWHERE)
]
AFTER_A_RUN = {"docs/frames.md": 'frames.motions("first"', "docs/outputs.md": "results.csv"}
"""Blocks that read files written by commands above them, so not run here; test_frames.py tests their functions."""


@pytest.mark.slow
@pytest.mark.parametrize("page", PYTHON, ids=lambda p: p.name)
def test_python_blocks_run(page, capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    names = {"__name__": page.stem}
    for block in blocks(page):
        if block.language == "python" and AFTER_A_RUN.get(block.page, "\n\n\n") not in block.text:
            exec(compile("\n" * block.line + block.text, block.page, "exec"), names)
    assert "nan" not in capsys.readouterr().out


TOML = [block for block in BLOCKS if block.language == "toml"]


@pytest.mark.parametrize("block", TOML, ids=lambda b: f"{b.page}:{b.line}")
def test_toml_blocks_are_valid_documents_of_their_kind(block, tmp_path):
    document = tomllib.loads(block.text)
    path = tmp_path / "block.toml"
    path.write_text(block.text)
    if "body" in document:
        (case,) = load_file(path)
        assert case.states
    elif "known" in document:
        assert len(read_known([path])) == len(document["known"])
    else:
        assert "project" in document or "tool" in document


# ---------------------------------------------------------------- the example engine


@pytest.fixture(scope="module")
def example(tmp_path_factory):
    """Import the module whose source docs/add-an-engine.md prints, and return its engine."""
    (block,) = [b for b in BLOCKS if b.file == "consilience_textbook.py"]
    assert len(block.text.splitlines()) <= 150
    path = tmp_path_factory.mktemp("example") / block.file
    path.write_text(block.text)
    spec = importlib.util.spec_from_file_location(path.stem, path)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module.TextbookEngine()


@pytest.mark.parametrize(
    ("kinds", "backwards"),
    [
        (("revolute", "prismatic", "revolute"), ()),
        (("universal", "cylindrical"), (0,)),
        (("planar", "rigid", "revolute"), (1,)),
        (("parallel_axes", "revolute"), (0, 1)),
    ],
)
def test_the_example_engine_is_right(example, kinds, backwards):
    mechanism = chain(*kinds, seed=3, backwards=backwards)
    states = states_of(mechanism, 3)
    answer = example.instant(mechanism, states, None)
    assert defects(answer, Question.INSTANT, mechanism, 3) == []
    for n, state in enumerate(states):
        found = (answer.a_WB_W[n], answer.alpha_WB_W[n], answer.force_F[n], answer.torque_F[n])
        for ours, true in zip(found, solve(mechanism, state), strict=True):
            assert abs(ours - true).max() <= 1e-10 * abs(true).max()


def test_the_example_engine_refuses_what_it_cannot_do(example):
    assert example.unsupported(four_bar(), Question.INSTANT)[0].feature == "closed loop"
    assert example.unsupported(chain("spherical"), Question.INSTANT)


def test_the_page_counts_its_steps():
    text = (ROOT / "docs" / "add-an-engine.md").read_text(encoding="utf-8")
    assert "in six steps" in text.splitlines()[0]
    assert re.findall(r"^## (\d)\. ", text, re.MULTILINE) == list("123456")


# ---------------------------------------------------------------- links


def anchors(path: Path) -> set[str]:
    """Return the anchors of a page's headings, as GitHub and the site generate them."""
    headings = re.findall(r"^#{1,6} (.+)$", path.read_text(encoding="utf-8"), re.MULTILINE)
    plain = (re.sub(r"[`*]|\[([^\]]*)\]\([^)]*\)", r"\1", heading) for heading in headings)
    return {re.sub(r"[^\w\- ]", "", heading.strip().lower()).replace(" ", "-") for heading in plain}


def links(path: Path) -> list[str]:
    text = re.sub(r"^```.*?^```", "", path.read_text(encoding="utf-8"), flags=re.MULTILINE | re.DOTALL)
    return re.findall(r"(?<!\!)\[[^\]\n]*\]\(([^)\s]+)\)", re.sub(r"`[^`\n]*`", "", text))


@pytest.mark.parametrize("page", PAGES, ids=lambda p: str(p.relative_to(ROOT)))
def test_every_link_leads_somewhere(page):
    for link in links(page):
        if "://" in link:
            address = urlparse(link)
            assert address.scheme == "https", link
            assert re.fullmatch(r"[a-z0-9.-]+\.[a-z]{2,}", address.netloc), link
            continue
        target, _, anchor = link.partition("#")
        path = (page.parent / target).resolve() if target else page
        if "generated/" in target:
            assert target.partition("generated/")[2].removesuffix(".md") in GENERATED, f"{page.name}: {link}"
            continue
        assert path.exists(), f"{page.name}: {link}"
        assert not anchor or anchor in anchors(path), f"{page.name}: {link}"


GENERATED = ("explained", "choose", "contact", "library", "findings/index", "api/index")
"""Pages that docs/site_pages.py generates; the site build, with warnings as errors, checks links to them."""


def test_every_page_is_in_the_contents():
    listed = {
        folder + name
        for folder in ("", "decisions/")
        for name in re.findall(r"^\w[\w/-]*$", (ROOT / "docs" / folder / "index.md").read_text("utf-8"), re.MULTILINE)
    }
    pages = [p for p in PAGES if (ROOT / "docs") in p.parents] + list((ROOT / "docs" / "notebooks").glob("*.ipynb"))
    there = {str(p.relative_to(ROOT / "docs").with_suffix("")) for p in pages} - {"index"}
    assert listed == there | {f"generated/{name}" for name in GENERATED}


# ---------------------------------------------------------------- statements of pages about the code


CONVENTIONS = (ROOT / "docs" / "conventions.md").read_text(encoding="utf-8")


def functions_in(file: str) -> set[str]:
    tree = ast.parse((ROOT / file).read_text(encoding="utf-8"))
    return {node.name for node in tree.body if isinstance(node, ast.FunctionDef)}


def test_every_convention_names_the_test_that_proves_it():
    rows = [line.strip("| ").split(" | ") for line in CONVENTIONS.split("## Joint table")[0].splitlines()]
    rows += [line.strip("| ").split(" | ") for line in CONVENTIONS.split("## Elements")[1].splitlines()]
    table = [row for row in rows if len(row) == 3 and row[0] != "what"]
    assert len(table) == 33
    for what, _, proof in table:
        assert re.fullmatch(r"`tests/[\w/.]+::test_\w+`(, `tests/[\w/.]+::test_\w+`)*", proof.strip()), what
    for file, test in re.findall(r"`(tests/[\w/.]+)::(test_\w+)`", CONVENTIONS):
        assert test in functions_in(file), f"{file}::{test}"


def test_the_joint_table_is_that_of_the_code():
    rows = re.findall(r"^\| (\w+) \| ([A-Z0-9 ]+|none) \| ([^|]+) \|$", CONVENTIONS, re.MULTILINE)
    named = lambda cell, mark: () if cell == "none" else tuple(cell.split(mark))  # noqa: E731
    shown = {kind: (named(held, " "), named(free, ", ")) for kind, held, free in rows}
    assert shown == {name: (kind.rows, kind.coordinates) for name, kind in JOINT_KINDS.items()}


def test_every_group_of_cases_is_on_their_page():
    text = (ROOT / "docs" / "cases.md").read_text(encoding="utf-8")
    assert {case.group for case in shipped_cases()} == set(re.findall(r"^\| `cases/(\w+)`", text, re.MULTILINE))


# ---------------------------------------------------------------- docstrings


def modules() -> list[str]:
    found = [consilience.__name__]
    found += [m.name for m in pkgutil.walk_packages(consilience.__path__, "consilience.") if "__main__" not in m.name]
    return [name for name in found if not any(part.startswith("_") for part in name.split("."))]


def undocumented(name: str) -> list[str]:
    """Return public functions, classes, methods, properties without a docstring; nested functions are private."""
    tree = ast.parse(Path(importlib.util.find_spec(name).origin).read_text(encoding="utf-8"))
    found = [] if ast.get_docstring(tree) else [name]

    def walk(node: ast.AST, prefix: str) -> None:
        for child in ast.iter_child_nodes(node):
            if not isinstance(child, ast.FunctionDef | ast.ClassDef) or child.name.startswith("_"):
                continue
            overload = any(getattr(d, "id", "") == "overload" for d in child.decorator_list)
            if not ast.get_docstring(child) and not overload:
                found.append(f"{prefix}.{child.name}")
            if isinstance(child, ast.ClassDef):
                walk(child, f"{prefix}.{child.name}")

    walk(tree, name)
    return found


def test_every_public_name_is_documented():
    assert [missing for name in modules() for missing in undocumented(name)] == []


def test_every_public_name_is_documented_where_it_is_imported_from():
    for module in (
        "consilience",
        "consilience.reference",
        "consilience.reference.analyses",
        "consilience.reference.contact",
    ):
        package = importlib.import_module(module)
        for name in package.__all__:
            thing = getattr(package, name)
            assert not callable(thing) or inspect.getdoc(thing), f"{module}.{name}"


def test_completion_is_offered_for_every_shell():
    shown = CliRunner().invoke(app, ["--help"], env={"COLUMNS": "200"}).output
    assert "--install-completion" in shown
    assert "_CONSILIENCE_COMPLETE=complete_bash" in completion_script("bash")


def completion_script(shell: str) -> str:
    return get_completion_script(prog_name="consilience", complete_var="_CONSILIENCE_COMPLETE", shell=shell)
