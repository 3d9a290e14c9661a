"""The generated pages of the site: the first page, a page for each group, and pages for Markdown outside `docs/`.

The site's sections, groups and pages have the order of the lists in `docs/README.md`. Before Sphinx looks for its
sources, the pages are written to `docs/generated` and `docs/index.markdown`, which git ignores. A page that has not
changed is not written.
"""

import os
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final, NamedTuple

from sphinx.application import Sphinx
from sphinx.config import Config

from docs.made import PLACE, whole

ROOT: Final = Path(__file__).resolve().parents[2]
DOCS: Final = ROOT / "docs"
GENERATED: Final = DOCS / "generated"
INDEX: Final = DOCS / "index.markdown"

_LINK: Final = re.compile(r"(\]\()([^)#\s]+)")
_PICTURE: Final = re.compile(
    r'<picture>\s*<source media="\(prefers-color-scheme: light\)" srcset="([^"]+)">\s*'
    r'<img src="([^"]+)" alt="([^"]+)">\s*</picture>'
)


class Group(NamedTuple):
    """A group of pages in a section: its heading ("" for pages that are directly in the section), the Markdown below
    the heading, and the links in the group's lists, in the same order."""

    name: str
    text: str
    pages: tuple[str, ...]


def sections(readme: str) -> dict[str, list[Group]]:
    """Return the groups of all sections that contain a list, by section. Only links in lists count as pages."""
    found = {}
    for section in re.split(r"^## ", readme, flags=re.MULTILINE)[1:]:
        name, _, body = section.partition("\n")
        texts = re.split(r"^### (.+)$", body, flags=re.MULTILINE)
        made = (_group(*one) for one in zip(["", *texts[1::2]], texts[::2], strict=True))
        if groups := [group for group in made if group.pages]:
            found[name] = groups
    return found


def _group(name: str, text: str) -> Group:
    lists = f"\n{text}".partition("\n- ")[2]
    return Group(name, text.strip(), tuple(link for _, link in _LINK.findall(lists)))


def outside() -> dict[Path, str]:
    """Return the Markdown files outside `docs/` that the site shows, with the name of each file's page."""
    files = [*sorted(ROOT.glob("*.md")), *sorted((ROOT / "examples").glob("*/README.md"))]
    names = ["-".join(path.relative_to(ROOT).with_suffix("").parts).lower() for path in files]
    return {path: f"generated/{name}" for path, name in zip(files, names, strict=True)}


def docname(path: Path) -> str:
    """Return the name of the page that shows a Markdown file."""
    if path == DOCS / "README.md":
        return "index"
    return outside().get(path) or path.relative_to(DOCS).with_suffix("").as_posix()


def moved(text: str, source: Path, target: Path) -> str:
    """Return the text of the file `source` with its relative links and pictures adapted to the path `target`.

    An HTML picture with a file for the light and a file for the dark theme becomes two pictures. The site shows one.
    """

    def path(link: str) -> str:
        return os.path.relpath(os.path.normpath(source.parent / link), target.parent).replace(os.sep, "/")

    def lead(found: re.Match[str]) -> str:
        return found[0] if ":" in found[2] else found[1] + path(found[2])

    def both(found: re.Match[str]) -> str:
        files = {"light": found[1], "dark": found[2]}
        shown = (f"```{{image}} {path(one)}\n:class: only-{mode}\n:alt: {found[3]}\n```" for mode, one in files.items())
        return "\n\n".join(shown)

    return _PICTURE.sub(both, _LINK.sub(lead, text))


def pages() -> dict[Path, str]:
    """Return the text of every generated page by the path of its file."""
    made = {}
    for path, name in outside().items():
        target = DOCS / f"{name}.markdown"
        made[target] = moved(path.read_text(encoding="utf-8"), path, target)
    readme = (DOCS / "README.md").read_text(encoding="utf-8")
    toctrees = [_toctree("Start", [f"Overview </{outside()[ROOT / 'README.md']}>"])]
    for section, groups in sections(readme).items():
        entries = []
        for group in groups:
            names = [docname(Path(os.path.normpath(DOCS / page))) for page in group.pages]
            if group.name:
                path = GENERATED / _slug(section) / f"{_slug(group.name)}.markdown"
                text = moved(group.text, DOCS / "README.md", path)
                made[path] = f"# {group.name}\n\n{text}\n{_toctree('', names)}"
                names = [docname(path)]
            entries += names
        if section == "Reference":
            entries.append("generated/api/index")
        toctrees.append(_toctree(section, entries))
        if section == "Tutorial":
            gallery = ["generated/gallery/index"] if has_gallery() else []
            others = [name for path, name in outside().items() if path.parent != ROOT]
            toctrees.append(_toctree("Examples", gallery + others))
    # The first page has the README's title, introduction and first section, and then the list of documents, in which
    # every heading is one level lower.
    parts = moved((ROOT / "README.md").read_text(encoding="utf-8"), ROOT / "README.md", INDEX).split("\n## ")[:2]
    documents = re.sub(r"^#", "##", readme, flags=re.MULTILINE)
    made[INDEX] = "\n## ".join(parts) + f"\n{documents}\n{''.join(toctrees)}"
    return made


def write(texts: Mapping[Path, str]) -> None:
    """Write the files whose text has changed. Sphinx skips the other files, because their time stamps are unchanged."""
    for path, text in texts.items():
        if not path.exists() or path.read_text(encoding="utf-8") != text:
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(text, encoding="utf-8")


def has_gallery() -> bool:
    """Return whether the gallery has scripts."""
    return any((ROOT / "examples" / "gallery").glob("*.py"))


STORIES: Final = ("recording_to_sensors", "differentiate_the_flow", "fault_in_the_loop", "bundle_to_cortex_m7")
"""The gallery's scripts in the order of the site."""


def place_in_gallery(name: str) -> int:
    """Return a sort key for a script of the gallery."""
    return STORIES.index(name.removesuffix(".py"))


def setup(app: Sphinx) -> dict[str, Any]:
    """Register the functions that write pages, fill in the parts of `docs.made`, and shorten the navigation."""
    app.connect("config-inited", _write)
    app.connect("env-get-outdated", _with_parts)
    app.connect("source-read", _fill)
    app.connect("html-page-context", _collapse, priority=400)  # before the theme requests the full list
    return {"parallel_read_safe": True, "parallel_write_safe": True}


def _write(app: Sphinx, config: Config) -> None:
    made = pages()
    for stale in {*GENERATED.rglob("*.markdown")} - made.keys():
        stale.unlink()
    write(made)


def _with_parts(app: Sphinx, env: object, added: set[str], changed: set[str], removed: set[str]) -> list[str]:
    """Return the pages with generated parts. Sphinx must always read them, as these parts change without the file."""
    return [docname(path) for path in DOCS.rglob("*.md") if PLACE.search(path.read_text(encoding="utf-8"))]


def _fill(app: Sphinx, name: str, source: list[str]) -> None:
    source[0] = whole(source[0])


def _collapse(app: Sphinx, page: str, template: str, context: dict[str, Any], tree: object) -> None:
    """Show only this page's branch of the navigation: a full one on every page takes a quarter of the build's time."""
    whole = context.get("toctree")
    if whole is not None:
        context["toctree"] = lambda **options: whole(**{**options, "collapse": True})


def _toctree(caption: str, names: list[str]) -> str:
    head = f":hidden:\n:caption: {caption}\n" if caption else ":hidden:\n"
    entries = "".join(f"{name if ' ' in name else f'/{name}'}\n" for name in names)
    return f"\n```{{toctree}}\n{head}\n{entries}```\n"


def _slug(name: str) -> str:
    return re.sub(r"\W+", "-", name.lower()).strip("-")
