"""What a board gets at production, compiled into its firmware: `sw_board_equipment.h`."""

from contract.release.signing import PublicKey


def equipment_header(root: PublicKey, access_key: bytes, vehicle: bytes, hardware: str, serial: str) -> bytes:
    """The header that switches the loader on.

    Args:
        root: signs key lists.
        access_key: of security access, 16 bytes.
        vehicle: `contract.release.controller_image.ImageFacts.vehicle` of every image that fits.
        hardware, serial: of the board; printable ASCII without quotes.
    """
    numbers = {"ROOT": root.raw, "ACCESS_KEY": access_key, "VEHICLE": vehicle}
    found = {name: "{" + ", ".join(map(str, value)) + "}" for name, value in numbers.items()} | {
        "LOADER": "1", "HARDWARE": f'"{hardware}"', "SERIAL": f'"{serial}"', "SOFTWARE": '"board"',
    }  # fmt: skip
    return "".join(f"#define SW_BOARD_{name} {value}\n" for name, value in found.items()).encode()
