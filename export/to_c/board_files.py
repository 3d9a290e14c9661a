"""The firmware of a board around the ECU: drivers, start, main loop and linker script, the same for every program."""

from importlib.resources import files

from export.to_c.loader_files import loader_sources


def board_sources(*, loader: bool = False) -> dict[str, bytes]:
    """Its files by name, to be compiled with a library's; with the loader, which `sw_board_equipment.h` switches on."""
    board = files("export.to_c").joinpath("sources/board")
    own = {item.name: item.read_bytes() for item in board.iterdir() if item.name.endswith((".c", ".h", ".ld"))}
    others = loader_sources()
    return (others if loader else {"sw_flash.h": others["sw_flash.h"]}) | own
