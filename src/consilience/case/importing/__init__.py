"""Cases from models in other formats, with notes of what a case cannot keep."""

# mypy: implicit-reexport

from consilience.case.importing.files import Imported, import_model, imported_text
