"""Self-contained HTML pages, created from the templates of a package; no page loads another file."""

import base64
import io
from functools import cache
from pathlib import Path

from jinja2 import Environment, PackageLoader, StrictUndefined
from matplotlib.figure import Figure

from contract.atomic import replacing


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


def render(template: str, package: str = "firmware_sim.runs", **values: object) -> str:
    """Return a template's page with these values. Texts among the values are escaped; a missing value is an error."""
    return templates(package).get_template(template).render(values)


def write(target: Path, template: str, package: str = "firmware_sim.runs", **values: object) -> Path:
    """Write the page that `render` returns, completely or not at all. Raises StillwakeError on failure."""
    page = render(template, package, **values)
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
