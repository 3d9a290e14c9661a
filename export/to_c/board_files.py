"""The firmware of a board around the ECU: drivers, start, main loop and linker script, the same for every program."""

from importlib.resources import files


def board_sources() -> dict[str, bytes]:
    """Its files by name, to be compiled with a library's."""
    root = files("export.to_c").joinpath("sources")
    found = [*root.joinpath("board").iterdir(), root.joinpath("loader/sw_flash.h")]
    return {item.name: item.read_bytes() for item in found if item.name.endswith((".c", ".h", ".ld"))}
