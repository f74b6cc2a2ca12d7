"""Public names of a package."""

import ast
from importlib import import_module
from pathlib import Path


def public_names(package):
    """Names that the `__init__` of a package imports from our modules, which are the names it offers; sorted."""
    tree = ast.parse(Path(import_module(package).__file__).read_text(encoding="utf-8"))
    imports = [node for node in ast.walk(tree) if isinstance(node, ast.ImportFrom)]
    return sorted(a.name for node in imports if node.module.startswith("consilience") for a in node.names)
