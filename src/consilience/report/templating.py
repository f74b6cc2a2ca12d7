"""Jinja environments of the page templates."""

from __future__ import annotations

from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined


def template_environment(**options: Any) -> Environment:
    """Return an environment of the templates beside this file; an undefined name is an error."""
    loader = PackageLoader("consilience.report", "templates")
    return Environment(loader=loader, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True, **options)
