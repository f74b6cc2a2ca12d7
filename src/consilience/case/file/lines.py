"""Lines of a TOML text on which tables and fields begin, for messages about them."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from itertools import accumulate
from typing import Any

Path = tuple[str | int, ...]
"""Keys from the root to a field, with the index of each entry of a list of tables."""

_KEY = r"""(?:[\w-]++|"[^"\n]*+"|'[^'\n]*+')"""
_HEADER = re.compile(rf"\s*\[(?P<many>\[)?\s*(?P<keys>{_KEY}(?:\s*\.\s*{_KEY})*+)\s*\]")
_FIELD = re.compile(rf"\s*(?P<keys>{_KEY}(?:\s*\.\s*{_KEY})*+)\s*=")
_TOKEN = re.compile(r"\"\"\"|'''|\"(?:\\.|[^\"\\])*+\"|'[^']*+'|[#\[\]{}]")
_QUOTE_OR_COMMENT = re.compile("[\"'#]")
_BRACKETS = {"[": 1, "{": 1, "]": -1, "}": -1}
_PLACE = re.compile(r"'(?P<name>[^']*)'|\[(?P<index>\d+)\]|(?P<key>\w+)")

_TABLES = {"load": ("force", "torque")}
"""Tables of a file by the kind that messages name, where the words differ."""


def field_lines(text: str) -> dict[Path, int]:
    """Return the line, counted from one, on which each table and field of a valid TOML text begins."""
    found: dict[Path, int] = {}
    entries: dict[Path, int] = {}
    table: Path = ()
    for number, line in _beginnings(text):
        if header := _HEADER.match(line):
            *outer, last = _keys(header["keys"])
            table = (*_within(outer, entries), last)
            if header["many"]:
                entries[table] = entries.get(table, -1) + 1
            table = _entry(table, entries)
            found.setdefault(table, number)
        elif field := _FIELD.match(line):
            for path in accumulate(_keys(field["keys"]), lambda path, key: (*path, key), initial=table):
                found.setdefault(path, number)
    return found


def line_of(where: str, raw: Mapping[str, Any], lines: Mapping[Path, int]) -> int | None:
    """Find the line of a place such as ``body 'bob': mass`` or ``published[1].time``.

    Parameters
    ----------
    where : str
        Place as messages name it; of a field that is not there, the line of its table is found.
    raw : mapping
        Tables of the file.
    lines : mapping of path to int
        See `field_lines`.
    """
    for path in _paths(re.sub(r"^mechanism '[^']*': ", "", where), raw):
        for length in range(len(path), 0, -1):
            if path[:length] in lines:
                return lines[path[:length]]
    return None


def lines_by_name(raw: Mapping[str, Any], lines: Mapping[Path, int]) -> dict[str, int]:
    """Return the lines of all tables that have a name, by the names of messages, such as ``contact 'floor'``."""
    words = {table: kind for kind, tables in _TABLES.items() for table in tables}
    return {
        f"{words.get(table, table.replace('_', ' '))} '{entry['name']}'": lines[table, n]
        for table, entries in raw.items()
        for n, entry in enumerate(entries if isinstance(entries, list) else ())
        if isinstance(entry, dict) and "name" in entry and (table, n) in lines
    }


def _paths(where: str, raw: Mapping[str, Any]) -> Iterator[Path]:
    """List the paths that a place may stand for: an entry of a list of tables is named by its field `name`."""
    kind, _, rest = where.partition(" '")
    if not rest:
        yield tuple(int(m["index"]) if m["index"] else m["key"] or m["name"] for m in _PLACE.finditer(where))
        return
    name, _, fields = rest.partition("'")
    inner = [int(m["index"]) if m["index"] else m["key"] or m["name"] for m in _PLACE.finditer(fields)]
    for table in raw if kind == "element" else _TABLES.get(kind, (kind.replace(" ", "_"),)):
        named = raw.get(table)
        for n, entry in enumerate(named if isinstance(named, list) else ()):
            if isinstance(entry, dict) and entry.get("name") == name:
                yield (table, n, *inner)


def _beginnings(text: str) -> Iterator[tuple[int, str]]:
    """List the lines on which a header or a field may begin: those within no array and no text of several lines."""
    quote, depth = "", 0
    for number, line in enumerate(text.split("\n"), start=1):
        if not quote and not depth:
            yield number, line
        if not quote and not _QUOTE_OR_COMMENT.search(line):
            depth += sum(step * line.count(bracket) for bracket, step in _BRACKETS.items())
            continue
        at = 0
        while at < len(line):
            if quote:
                end = line.find(quote, at)
                quote, at = ("", end + len(quote)) if end >= 0 else (quote, len(line))
                continue
            token = _TOKEN.search(line, at)
            if token is None or token[0] == "#":
                break
            at = token.end()
            quote = token[0] if token[0] in ('"""', "'''") else ""
            depth += _BRACKETS.get(token[0], 0)


def _keys(dotted: str) -> list[str]:
    return [key.strip("\"'") for key in re.findall(_KEY, dotted)]


def _entry(table: Path, entries: Mapping[Path, int]) -> Path:
    return (*table, entries[table]) if table in entries else table


def _within(keys: list[str], entries: Mapping[Path, int]) -> Path:
    """Return the path of a table; of a list of tables, that of its last entry so far."""
    path: Path = ()
    for key in keys:
        path = _entry((*path, key), entries)
    return path
