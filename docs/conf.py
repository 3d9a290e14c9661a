"""The settings with which Sphinx builds the site (`make docs`). The build and the site use no network."""

import sys
from importlib.metadata import version as installed
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from docs.site.pages import has_gallery

project = "stillwake"
author = "stillwake developers"
copyright = "stillwake developers, MIT licence"
version = release = installed("stillwake")

extensions = ["myst_parser", "sphinx_copybutton"]
extensions += [f"docs.site.{name}" for name in ("pages", "api", "references", "html", "browser_ecu")]
source_suffix = {".rst": "restructuredtext", ".md": "markdown", ".markdown": "markdown"}
# The site's first page already contains the list of documents in docs/README.md.
exclude_patterns = ["README.md"]
# Otherwise Sphinx would change the two hyphens of options to a dash.
smartquotes = False
default_role = "literal"

myst_enable_extensions = ["dollarmath"]
myst_heading_anchors = 4

# Every page contains the list of all pages. If this list had all functions, the build would take three times as long.
toc_object_entries = False
add_module_names = False

html_theme = "furo"
html_title = f"stillwake {release}"
html_static_path = ["_static"]
html_css_files = ["site.css"]
html_js_files = ["scrolling.js"]
html_math_renderer = "mathml"
html_search_scorer = str(Path(__file__).parent / "site" / "scorer.js")
html_copy_source = False
html_show_sourcelink = False
copybutton_exclude = ".linenos, .gp, .go"

if has_gallery():
    extensions.append("sphinx_gallery.gen_gallery")
    sphinx_gallery_conf = {
        "examples_dirs": "../examples/gallery",
        "gallery_dirs": "generated/gallery",
        # The build runs every script that was changed; an error in a script ends the build.
        "filename_pattern": r"\.py$",
        "abort_on_example_error": True,
        "within_subsection_order": "docs.site.pages.place_in_gallery",
        "notebook_extensions": set(),
        "download_all_examples": False,
        "write_computation_times": False,
        "show_signature": False,
        "min_reported_time": float("inf"),
        "inspect_global_variables": False,
    }
