"""The command that shows each setting with its value, the value's source, and its meaning."""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from textwrap import wrap
from typing import Annotated, Final

import typer

from contract.config.listing import Section, Setting, as_toml, sections, shown
from contract.config.loading import PAPER, Loaded, load_config
from contract.config.notes import Source
from contract.errors import ConfigError
from stillwake.console import options as shared
from stillwake.console.settings import read_settings
from stillwake.console.terminal import console

_HEAD: Final = ("setting", "value", "default", "unit", "from")


def config(
    prefix: Annotated[
        str, typer.Argument(help="Show and explain only settings whose names begin with this text.")
    ] = "",
    changed: Annotated[bool, typer.Option("--changed", help="Show only settings that differ from the paper.")] = False,
    toml: Annotated[bool, typer.Option("--toml", help="Print the settings as a TOML file for --set.")] = False,
    given: shared.Settings = [],  # noqa: B006
) -> None:
    """Show the settings: values, units, and where each value comes from.

    The last column gives the source: the "default", the shipped "release", a "file" of --set, or a single "--set". With
    a prefix, the source of each default is given too. --set has the same effect in other commands, with two exceptions:
    in `export` and `refine` it changes the model's settings, and in `train` it changes the training's settings.
    """
    loaded = read_settings(given)
    everything = sections(loaded.config)
    listed = chosen(everything, prefix, only_changed=changed)
    if toml:
        if prefix:
            _check_complete(chosen(everything, prefix, only_changed=False), listed)
        text = as_toml(listed, base=None if prefix else PAPER)
    elif not listed:
        text = f"{prefix or 'all settings'}: as in the paper"
    else:
        text = "\n".join(table(listed, loaded, explain=bool(prefix)))
    console.print(text.rstrip("\n"))


def _check_complete(whole: Sequence[Section], listed: Sequence[Section]) -> None:
    """Raise ConfigError if a file with the `listed` settings would not reproduce the settings of `whole`. Settings that
    are None, or that `--changed` leaves out, are not in the file; they get the release's values."""
    release = {one.name: one.value for section in sections(load_config()) for one in section.settings}
    written = {one.name for section in listed for one in section.settings if one.value is not None}
    for one in (one for section in whole for one in section.settings):
        if one.name not in written and one.value != release[one.name]:
            remedy = f"a file of these settings alone leaves it at the release's {shown(release[one.name])}"
            raise ConfigError(f"{one.name} is {shown(one.value)}: {remedy}; print the file without the prefix")


def chosen(found: Sequence[Section], prefix: str, *, only_changed: bool) -> tuple[Section, ...]:
    """Return the sections, each with its settings whose names begin with the prefix. With `only_changed`, only settings
    whose values differ from the paper are returned. Raises ConfigError if no setting begins with the prefix."""
    if not any(one.name.startswith(prefix) for section in found for one in section.settings):
        raise ConfigError(f"no setting begins with {prefix!r}; the sections are {', '.join(one.name for one in found)}")
    kept = []
    for section in found:
        named = (one for one in section.settings if one.name.startswith(prefix))
        if chosen := tuple(one for one in named if one.is_changed or not only_changed):
            kept.append(replace(section, settings=chosen))
    return tuple(kept)


def table(listed: Sequence[Section], loaded: Loaded, *, explain: bool) -> Iterator[str]:
    """Yield the lines of the table, in which a column is as wide as its content. `explain` adds the bounds and the
    meaning of each setting, and the source of its default."""
    rows = [cells(one, loaded) for section in listed for one in section.settings]
    widths = [max(map(len, column)) for column in zip(_HEAD, *rows, strict=True)]
    yield _line(_HEAD, widths)
    for section in listed:
        yield ""
        about = section.meaning if explain else f"{section.meaning.partition('. ')[0].rstrip('.')}."
        yield from wrap(f"[{section.name}] {about}", 80, subsequent_indent="    ")
        for one in section.settings:
            yield _line(cells(one, loaded), widths)
            if explain:
                of = "one of " if isinstance(one.paper, str) else ""
                text = f"Must be {of}{one.bounds}. {one.meaning}" if one.bounds else one.meaning
                for part in filter(None, (text, _origin(one.source))):
                    yield from wrap(part, 80, initial_indent="    ", subsequent_indent="    ", break_on_hyphens=False)


def cells(one: Setting, loaded: Loaded) -> tuple[str, ...]:
    """Return a row of the table: name, value, the paper's value if it differs, unit, and the value's source."""
    source = "release" if one.is_changed else "default"
    if one.name in loaded.in_overrides:
        source = "--set"
    elif one.name in loaded.in_file:
        source = "file"
    return (one.name, shown(one.value), shown(one.paper) if one.is_changed else "", one.unit, source)


def _origin(source: Source) -> str:
    note = f": {source.note}" if source.note else ""
    page = f" (docs/{source.page})" if source.page else ""
    return f"Default ({source.name}){note}{page}."


def _line(row: Sequence[str], widths: Sequence[int]) -> str:
    return "  ".join(f"{cell:{width}}" for cell, width in zip(row, widths, strict=True)).rstrip()
