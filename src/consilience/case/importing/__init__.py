"""Cases from models in other formats, with notes of what a case cannot keep."""

from consilience.case.importing.files import Imported, import_model, imported_text

__all__ = ["Imported", "import_model", "imported_text"]
