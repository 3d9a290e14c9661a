"""The tables of the bus: codec and protection, response times, the loop's latency, and the loop on several buses."""

from typing import Any, Final

from benchmarks.common.documents import table
from firmware_sim.latency.measured import LABELS
from firmware_sim.latency.stages import Stage

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
"""Labels of the headline figures in `results/bus.json` and, for finished studies, in `results/bus_studies.json`."""
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
CAN_LOADS: Final = [f"can_load_{frames}{end}" for frames in ("fd", "classic") for end in ("", "_90")]
"""Names of the results files of bus loads, for each message set without and with other traffic."""
CONTROLLERS: Final = {"onnx": "ONNX Runtime", "c": "C library"}
QUANTILES: Final = {"p50_ms": "p50", "p99_ms": "p99", "p99_9_ms": "p99.9", "max_ms": "max"}


def bus(found: Any, studies: Any) -> str:
    """Return the table of the headline figures."""
    figures = found["figures"] | studies["figures"]
    rows = [(text, figures[name]) for name, text in HEADLINES.items()]
    played, version = figures["response_time"], studies["facts"]["versions"]["stillwake"]
    return (
        f"{table(('measured', 'figure'), rows)}\n\nMeasured on {found['date']}; codec, flipped bits, random frames and "
        f"response times with {version}: {played['message_sets']} random\nmessage sets, {played['frames']} frames; "
        f"with random phases the times reached at most {100 * played['largest_ratio']:.0f} % of the bound."
    )


def authentication(found: Any, studies: Any) -> str:
    """Return the table of the time and bandwidth that authentication costs."""
    figures = found["figures"] | studies["figures"]
    cost, forged = figures["authentication_cost"], figures["forgeries"]["forgeries"]
    rows = [
        (name, row["e2e_protect_us"], row["secure_us"], row["e2e_check_us"], row["verify_us"])
        for name, row in cost["messages"].items()
    ]
    heads = ("message", "E2E protection, us", "plus authentication", "E2E check, us", "plus verification")
    loads = ", ".join(f"{name} {value:.1f} %" for name, value in cost["bus_load_percent"].items())
    accepted = figures["authenticated_forgeries_accepted"]
    return f"""{table(heads, rows)}

Largest load of the bus by the three messages: {loads}.
On {found["date"]}, of {forged["tried"]:,} forged, replayed, reflected and mutated frames {accepted} were accepted; of
the {forged["genuine"]:,} genuine frames between them {forged["genuine_refused"]} were refused."""


def bus_runs(*runs: Any) -> str:
    """Return the table of the closed loop on each bus, from the results of `RUNS`."""
    rows = []
    for name, run in zip(RUNS, runs, strict=True):
        figures, on_bus = run["figures"], run["figures"]["bus"]
        waits = on_bus["longest_wait_ms"]
        longest = "/".join(f"{waits[message]:.2f}" for message in sorted(waits, key=_priority))
        less, lift = figures["reduction_percent"], figures["abs_Cl_controlled"]
        rows.append((name, less, lift, f"{100 * on_bus['load']:.1f}", longest, on_bus["error_frames"]))
    heads = ("bus", "less drag, %", "mean abs Cl", "load, %", "longest waits by message priority, ms", "error frames")
    return table(heads, rows)


def bus_faults(*runs: Any) -> str:
    """Return the table of the closed loop with late or lost pressures, from the results of `FAULTED`."""
    rows = []
    for name, run in zip(FAULTED, runs, strict=True):
        figures, fault = run["figures"], run["figures"]["fault"]
        held = f"{figures['periods_in_control']} of {figures['periods_requested']}"
        ended = held if fault is None else f"{held}, {fault['reason']}"
        rows.append((name, figures["reduction_percent"], figures["abs_Cl_controlled"], ended))
    return table(("pressures", "less drag, %", "mean abs Cl", "periods in control"), rows)


def _priority(name: str) -> int:
    """Return a message's place in the order of priorities, which is the same in all message sets."""
    base = name.removesuffix("Classic").removesuffix("Secured")
    return ("Pressure", "VehicleSpeed", "JetCommand", "EcuStatus").index(base)


def can_load(*found: Any) -> str:
    """Return the table of the project's messages, with the total load of the bus, from the results of `CAN_LOADS`."""
    rows, lines = [], []
    for name, alone, loaded in zip(("CAN FD", "classic CAN"), found[::2], found[1::2], strict=True):
        ours, others = ([one for one in of["figures"]["messages"] if one["ours"]] for of in (alone, loaded))
        for message in ours:
            (crowded,) = (one for one in others if one["name"] == message["name"])
            alone_s = (message[key] for key in ("name", "bytes", "frame_worst_ms", "response_ms"))
            in_time = "yes" if crowded["in_time"] else "no"
            rows.append((*alone_s, crowded["response_ms"], message["deadline_ms"], in_time))
        lines.append(
            f"Load of the bus, {name}: {_load(alone)}; with {len(loaded['figures']['messages']) - len(others)} other "
            f"messages {_load(loaded)}."
        )
    heads = ("message", "bytes", "frame, ms", "response, ms", "with other traffic, ms", "deadline, ms", "in time")
    return table(heads, rows) + "\n\n" + "\n".join(lines)


def _load(result: Any) -> str:
    figures = result["figures"]
    return f"{100 * figures['load_mean']:.1f} % ({100 * figures['load_worst']:.1f} % at worst)"


def latency(found: Any) -> str:
    """Return the table of the stages and of the idle loop, with the numbers of late commands below the table."""
    runs = [found["figures"][name] for name in CONTROLLERS]
    rows = []
    for stage in Stage:
        pairs = ((run["stages"][stage], run["misses"] if stage is Stage.ALL else "") for run in runs)
        rows.append((LABELS[stage], *(cell for pair in pairs for cell in _cells(*pair))))
    baselines = [run["baseline"] for run in runs]
    rows.append(("idle loop in the same run", *(cell for row in baselines for cell in _cells(row, row["misses"]))))
    lines = [
        f"{label}: {run['misses']} of {run['periods']} commands were late; {run['periods_planned']} "
        f"periods had a plan. In {run['baseline']['misses']} periods the idle loop was late by at least the slack of "
        f"{run['slack_ms']:.1f} ms.\n"
        for label, run in zip(CONTROLLERS.values(), runs, strict=True)
    ]
    release = runs[0]["about"].split()[0]
    about = (
        f"Times in ms; the left columns are for ONNX Runtime, the right columns for the C library. Measured on "
        f"{found['date']} with {release}, {found['facts']['machine']}."
    )
    heads = ("", *((*QUANTILES.values(), "misses") * 2))
    return "\n".join((about, "", table(heads, rows), "", *lines)).rstrip("\n")


def _cells(row: Any, misses: int | str) -> tuple[str, ...]:
    times = (("never" if row[name] is None else f"{row[name]:.2f}") for name in QUANTILES)
    return (*times, str(misses))
