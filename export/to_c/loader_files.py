"""The loader in C: storage of releases on flash, and diagnosis; the same for every program and vehicle."""

from importlib.resources import files


def loader_sources() -> dict[str, bytes]:
    """Its files by name, to be compiled with a library's; Monocypher's sources are included, not compiled."""
    root = files("export.to_c").joinpath("sources/loader")
    own = {item.name: item.read_bytes() for item in root.iterdir() if item.name.endswith((".c", ".h"))}
    foreign = {
        item.name: item.read_bytes() for item in root.joinpath("vendor").iterdir() if item.name[-2:] in (".c", ".h")
    }
    return own | {name.replace(".c", "_c.h"): content for name, content in foreign.items()}
