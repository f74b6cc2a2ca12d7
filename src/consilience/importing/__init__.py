"""Case files from models in other formats, and what of them a case cannot keep."""

from __future__ import annotations

from consilience.importing.files import Imported, import_model, imported_text
from consilience.importing.parts import Law, Motion, Notes, Parts, Piece

__all__ = ["Imported", "Law", "Motion", "Notes", "Parts", "Piece", "import_model", "imported_text"]
