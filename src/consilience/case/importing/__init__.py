"""Case files from models in other formats, and what of them a case cannot keep."""

from __future__ import annotations

from consilience.case.importing.files import Imported, import_model, imported_text

__all__ = ["Imported", "import_model", "imported_text"]
