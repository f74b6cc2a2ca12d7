"""Bounded reading of files from elsewhere: size, nesting and numbers have limits.

A TOML or JSON file of a few kilobytes can occupy a parser for minutes, or end the parser with an error of its own; such
files are refused as invalid input.
"""

from __future__ import annotations

import re
import tomllib
from pathlib import Path
from typing import Any

from consilience.errors import InvalidInput

DEEPEST_KEY = 16
"""Largest number of parts of a dotted key: the parser of the standard library is quadratic in that number."""

_KEY = r"""(?:[\w-]++|"[^"\n]*+"|'[^'\n]*+')"""
_DEEP_KEY = re.compile(rf"(?<![\w-])(?:{_KEY}[ \t]*+\.[ \t]*+){{{DEEPEST_KEY}}}")


def bounded_text(path: Path, largest: int) -> str:
    """Return the text of a regular file of bounded size.

    Parameters
    ----------
    largest : int
        Largest size in bytes.

    Raises
    ------
    InvalidInput
        No regular file (a pipe or a device would never end), too large, not readable, or not UTF-8.
    """
    try:
        if path.exists() and not path.is_file():
            raise InvalidInput(str(path), "it is no file", "Give the path of a file.")
        with path.open("rb") as handle:
            raw = handle.read(largest + 1)
    except (OSError, ValueError) as error:  # ValueError: a name with a null character
        reason = error.strerror if isinstance(error, OSError) else error
        raise InvalidInput(str(path), f"it cannot be read ({reason})", "Give the path of a file.") from None
    if len(raw) > largest:
        raise InvalidInput(str(path), f"it is larger than {largest / 1e6:g} MB", "Give a smaller file.")
    try:
        return raw.decode("utf-8")
    except UnicodeDecodeError:
        raise InvalidInput(str(path), "it is not UTF-8 text", "Give a text file.") from None


def toml_tables(text: str, where: str) -> dict[str, Any]:
    """Return the tables of a TOML text.

    Parameters
    ----------
    where : str
        Name of the text in messages.

    Raises
    ------
    InvalidInput
        No valid TOML, nested too deeply, or with numbers too long.
    """
    deep = _DEEP_KEY.search(text)
    if deep:
        line = text.count("\n", 0, deep.start()) + 1
        raise InvalidInput(
            f"{where}: line {line}", f"a name of {DEEPEST_KEY} parts with dots between", "Write tables, or fewer dots."
        )
    try:
        return tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise InvalidInput(where, f"it is not valid TOML: {error}", "Mend the syntax there.") from None
    except RecursionError:
        raise InvalidInput(where, "it is nested too deeply", "No table of a case needs that.") from None
    except ValueError as error:  # a whole number of thousands of digits
        raise InvalidInput(where, f"it holds a number that cannot be read: {error}", "Shorten it.") from None
