"""Two changes to Sphinx's HTML. Formulas become MathML, which browsers show without a script or a network. The
navigation's captions, which are headings, get a heading level."""

from typing import Any

from docutils import nodes
from docutils.utils.math.latex2mathml import tex2mathml
from sphinx.application import Sphinx
from sphinx.writers.html5 import HTML5Translator

_NAVIGATION = "furo_navigation_tree"


def setup(app: Sphinx) -> dict[str, Any]:
    """Register the renderer `mathml`, and `_level`, which adds the level to the captions that the theme has written."""
    app.add_html_math_renderer("mathml", (_inline, None), (_display, None))
    app.connect("html-page-context", _level, priority=900)
    return {"parallel_read_safe": True, "parallel_write_safe": True}


def _inline(writer: HTML5Translator, node: nodes.math) -> None:
    writer.body.append(tex2mathml(node.astext()))
    raise nodes.SkipNode


def _display(writer: HTML5Translator, node: nodes.math_block) -> None:
    writer.body.append(f'<div class="math">{tex2mathml(node.astext(), as_block=True)}</div>\n')
    raise nodes.SkipNode


def _level(app: Sphinx, page: str, template: str, context: dict[str, Any], doctree: object) -> None:
    if _NAVIGATION in context:
        context[_NAVIGATION] = context[_NAVIGATION].replace('role="heading"', 'role="heading" aria-level="2"')
