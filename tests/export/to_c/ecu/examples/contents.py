"""What the examples are compiled from."""


def without(folder: dict[str, bytes], *names: str) -> dict[str, bytes]:
    return {name: text for name, text in folder.items() if name not in names}
