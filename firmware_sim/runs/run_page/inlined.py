"""The styles, scripts and data that are part of a page: the page loads no other files and runs no other scripts."""

import base64
import hashlib
import json
from importlib.resources import files
from typing import Any, Final, NamedTuple

from markupsafe import Markup

_LIVE: Final = ("firmware_sim.live", "page")
_OWN: Final = ("firmware_sim.runs.run_page", "page")
_STYLES: Final = (
    (*_LIVE, "vendor/uPlot.min.css"),
    (*_LIVE, "widgets/theme.css"),
    (*_LIVE, "widgets/widgets.css"),
    (*_OWN, "report.css"),
)
_WIDGETS: Final = (
    (*_LIVE, "vendor/uPlot.iife.min.js"),
    *((*_LIVE, f"widgets/{name}.js") for name in ("format", "colours", "frames", "wake_view", "chart", "curves")),
    (*_LIVE, "widgets/event_log.js"),
    *((*_OWN, f"{name}.js") for name in ("latency_histogram", "recorded_wake", "mode_strip", "player", "run_view")),
)
_FORBIDDEN: Final = ("</script", "</style", "<!--")


class Inlined(NamedTuple):
    """A page's scripts and styles, and a content security policy that forbids other scripts and all addresses."""

    policy: str
    styles: Markup
    scripts: tuple[Markup, ...]


def inlined(main: str) -> Inlined:
    """Return the styles and scripts of the live page's widgets, with the script `main` from the folder `page`."""
    scripts = [_text(*place) for place in (*_WIDGETS, (*_OWN, main))]
    digests = (base64.b64encode(hashlib.sha256(script.encode("utf-8")).digest()).decode("ascii") for script in scripts)
    hashes = " ".join(f"'sha256-{digest}'" for digest in digests)
    return Inlined(
        policy=f"default-src 'none'; img-src data: blob:; style-src 'unsafe-inline'; script-src {hashes}",
        styles=Markup("\n".join(_text(*place) for place in _STYLES)),
        scripts=tuple(Markup(script) for script in scripts),
    )


def as_json(values: Any) -> Markup:
    """Return values as JSON for a script element of type application/json. No text in the values ends the element."""
    text = json.dumps(values, allow_nan=False, separators=(",", ":"))
    return Markup(text.replace("<", "\\u003c").replace(">", "\\u003e").replace("&", "\\u0026"))


def _text(package: str, folder: str, name: str) -> str:
    text = files(package).joinpath(folder, *name.split("/")).read_text(encoding="utf-8")
    if marks := [mark for mark in _FORBIDDEN if mark in text.lower()]:
        raise ValueError(f"{name}: {marks[0]!r} would end its HTML element")
    return text
