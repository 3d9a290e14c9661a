"""The long run of `bundle_fuzz`: `python -m tests.proofs.release --json results/bundle_fuzz.json`."""

import typer

from stillwake.console.endings import status_of
from stillwake.console.stopping import ends_like_ctrl_c
from tests.proofs.release.bundle_fuzz import main

if __name__ == "__main__":
    app = typer.Typer(add_completion=False, pretty_exceptions_enable=False)
    app.command()(main)
    ends_like_ctrl_c()
    raise SystemExit(status_of(app))
