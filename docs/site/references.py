"""The targets of references: Python objects with their full names, pages for links out of `docs/`, and the API for
names in running text.

Sphinx compares a Python name with the ends of all names. This takes half of the build's time and finds wrong objects,
so this module compares full names. A name that is not in the API becomes no link: it is private, an alias without a
docstring, or from another package, whose pages are on a network.
"""

from pathlib import Path
from typing import Any, Final

from docutils import nodes
from sphinx import addnodes
from sphinx.application import Sphinx
from sphinx.domains.python import PythonDomain
from sphinx.transforms.post_transforms import SphinxPostTransform
from sphinx.util.nodes import make_refnode

from docs.site import pages
from docs.site.source import is_ours


class ExactNames(SphinxPostTransform):
    """Resolve references to Python's objects before Sphinx does."""

    default_priority = 5

    def run(self, **options: Any) -> None:
        domain = self.env.domains.python_domain
        for node in list(self.document.findall(addnodes.pending_xref)):
            if node.get("refdomain") == "py":
                name, content = node["reftarget"], list(node.children)
                # An error in a docstring is defined in the same module or in contract.errors.
                full = (name, f"{node.get('py:module')}.{name}", f"contract.errors.{name}")
                known = next((one for one in full if one in domain.objects), None)
                node.replace_self(content if known is None else [_reference(self, domain, known, content)])


class NamesInText(SphinxPostTransform):
    """Turn `package.module.name` and `package/module.py`, in code style, into links to the API."""

    default_priority = 6

    def run(self, **options: Any) -> None:
        domain = self.env.domains.python_domain
        for node in list(self.document.findall(nodes.literal)):
            text = node.astext()
            name = text.removesuffix(".py").replace("/", ".") if text.endswith(".py") else text
            # The line above a module's text is the name of the module's file, and gets no link.
            is_plain = not isinstance(node.parent, nodes.reference | nodes.title) and "file" not in node["classes"]
            if is_plain and is_ours(name) and name in domain.objects:
                node.replace_self([_reference(self, domain, name, [node.deepcopy()])])


def _reference(of: SphinxPostTransform, domain: PythonDomain, name: str, content: list[nodes.Node]) -> nodes.reference:
    entry = domain.objects[name]
    return make_refnode(of.app.builder, of.env.docname, entry.docname, entry.node_id, content, name)


def lead_outside(app: Sphinx, doctree: nodes.document) -> None:
    """Change links to Markdown outside `docs/` to the page that shows it; replace links to folders by plain text."""
    for node in list(doctree.findall(addnodes.pending_xref)):
        if node.get("reftype") != "myst":
            continue
        if node.get("refdomain") == "doc" and node["reftarget"] not in app.env.found_docs:
            path = Path(pages.DOCS, f"{node['reftarget']}.md")
            if path == pages.DOCS / "README.md" or path in _OUTSIDE:
                node["reftarget"] = pages.docname(path)
        elif not node.get("refdomain"):
            here = Path(app.env.doc2path(app.env.docname)).parent
            if (here / node["reftarget"].partition("#")[0]).resolve().is_dir():
                node.replace_self(node.children)


_OUTSIDE: Final = pages.outside()


def setup(app: Sphinx) -> dict[str, Any]:
    """Register both transforms and `lead_outside`."""
    app.add_post_transform(ExactNames)
    app.add_post_transform(NamesInText)
    app.connect("doctree-read", lead_outside)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
