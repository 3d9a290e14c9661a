"""Write `docs/reference/settings.md` from the tree of settings: `make generated`.

What `stillwake config` prints comes from the same list (`contract.config.listing`).
"""

import os
import sys
from operator import attrgetter
from pathlib import Path
from typing import Final

from contract.config.listing import Setting, sections, shown
from contract.config.loading import load_config
from contract.config.rules import Source
from contract.config.tree import Config

ROOT: Final = Path(__file__).resolve().parents[1]
PAGE: Final = ROOT / "docs" / "reference" / "settings.md"

_HEAD: Final = """# Settings

For everyone who sets something: every setting of the tree, by the name that `--set NAME=VALUE` and a TOML file
(`--set FILE.toml`) use. `stillwake config` prints the values that hold for a call, and where each comes from;
`stillwake config --toml` prints a file to start from. A default is the paper's number where the paper has one, and
its source names the place: a section, table, equation or appendix. "Ours" is what the paper does not give, with the
reason or the page that has it. The release's value is given where it differs; [training](../how-to/train.md),
[the weights of the cost](equations.md#the-weights-of-the-cost) and
[smaller networks](../explanation/studies.md#smaller-networks) have its reasons. Lengths are in W, times in t_c, actions
a = jet flow rate in U_inf W. A number without a unit is a ratio, or counts what its name says. A value outside its
bounds is refused by name.
`make generated` writes this page from `contract/config/`."""


def page() -> str:
    """The whole page: a table for every section."""
    parts = [_HEAD]
    for section in sections(load_config()):
        parts.append(f"\n## {section.name}\n\n{section.meaning} Defined in `{_home(section.name)}`.\n")
        parts.append(
            "| setting | default | release | unit | bounds | source | meaning |\n|---|---|---|---|---|---|---|"
        )
        parts += map(_row, section.settings)
    return "\n".join(parts) + "\n"


def _home(section: str) -> str:
    """Full name of the class that defines a section."""
    kind = type(attrgetter(section)(Config()))
    return f"{kind.__module__}.{kind.__qualname__}"


def _row(one: Setting) -> str:
    release = shown(one.value) if one.is_changed else ""
    cells = (f"`{one.name}`", shown(one.paper), release, one.unit, one.bounds, _source(one.source), one.meaning)
    return f"| {' | '.join(cell.replace('|', chr(92) + '|') for cell in cells)} |"


def _source(source: Source) -> str:
    """Where a default comes from; the reason leads to the page that explains it."""
    note = f"[{source.note}]({os.path.relpath(source.page, PAGE.parent.name)})" if source.page else source.note
    return f"{source.name}: {note}" if note else source.name


if __name__ == "__main__":
    PAGE.write_text(page(), encoding="utf-8")
    sys.stdout.write(f"wrote {PAGE}\n")
