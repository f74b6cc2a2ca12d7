"""Mutations of inputs: of tables, key by key and value by value, and of text, byte by byte.

A mutant is a seed and a few steps ``(kind, place, choice)``, all whole numbers or names: Hypothesis shrinks them to the
fewest steps that still show the fault, and the same steps give the same mutant again.
"""

import copy
import json
import math

MARK = "hostile_target"
"""Part of every path among the payloads, by which a file that is opened because of one is known."""

TEXTS = (
    "",
    " ",
    "ground",
    "reference",
    "<script>window.hit=1</script>",
    "</script><script>window.hit=1</script>",
    '"><img src=x onerror=window.hit=1>',
    "'><svg/onload=window.hit=1>",
    "javascript:window.hit=1",
    "[a](javascript:window.hit=1)",
    "![a](https://example.invalid/hit.png)",
    "https://example.invalid/ www.example.invalid @someone <https://example.invalid>",
    "<!-- ]]> --> <![CDATA[ &amp; &#60;script&#62;",
    "{{ 7 * 7 }} {% for x in y %} ${7 * 7} #{7}",
    "| a | b |\n|---|---|\n`code` **bold** ~~out~~ \\",
    "__import__('os').system('touch " + MARK + "')",
    "!!python/object/apply:os.system ['touch " + MARK + "']",
    f"../../{MARK}",
    f"/tmp/{MARK}",
    f"..\\..\\{MARK}\x00.npz",
    "file:///etc/passwd",
    "-rf",
    "$(touch x); `touch x` | touch x",
    "\x00",
    "\x1b[2J\x1b]0;title\x07",
    "\r\n\u2028\u2029\x85",
    "\u202eesrever\u202c",
    "\ufeff\ufffe\uffff",
    "e\u0301" * 50,
    "\U0001f600 \u0410\u0430 \u03b1",
    "%s %n %(x)s {0} {x.__class__}",
    "[bold red]markup[/bold red] [/]",
    "x" * 70,
    "x" * 3_000,
    "nan",
    "1e400",
)

NUMBERS = (
    0,
    -0.0,
    1,
    -1,
    2,
    7,
    0.5,
    1e-9,
    -1e-16,
    1e-30,
    1e-160,
    5e-324,
    1e9,
    1e15,
    1e29,
    -1e30,
    1e31,
    1e160,
    1.7976931348623157e308,
    math.inf,
    -math.inf,
    math.nan,
    2**31,
    2**63,
    2**64,
    -(2**63) - 1,
    10**400,
    math.pi,
    1.0000000000000002,
)


def deep(depth, leaf=1.0):
    """A list nested `depth` levels deep."""
    for _ in range(depth):
        leaf = [leaf]
    return leaf


OTHERS = (True, False, None, [], {}, [[]], [{}], [1.0, 2.0], [1.0] * 3, [1.0] * 5_000, {"x": 1.0}, deep(20), deep(150))


def places(value, found=None):
    """Every container with each of its keys or indices, outer containers first."""
    found = [] if found is None else found
    keys = value.keys() if isinstance(value, dict) else range(len(value)) if isinstance(value, list) else ()
    for key in list(keys):
        found.append((value, key))
        places(value[key], found)
    return found


def numeric_neighbour(value, choice):
    """A number near the old one, to test tolerances, or of another magnitude, to test bounds."""
    factors = (-1.0, 0.0, 1.0 + 1e-12, 1.0 + 1e-6, 0.5, 2.0, 10.0, 1e3, 1e-3, 1e6, 1e-6, 1e12, 1e-12, 1e25, 1e-25)
    return value * factors[choice % len(factors)] if abs(value) < 1e300 else -value


def _number(container, key, choice, _every):
    old = container[key]
    if isinstance(old, int | float) and not isinstance(old, bool) and choice % 2:
        container[key] = numeric_neighbour(old, choice // 2)
    else:
        container[key] = NUMBERS[choice % len(NUMBERS)]


def _text(container, key, choice, _every):
    container[key] = TEXTS[choice % len(TEXTS)]


def _other(container, key, choice, _every):
    container[key] = copy.deepcopy(OTHERS[choice % len(OTHERS)])


def _remove(container, key, _choice, _every):
    del container[key]


def _add(container, key, choice, _every):
    if isinstance(container, dict):
        container[TEXTS[choice % len(TEXTS)]] = container[key]


def _rename(container, key, choice, every):
    if isinstance(container, dict):
        name = every[choice % len(every)][1] if choice % 2 else TEXTS[choice % len(TEXTS)]
        container[name] = container.pop(key)


def _copy(container, key, choice, every):
    source, name = every[choice % len(every)]
    container[key] = copy.deepcopy(source[name])


def _repeat(container, key, choice, _every):
    if isinstance(container[key], list):
        container[key] = copy.deepcopy((container[key] * (1 + choice % 40))[:400])


def _grow(container, key, choice, _every):
    if isinstance(container, list):
        container.insert(choice % (len(container) + 1), copy.deepcopy(container[key]))


TABLE_STEPS = {
    "number": _number,
    "text": _text,
    "other": _other,
    "remove": _remove,
    "add": _add,
    "rename": _rename,
    "copy": _copy,
    "repeat": _repeat,
    "grow": _grow,
}
"""Steps on tables or records, in place: of a container, a key of it, a choice, and all places."""


def change(root, kind, place, choice):
    """Apply one step to tables or records, in place."""
    every = places(root)
    if every:
        TABLE_STEPS[kind](*every[place % len(every)], choice, every)


TABLE_KINDS = tuple(TABLE_STEPS)


def changed_tables(root, steps):
    """A mutant of tables or of a list of records."""
    mutant = copy.deepcopy(root)
    for kind, place, choice in steps:
        change(mutant, kind, place, choice)
    return mutant


OPENINGS = (b"[", b'{"a":', b"{a=", b"a.", b"[[", b'"a".')


def _flip(raw, at, choice):
    return raw[:at] + bytes([raw[at] ^ (1 << choice % 8)]) + raw[at + 1 :] if at < len(raw) else raw


def _cut(raw, at, choice):
    return raw[:at] if choice % 2 else raw[at:]


def _insert(raw, at, choice):
    return raw[:at] + TEXTS[choice % len(TEXTS)].encode("utf-8", "surrogatepass") + raw[at:]


def _nest(raw, at, choice):
    return raw[:at] + OPENINGS[choice % len(OPENINGS)] * (10, 300, 5_000)[choice % 3] + raw[at:]


def _digits(raw, at, choice):
    return raw[:at] + b"9" * (5, 300, 6_000)[choice % 3] + raw[at:]


def _drop(raw, at, _choice):
    start, end = raw.rfind(b"\n", 0, at) + 1, raw.find(b"\n", at) + 1
    return raw[:start] + raw[end or len(raw) :]


def _double(raw, at, _choice):
    start, end = raw.rfind(b"\n", 0, at) + 1, raw.find(b"\n", at) + 1 or len(raw)
    return raw[:end] + raw[start:end] + raw[end:]


def _swap(raw, at, choice):
    lines = raw.split(b"\n")
    n, m = at % len(lines), choice % len(lines)
    lines[n], lines[m] = lines[m], lines[n]
    return b"\n".join(lines)


TEXT_STEPS = {
    "flip": _flip,
    "cut": _cut,
    "insert": _insert,
    "nest": _nest,
    "digits": _digits,
    "drop": _drop,
    "double": _double,
    "swap": _swap,
}
"""Steps on a file: of its bytes, a place among them and a choice."""

TEXT_KINDS = tuple(TEXT_STEPS)


def changed_bytes(raw, steps):
    """A mutant of the bytes of a file; places are spread over the whole file."""
    for kind, place, choice in steps:
        raw = TEXT_STEPS[kind](raw, place * 7919 % (len(raw) + 1), choice)
    return raw


def toml_bytes(tables):
    """TOML of any tables; values that TOML cannot hold (None, lone surrogates) become text."""
    return "".join(f"{_quoted(k)} = {_toml(v)}\n" for k, v in tables.items()).encode("utf-8", "replace")


def _quoted(text):
    return json.dumps(str(text)).replace("\x7f", "\\u007f")


def _toml(value):
    if isinstance(value, dict):
        return "{" + ", ".join(f"{_quoted(k)} = {_toml(v)}" for k, v in value.items()) + "}"
    if isinstance(value, list):
        depth, inner = 0, value
        while isinstance(inner, list) and len(inner) == 1:
            depth, inner = depth + 1, inner[0]
        text = ", ".join(map(_toml, inner)) if isinstance(inner, list) else _toml(inner)
        return "[" * (depth + isinstance(inner, list)) + text + "]" * (depth + isinstance(inner, list))
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, int):
        return hex(value) if value >= 10**300 else str(value)
    return repr(value) if isinstance(value, float) else _quoted(value)


def jsonl_bytes(records):
    """JSON Lines of any records, with Python's words for numbers that JSON lacks (NaN, Infinity)."""
    return "".join(_json(record) + "\n" for record in records).encode("utf-8", "surrogatepass")


def _json(value):
    if isinstance(value, dict):
        return "{" + ", ".join(f"{json.dumps(str(k))}: {_json(v)}" for k, v in value.items()) + "}"
    if isinstance(value, list) and len(value) == 1:
        depth, inner = 0, value
        while isinstance(inner, list) and len(inner) == 1:
            depth, inner = depth + 1, inner[0]
        return "[" * depth + _json(inner) + "]" * depth
    if isinstance(value, list):
        return "[" + ", ".join(map(_json, value)) + "]"
    return json.dumps(value)
