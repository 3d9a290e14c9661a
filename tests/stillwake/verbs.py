"""Which commands a command-line app has."""

import typer


def verbs(app: typer.Typer) -> list[str]:
    """The names of an app's own commands, those of its groups left out."""
    names = []
    for command in app.registered_commands:
        assert command.callback is not None
        names.append(command.name or command.callback.__name__.replace("_", "-"))
    return names
