"""Self-contained HTML pages from the templates next to this file: no page refers to another file."""

import base64
import io
from functools import cache
from pathlib import Path

from jinja2 import Environment, PackageLoader, StrictUndefined
from matplotlib.figure import Figure

from contract.atomic import replacing


@cache
def templates(package: str) -> Environment:
    """The templates in the folder `templates` of a package; texts are escaped, a missing value is an error."""
    return Environment(
        loader=PackageLoader(package),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )


def render(template: str, package: str = "firmware_sim.runs", **values: object) -> str:
    """The page of a template of a package; texts among the values are escaped, a missing value is an error."""
    return templates(package).get_template(template).render(values)


def write(target: Path, template: str, package: str = "firmware_sim.runs", **values: object) -> Path:
    """Write that page, whole or not at all, and return its path. Raises StillwakeError if it cannot be written."""
    page = render(template, package, **values)
    with replacing(target) as temporary:
        temporary.write_text(page, encoding="utf-8", errors="backslashreplace")
    return target


def data_uri(png: bytes) -> str:
    """A picture as the address of an `img`."""
    return "data:image/png;base64," + base64.b64encode(png).decode("ascii")


def png_of(figure: Figure) -> bytes:
    """A figure as PNG."""
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png")
    return buffer.getvalue()
