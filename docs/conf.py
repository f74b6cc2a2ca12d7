"""The site: Sphinx, MyST Markdown and notebooks, Furo. `python -m sphinx -W -j auto docs build/site` builds it."""

import re
import sys
from pathlib import Path

from sphinx.application import Sphinx

sys.path.insert(0, str(Path(__file__).parent))

import site_pages

project = "Consilience"
author = "The Consilience authors"
copyright = "The Consilience authors; MIT licence"
extensions = ["myst_nb", "sphinx.ext.autodoc", "sphinx.ext.mathjax", "sphinx.ext.napoleon"]
exclude_patterns = ["build", "generated/_*", "example_engine"]
html_theme = "furo"
html_title = "Consilience"
html_static_path = ["static"]
html_css_files = ["site.css", "katex/katex.min.css"]
html_js_files = ["page.js", "katex/katex.min.js", "katex/auto-render.min.js"]
mathjax_path = "katex/typeset.js"  # KaTeX, vendored, sets what Sphinx writes for MathJax
html_copy_source = False
nitpicky = False
myst_enable_extensions = ["attrs_inline", "colon_fence", "dollarmath"]
myst_heading_anchors = 3
nb_execution_mode = "cache"  # notebooks hold no outputs, and run once for each state of theirs
nb_execution_in_temp = True
nb_execution_raise_on_error = True
nb_execution_timeout = 600
nb_output_stderr = "remove"  # progress
suppress_warnings = ["ref.python"]  # a name may be offered by its package and by its module
napoleon_google_docstring = False
napoleon_use_ivar = True
default_role = "code"
autodoc_member_order = "bysource"
autodoc_typehints = "description"
autodoc_typehints_description_target = "documented"
autodoc_class_signature = "mixed"
autodoc_inherit_docstrings = False
autodoc_preserve_defaults = True


def setup(app: Sphinx) -> None:
    """Write the generated pages before the site is read: cases, findings, API, drawings."""
    app.connect("builder-inited", lambda built: site_pages.write(Path(built.srcdir)))
    app.connect("autodoc-process-docstring", escaped, priority=1)  # before napoleon


def escaped(app: Sphinx, what: str, name: str, thing: object, options: object, lines: list[str]) -> None:
    """Escape bars, asterisks and trailing underscores outside code: in docstrings they are mathematics, not markup."""
    for n, line in enumerate(lines):
        parts = re.split(r"(`+[^`]*`+)", line)
        lines[n] = "".join(p if p.startswith("`") else re.sub(r"([|*]|(?<=\w)_(?=\W|$))", r"\\\1", p) for p in parts)
