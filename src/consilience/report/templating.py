"""Jinja environments of the page templates."""

from __future__ import annotations

from functools import cache
from typing import Any

from jinja2 import Environment, FileSystemBytecodeCache, PackageLoader, StrictUndefined


@cache
def template_environment(**options: Any) -> Environment:
    """Return the environment of the templates beside this file for these options; an undefined name is an error.

    Compiled templates are kept in Jinja's folder among the temporary files: compilation takes as long as rendering.
    What is compiled depends on the options, hence the names of the files.
    """
    loader = PackageLoader("consilience.report", "templates")
    chosen = (f"{name}={value}" if isinstance(value, bool) else name for name, value in sorted(options.items()))
    return Environment(
        loader=loader,
        undefined=StrictUndefined,
        bytecode_cache=FileSystemBytecodeCache(pattern=f"consilience-{'-'.join(chosen)}-%s"),
        trim_blocks=True,
        lstrip_blocks=True,
        **options,
    )
