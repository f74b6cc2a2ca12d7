"""Docstrings of functions: a public one with five arguments or more says of each what it is."""

import ast
from pathlib import Path

ROOT = Path(__file__).parents[2]
MANY = 5
COMMANDS = "cli/commands"
"""Arguments of a command are its options, which the help describes."""


def public_functions(tree):
    """Yield the public functions of a module and of its classes; those inside functions are not."""
    for node in tree.body:
        if isinstance(node, ast.ClassDef) and not node.name.startswith("_"):
            yield from public_functions(node)
        elif isinstance(node, ast.FunctionDef) and not node.name.startswith("_"):
            yield node


def undescribed(source):
    """Return the functions of a module with many arguments and neither a list of them nor a reference to one."""
    found = []
    for function in public_functions(ast.parse(source)):
        given = (*function.args.posonlyargs, *function.args.args, *function.args.kwonlyargs)
        count = sum(a.arg not in ("self", "cls") for a in given)
        told = ast.get_docstring(function) or ""
        if count >= MANY and "Parameters" not in told and "as `" not in told:
            found.append(function.name)
    return found


def test_many_arguments_are_described():
    files = [f for room in ("src", "adapters") for f in sorted((ROOT / room).rglob("*.py")) if COMMANDS not in str(f)]
    assert len(files) > 300
    assert {str(f.relative_to(ROOT)): names for f in files if (names := undescribed(f.read_text("utf-8")))} == {}


def test_an_undescribed_argument_is_found():
    header = "def f(a, b, c, d, e):\n"
    assert undescribed(f'{header}    """Add."""\n') == ["f"]
    assert not undescribed(
        f'{header}    """Add.\n\n    Parameters\n    ----------\n    a, b, c, d, e : float\n    """\n'
    )
