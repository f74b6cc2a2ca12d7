"""Import of a file of another format as a case; the root element of the XML selects the reader."""

from __future__ import annotations

import tomllib
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from xml.etree.ElementTree import Element, ParseError, TreeBuilder, XMLParser

from consilience.case.case import Case
from consilience.case.file.reader import cases_from_tables
from consilience.case.file.writer import case_text
from consilience.case.importing.build import Built, build
from consilience.case.importing.urdf import read_urdf
from consilience.engine import adapter_file, beside_adapter, installed, lacks_engine, pip_requirement
from consilience.engine.native import Notes, Parts
from consilience.errors import InvalidInput
from consilience.mechanism import Initial

_LARGEST = 50_000_000
"""Bytes; the largest robots have below one million."""

Reader = Callable[[Element, Path, bool, Notes], Parts]


@dataclass(frozen=True, eq=False)
class Imported:
    """A model of another format as a case.

    Attributes
    ----------
    case : Case
    built : Built
        Mechanism, with the piece of the file for each body.
    notes : Notes
        Changes and omissions.
    """

    case: Case
    built: Built
    notes: Notes


class _ModelTreeBuilder(TreeBuilder):
    """Builder that refuses a file with a document type.

    Attributes
    ----------
    root : Element or None
        The root, once its end was read.
    """

    def __init__(self) -> None:
        super().__init__()
        self.root: Element | None = None
        self._depth = 0

    def start(self, tag: str, attrs: dict[str, str]) -> Element:
        """Begin an element."""
        self._depth += 1
        return super().start(tag, attrs)

    def end(self, tag: str) -> Element:
        """End an element."""
        self._depth -= 1
        element = super().end(tag)
        if self._depth == 0:
            self.root = element
        return element

    def doctype(self, name: str, pubid: str | None, system: str | None) -> None:
        """Stop at the declaration, before any entity."""
        raise ParseError("it declares a document type: no model does, and its entities are not read")


def _xml(path: Path, notes: Notes) -> Element:
    """Root element of a file of bounded size without declarations of entities, read as leniently as engines read it.

    The parser of the standard library (expat) neither loads external entities nor lets internal entities grow without
    bounds; models need neither, so a file with a document type is refused. Space before the declaration, text behind
    the root and the default namespace say nothing of the model.
    """
    try:
        data = path.read_bytes()
    except OSError as error:
        raise InvalidInput(str(path), f"it cannot be read ({error.strerror})", "Give the path of a model.") from None
    if len(data) > _LARGEST:
        raise InvalidInput(str(path), f"it has {len(data)} bytes", f"Give a model of at most {_LARGEST}.")
    builder = _ModelTreeBuilder()
    parser = XMLParser(target=builder)
    try:
        parser.feed(data.lstrip())
        parser.close()
    except ParseError as error:
        if builder.root is None:
            what = f"it is no XML that can be read: {error}"
            raise InvalidInput(str(path), what, "Give a URDF or MJCF file.") from None
        notes.add("text behind the last element, not read", path.name)
    root = builder.root
    assert root is not None
    namespace = root.tag[: root.tag.find("}") + 1]
    for element in root.iter():
        element.tag = element.tag.removeprefix(namespace)
        inside = [element.text if len(element) or element.attrib else "", *(child.tail for child in element)]
        if any((text or "").strip() for text in inside):  # bare elements with text are data, as of a transmission
            notes.add("text between elements, not read", f"<{element.tag}>")
    return root


def readers() -> dict[str, Reader]:
    """Return the readers by root element: of URDF, and of installed adapters.

    An adapter's package may have a module ``reading`` with a table ``READERS``.
    """
    found: dict[str, Reader] = {"robot": read_urdf}
    for point in installed().values():
        if not lacks_engine(point) and (module := beside_adapter(point, "reading")):
            found |= module.READERS
    return found


def import_model(path: Path, free_base: bool = False) -> Imported:
    """Read a model of another format as a case.

    Parameters
    ----------
    path : Path
        URDF or MJCF, told apart by the root element.
    free_base : bool
        URDF only: the root link floats.

    Raises
    ------
    InvalidInput
        The file cannot be read, or has parts that no case can express, all in one message.
    """
    notes = Notes()
    root, known = _xml(path, notes), readers()
    if root.tag not in known:
        tags = ", ".join(f"<{tag}>" for tag in known)
        more = [pip_requirement(p) for p in installed().values() if lacks_engine(p) and adapter_file(p, "reading.py")]
        remedy = f"Give a file with one of {tags}." + "".join(f" For more: pip install '{one}'" for one in more)
        raise InvalidInput(str(path), f"its root is <{root.tag}>", remedy)
    if any("xacro" in e.tag for e in root.iter()):
        raise InvalidInput(str(path), "it has macros of xacro", "Run xacro on it, and import what comes out.")
    parts = known[root.tag](root, path, free_base, notes)
    built = build(parts, notes)
    case = Case(
        name=parts.name,
        file=path.name,
        title=f"{parts.name}, imported from {path.name}",
        mechanism=built.mechanism,
        initial=Initial(),
        duration=5.0,
        sample=0.05,
        digits=8,
        instants=20,
        seed=1,
        sources=(path.name,),
    )
    return Imported(case, built, notes)


def imported_text(imported: Imported) -> str:
    """Return the text of the case file; its first lines say what was changed or left out.

    Raises
    ------
    InvalidInput
        The case cannot be written, for instance because loops are open in the drawing.
    """
    heading = [f"Imported from {imported.case.file}. Changed or left out:", *imported.notes.lines()]
    text = case_text(imported.case, "\n".join(heading))
    # refuse a text that the reader of case files would refuse
    cases_from_tables(imported.case.name, imported.case.file, tomllib.loads(text))
    return text
