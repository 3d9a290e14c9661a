"""Self-contained HTML pages from the templates next to this file: no page refers to another file."""

import base64
import io
from typing import Final

from jinja2 import Environment, PackageLoader, StrictUndefined
from matplotlib.figure import Figure


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


_TEMPLATES: Final = templates("firmware_sim.runs")


def render(template: str, **values: object) -> str:
    """The page of a template in `templates/`; texts among the values are escaped, a missing value is an error."""
    return _TEMPLATES.get_template(template).render(values)


def data_uri(png: bytes) -> str:
    """A picture as the address of an `img`."""
    return "data:image/png;base64," + base64.b64encode(png).decode("ascii")


def png_of(figure: Figure) -> bytes:
    """A figure as PNG."""
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png")
    return buffer.getvalue()
