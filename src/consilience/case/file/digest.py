"""Digest of what a case file asks."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from typing import Any

PROSE = ("title", "sources", "remarks", "tags", "published", "variants")
"""Fields of a case file that no engine sees; `variants` holds those of other variants."""


def case_digest(tables: Mapping[str, Any], variant: str = "") -> str:
    """Return the digest of what the tables of a case file ask: 16 hexadecimal digits.

    Comments, layout, prose and expected values do not enter; how a number is written does (``1`` and ``1.0``).

    Parameters
    ----------
    tables : mapping
        Tables of a file.
    variant : str
        Name of a variant; empty for a file without variants.
    """
    tables_of_variant = tables["variants"][variant] if variant else {}
    shared, own = ({k: v for k, v in t.items() if k not in PROSE} for t in (tables, tables_of_variant))
    text = json.dumps([shared, own], sort_keys=True, separators=(",", ":"), default=str)
    return hashlib.sha256(text.encode()).hexdigest()[:16]
