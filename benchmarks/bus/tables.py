"""The tables of the bus: measurements of codec and protection, and the closed loop on several kinds of bus."""

from pathlib import Path
from typing import Any, Final

from benchmarks.common.markdown import read, table

HEADLINES: Final = {
    "codec_times_cantools": "speed of the codec relative to cantools, at least",
    "flips_accepted": "accepted frames with one to three flipped bits",
    "random_accepted_per_million": "accepted random frames per million, E2E profile 5",
    "authenticated_forgeries_accepted": "accepted forgeries in the authenticated mode",
    "fuzz_frames": "frames in the fuzz test",
    "response_time_violations": "simulated response times above their computed bound",
    "gate_mutants": "faults planted in the command gate",
    "gate_mutants_survived": "planted faults that no test finds",
}
"""Label of each headline figure; the figures are from `results/bus.json` and from the finished studies in
`results/bus_studies.json`."""
RUNS: Final = {
    "CAN FD": "demo",
    "classic CAN": "bus_classic",
    "CAN FD, authenticated": "bus_secured",
    "CAN FD, 30 % other traffic": "bus_busy_30",
    "CAN FD, 90 % other traffic": "bus_busy_90",
}
"""Names of the results files of closed loops, by the label of the bus."""

FAULTED: Final = {
    "undisturbed": "demo",
    **{f"{late} ms late": f"bus_late_{late}" for late in (20, 40, 60)},
    **{f"{share} % lost": f"bus_loss_{share:02}" for share in (5, 10, 25, 50)},
}
"""Names of the results files of closed loops, by the disturbance of the pressures."""


def tables(results: Path) -> dict[str, str]:
    """Return the text of each table, by the table's name in the pages."""
    found = read(results / "bus.json")
    found["figures"] |= read(results / "bus_studies.json")["figures"]
    return {
        "bus": bus(found),
        "authentication": authentication(found),
        "bus_runs": bus_runs(results),
        "bus_faults": bus_faults(results),
        "attack_tools": attack_tools(results),
    }


def bus(found: Any) -> str:
    """Return the table of the headline figures."""
    rows = [(text, found["figures"][name]) for name, text in HEADLINES.items()]
    played = found["figures"]["response_time"]
    return (
        f"{table(('measured', 'figure'), rows)}\n\n"
        f"Measured on {found['date']}. Response times: {played['message_sets']} random message sets, "
        f"{played['frames']} frames;\nwith random phases at most {100 * played['largest_ratio']:.0f} % of the bound."
    )


def authentication(found: Any) -> str:
    """Return the table of the time and bandwidth that authentication costs."""
    cost = found["figures"]["authentication_cost"]
    rows = [
        (name, row["e2e_protect_us"], row["secure_us"], row["e2e_check_us"], row["verify_us"])
        for name, row in cost["messages"].items()
    ]
    heads = ("message", "E2E protection, us", "plus authentication", "E2E check, us", "plus verification")
    loads = ", ".join(f"{name} {value:.1f} %" for name, value in cost["bus_load_percent"].items())
    forged = found["figures"]["forgeries"]["forgeries"]
    accepted = found["figures"]["authenticated_forgeries_accepted"]
    return f"""{table(heads, rows)}

Largest load of the bus by the three messages: {loads}.
Of {forged["tried"]:,} forged, replayed, reflected and mutated frames {accepted} were accepted; of the
{forged["genuine"]:,} genuine frames between them {forged["genuine_refused"]} were refused."""


def attack_tools(results: Path) -> str:
    """Return the table of the information about the ECU that scapy's scanners found."""
    found = read(results / "attack_tools.json")
    figures, versions = found["figures"], found["facts"]["versions"]
    texts = {
        "isotp": "ISO-TP endpoints",
        "xcp": "XCP slaves",
        "requests": "UDS requests",
        "services": "services that answer",
        "identifiers": "identifiers that can be read",
        "seeds": "levels that give a seed",
        "unlocked": "levels unlocked",
    }
    rows = [
        (text, ", ".join(value) if isinstance(value := figures[name], list) else value) for name, text in texts.items()
    ]
    return f"{table(('found', ''), rows)}\n\nMeasured on {found['date']}, scapy {versions['scapy']}."


def bus_runs(results: Path) -> str:
    """Return the table of the closed loop on each bus."""
    rows = []
    for name, file in RUNS.items():
        figures = read(results / f"{file}.json")["figures"]
        on_bus = figures["bus"]
        waits = on_bus["longest_wait_ms"]
        rows.append(
            (
                name,
                figures["reduction_percent"],
                figures["abs_Cl_controlled"],
                f"{100 * on_bus['load']:.1f}",
                "/".join(f"{waits.get(message, 0.0):.2f}" for message in _names(waits)),
                f"{on_bus['error_frames']}",
            )
        )
    heads = ("bus", "less drag, %", "mean abs Cl", "load, %", "longest waits by message priority, ms", "error frames")
    return table(heads, rows)


def bus_faults(results: Path) -> str:
    """Return the table of the closed loop with late and with lost pressures."""
    rows = []
    for name, file in FAULTED.items():
        figures = read(results / f"{file}.json")["figures"]
        held = f"{figures['periods_in_control']} of {figures['periods_requested']}"
        fault = figures["fault"]
        rows.append(
            (
                name,
                figures["reduction_percent"],
                figures["abs_Cl_controlled"],
                held if fault is None else f"{held}, {fault['reason']}",
            )
        )
    return table(("pressures", "less drag, %", "mean abs Cl", "periods in control"), rows)


def _names(waits: dict[str, float]) -> list[str]:
    """Return the names of the messages in the order of their priority, from any message set; runs of earlier versions
    have no speed message."""
    return sorted(waits, key=lambda name: ("Pressure", "VehicleSpeed", "JetCommand", "EcuStatus").index(_base(name)))


def _base(name: str) -> str:
    return name.removesuffix("Classic").removesuffix("Secured")
