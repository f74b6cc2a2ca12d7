"""Jinja environments of the page templates."""

from __future__ import annotations

from functools import cache
from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined


@cache
def template_environment(**options: Any) -> Environment:
    """Return the environment of the templates beside this file for these options; an undefined name is an error."""
    loader = PackageLoader("consilience.report", "templates")
    return Environment(loader=loader, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True, **options)
