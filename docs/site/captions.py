"""Give the captions of the navigation the level at which they are headings, which Sphinx leaves out."""

from typing import Any

from sphinx.application import Sphinx

_NAVIGATION = "furo_navigation_tree"


def setup(app: Sphinx) -> dict[str, Any]:
    """After the theme has made the navigation."""
    app.connect("html-page-context", _level, priority=900)
    return {"parallel_read_safe": True, "parallel_write_safe": True}


def _level(app: Sphinx, page: str, template: str, context: dict[str, Any], doctree: object) -> None:
    del app, page, template, doctree
    if _NAVIGATION in context:
        context[_NAVIGATION] = context[_NAVIGATION].replace('role="heading"', 'role="heading" aria-level="2"')
