"""Class names: no two public classes or type aliases of `src` share a name."""

import ast
from collections import defaultdict
from functools import cache
from pathlib import Path

SOURCE = Path(__file__).parents[2] / "src" / "consilience"

CORE = {"Answer", "Case", "Entry", "Frame", "Method", "Model", "Motion", "Record", "Run", "System", "Table", "Tree"}
"""Nouns of the field and of the harness: private classes must not use them as names either."""

CONSTRUCTORS = {"TypeVar", "NewType", "ParamSpec", "NamedTuple", "TypedDict"}


def is_type(value):
    """Return whether an assigned value is a type: `A | B`, `dict[str, A]`, `Annotated[...]`, `TypeVar(...)`."""
    if isinstance(value, ast.BinOp) and isinstance(value.op, ast.BitOr):
        return all(is_type(side) or isinstance(side, ast.Name | ast.Constant) for side in (value.left, value.right))
    if isinstance(value, ast.Subscript):
        return isinstance(value.value, ast.Name | ast.Attribute) and not isinstance(value.slice, ast.Constant)
    return isinstance(value, ast.Call) and getattr(value.func, "id", "") in CONSTRUCTORS


def defined(tree):
    """Yield the names of the classes and type aliases of a module."""
    for node in tree.body:
        if isinstance(node, ast.ClassDef):
            yield node.name
        elif isinstance(node, ast.Assign | ast.AnnAssign) and node.value is not None:
            targets = node.targets if isinstance(node, ast.Assign) else [node.target]
            names = [target.id for target in targets if isinstance(target, ast.Name)]
            yield from (name for name in names if is_name_of_a_type(name) and is_type(node.value))


def is_name_of_a_type(name):
    """Return whether a name is in CapWords: constants and type variables are in capitals alone."""
    word = name.lstrip("_")
    return word[:1].isupper() and word != word.upper()


@cache
def homes():
    """Return the modules that define each class or alias."""
    found = defaultdict(list)
    for path in sorted(SOURCE.rglob("*.py")):
        for name in defined(ast.parse(path.read_text(encoding="utf-8"))):
            found[name].append(str(path.relative_to(SOURCE)))
    return found


def test_no_two_public_classes_share_a_name():
    clashes = [f"{n}: {', '.join(at)}" for n, at in homes().items() if len(at) > 1 and not n.startswith("_")]
    assert not clashes, "\n" + "\n".join(sorted(clashes))


def test_no_private_class_has_the_name_of_a_core_noun():
    hidden = [f"{n}: {', '.join(at)}" for n, at in homes().items() if n.startswith("_") and n.lstrip("_") in CORE]
    assert not hidden, "\n" + "\n".join(sorted(hidden))


def test_classes_and_aliases_are_seen():
    kept = (
        "class Aa: ...",
        "Bb = dict[str, Aa]",
        "Cc = Aa | None",
        "Ee = TypeVar('Ee')",
        "_Gg: Alias = tuple[Aa, ...]",
    )
    other = ("Dd = {}", "FULL = Aa | Bb", "Hh = x[0]", "Kk = Aa(1)", "T = TypeVar('T')")
    assert list(defined(ast.parse("\n".join((*kept, *other))))) == ["Aa", "Bb", "Cc", "Ee", "_Gg"]
