"""The self-contained HTML pages, created from a package's templates. A page loads no file, and runs its own scripts."""

import base64
import hashlib
import io
import json
from functools import cache
from importlib.resources import files
from pathlib import Path
from typing import Any, Final, NamedTuple

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup
from matplotlib.figure import Figure

from contract.atomic import replacing

_LIVE: Final = ("firmware_sim.live", "page")
_OWN: Final = ("firmware_sim.runs.run_page", "page")
_STYLES: Final = (
    *((*_LIVE, name) for name in ("vendor/uPlot.min.css", "widgets/theme.css", "widgets/widgets.css")),
    (*_OWN, "report.css"),
)
_WIDGETS: Final = (
    (*_LIVE, "vendor/uPlot.iife.min.js"),
    *((*_LIVE, f"widgets/{name}.js") for name in ("format", "colours", "frames", "wake_view", "chart", "curves")),
    (*_LIVE, "widgets/event_log.js"),
    *((*_OWN, f"{name}.js") for name in ("latency_histogram", "recorded_wake", "mode_strip", "player", "run_view")),
)
_FORBIDDEN: Final = ("</script", "</style", "<!--")


@cache
def templates(package: str) -> Environment:
    return Environment(
        loader=PackageLoader(package),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )


def write(target: Path, template: str, package: str = "firmware_sim.runs", **values: object) -> Path:
    """Write the page from a template and these values, completely or not at all. Texts among the values are escaped; a
    missing value is an error. Raises StillwakeError if the page cannot be written."""
    page = templates(package).get_template(template).render(values)
    with replacing(target) as temporary:
        temporary.write_text(page, encoding="utf-8", errors="backslashreplace")
    return target


def data_uri(png: bytes) -> str:
    """Return a picture as a data URI for an `img` element."""
    return "data:image/png;base64," + base64.b64encode(png).decode("ascii")


def png_of(figure: Figure) -> bytes:
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png")
    return buffer.getvalue()


class Inlined(NamedTuple):
    """A page's scripts and styles, and a content security policy that forbids other scripts and all network access."""

    policy: str
    styles: Markup
    scripts: tuple[Markup, ...]


def inlined(main: str) -> Inlined:
    """Return the styles and scripts of the live page's widgets and of the run pages, with the page's script `main`."""
    scripts = [_text(*place) for place in (*_WIDGETS, (*_OWN, main))]
    digests = (base64.b64encode(hashlib.sha256(script.encode("utf-8")).digest()).decode("ascii") for script in scripts)
    hashes = " ".join(f"'sha256-{digest}'" for digest in digests)
    return Inlined(
        policy=f"default-src 'none'; img-src data: blob:; style-src 'unsafe-inline'; script-src {hashes}",
        styles=Markup("\n".join(_text(*place) for place in _STYLES)),
        scripts=tuple(Markup(script) for script in scripts),
    )


def as_json(values: Any) -> Markup:
    """Return values as JSON for a script element of type application/json, escaped so that no text ends the element."""
    text = json.dumps(values, allow_nan=False, separators=(",", ":"))
    return Markup(text.replace("<", "\\u003c").replace(">", "\\u003e").replace("&", "\\u0026"))


def _text(package: str, folder: str, name: str) -> str:
    text = files(package).joinpath(folder, *name.split("/")).read_text(encoding="utf-8")
    if marks := [mark for mark in _FORBIDDEN if mark in text.lower()]:
        raise ValueError(f"{name}: contains {marks[0]!r}, which would end its HTML element")
    return text
