"""The sources that make an FMU of the ECU in C."""

from importlib.resources import files


def fmu_sources() -> dict[str, bytes]:
    """By their names. Generated for a release: `sw_fmu_settings.h` (`firmware_sim.fmu.ecu_variables`)."""
    root = files("export.to_c").joinpath("sources/fmu")
    return {item.name: item.read_bytes() for item in root.iterdir() if item.name.endswith((".c", ".h"))}
