"""The tables of the controller: other runtimes, times of its implementations, emulated cores."""

from typing import Any

from benchmarks.common.documents import table


def runtimes(found: Any) -> str:
    """Return the table of the largest differences between other runtimes of ONNX and ONNX Runtime."""
    names = ("runtime", "version", "plan", "forces", "cost")
    heads = ("runtime", "version", "actions, U_inf W", "forces", "cost")
    return table(heads, [tuple(row[name] for name in names) for row in found["figures"]])


def latency(found: Any) -> str:
    """Return the table of the times and sizes of all implementations."""
    figures, facts = found["figures"], found["facts"]
    rows = []
    for label, key, size in (
        ("eager PyTorch", "eager_ms", None),
        ("ONNX float32", "onnx_ms", "onnx_bytes"),
        ("ONNX int8 weights", "onnx_int8_ms", "onnx_int8_bytes"),
        ("C float32", "c_ms", None),
        ("C int8, integer products", "c_int8_ms", None),
    ):
        faster = (of["eager_ms"] / of[key] for of in (figures, figures["min"]))
        rows.append((label, figures[key], figures["min"][key], *faster, size and figures[size] / 1024))
    heads = ("", "median ms", "least ms", "speed relative to PyTorch, median", "least", "KiB")
    workspace = " and ".join(f"{figures[f'{name}_workspace_bytes'] / 1024:.0f}" for name in ("c", "c_int8")) + " KiB"
    return f"""{table(heads, rows)}

The C library, compiled with `{facts["settings"]["c_flags"]}` by
{facts["versions"]["c_compiler"]}, needs a workspace of {workspace} (float32 and int8)."""


def mcu(found: Any) -> str:
    """Return the tables of work, memory and time on the emulated cores, with a row for each size of the networks."""
    figures, horizon = found["figures"], found["facts"]["horizon"]
    return f"""Measured on {found["date"]}: only the control step, random weights, a horizon of {horizon} steps.

Cortex-M7:

{_sizes(figures["sizes"], ("480", "300"))}

Cortex-M4F:

{_sizes(figures["cortex_m4f"], ("170",))}"""


def _sizes(sizes: list[dict[str, Any]], clocks: tuple[str, ...]) -> str:
    rows = []
    for row in sizes:
        name = f"{row['dynamics_width']}/{row['decoder_width']}, {row['iterations']}, {row['precision']}"
        memory = (row["flash_bytes"] / 1024, row["ram_bytes"] / 1024, row["stack_bytes"])
        times = (row["modelled_ms"][clock] for clock in clocks)
        work = (row["multiply_accumulates"] / 1e6, *memory, row["instructions"] / 1e6, *times)
        rows.append((name, *work, "yes" if row["identical"] else "no"))
    heads = ("dynamics/decoder width, iterations, weights", "M MAC", "flash, KiB", "RAM, KiB", "stack, B", "M instr.")
    return table((*heads, *(f"ms at {clock} MHz, modelled" for clock in clocks), "equal to host bit for bit"), rows)


def mcu_release(found: Any) -> str:
    """Return the table of the shipped release's whole ECU on the emulated Cortex-M7."""
    row, facts = found["figures"]["release"], found["facts"]
    step, mean, worst = row["control_step"], row["mean_ms"], row["worst_ms"]
    ram, spread = f"{row['ram_bytes'] / 1024:.1f} KiB", f"{row['instruction_spread']:,}"
    alike = f"{step['windows'] - step['unlike']:,} windows take the same number"
    rows = [
        (f"control period at {clock} MHz, modelled", f"mean {mean[clock]:.2f} ms, longest {worst[clock]:.2f} ms")
        for clock in mean
    ]
    rows += [
        ("instructions of the longest period", f"{row['instructions']:,}"),
        ("flash: code, weights, tables", f"{row['flash_bytes'] / 1024:.1f} KiB"),
        ("RAM: state, workspace, weights of the dynamics, received frames, stack", ram),
        ("deepest stack", f"{row['stack_b']} B"),
        ("difference in instructions between the longest and the shortest period, the release's goal", spread),
        (
            f"control step alone, over {step['windows']:,} recorded and random windows",
            f"{step['fewest']:,} to {step['most']:,} instructions; {alike}",
        ),
    ]
    return table((f"{row['bundle']}, whole firmware of a board, horizon of {facts['horizon']} steps", ""), rows)


def mcu_worst(found: Any) -> str:
    """Return the table of the longest control periods in ms of the drives, and of the bound, without and with a key."""
    row = found["figures"]["release"]
    secured = row["secured"]
    frames = f" ({row['frames']} frames, with a key {secured['frames']})"
    keys = (("mean, the release's own goal", "mean_ms"), ("**bound: longest time of every block**", "bound_ms"))
    mean, bound = ((label, *_ms(row[key]), *_ms(secured[key])) for label, key in keys)
    drives = [
        (name + (frames if name == "full bus" else ""), *_ms(drive), *_ms(secured["drives_ms"].get(name, {})))
        for name, drive in row["drives_ms"].items()
    ]
    rows = [mean, *drives, bound]
    clocks = [f"{clock} MHz" for clock in row["mean_ms"]]
    heads = ("longest control period, ms", *clocks, *(f"with a key, {clock}" for clock in clocks))
    return table(heads, [(*row, *[""] * (len(heads) - len(row))) for row in rows])


def _ms(times: dict[str, float]) -> list[str]:
    return [f"{time:.2f}" for time in times.values()]


def bounds(found: Any) -> str:
    """Return the table of the firmware's loops, calls and stack as GCC reports them."""
    row, alone = found["figures"], found["figures"]["alone"]
    kinds = [row[name] for name in ("proved", "reasoned", "waits")]
    loops = f"{sum(kinds)}: {', '.join(map(str, kinds))}"
    stack = f"{alone['stack_b']:,} B, {alone['measured_stack_b']:,} B"
    times = f"{alone['worst_ms']['480']:.2f} ms, {alone['bound_ms']['480']:.2f} ms"
    rows = [
        ("functions; functions called through pointers", f"{row['functions']}; {row['pointed_at']}"),
        ("recursions", 0),
        ("loops: bounded by GCC's proof, bounded by a stated reason, waiting for hardware", loops),
        ("deepest stack by analysis, including an exception", f"{row['stack_b']:,} B"),
        ("stack without loader and key: by analysis, on the emulated board", stack),
        ("without loader and key, at 480 MHz: longest period, bound", times),
    ]
    return table(("fullest firmware: loader, diagnosis, calibration, key of the bus", found["facts"]["compiler"]), rows)


def steps(found: Any) -> str:
    """Return the table of the computing time of a time step, for each mesh and precision."""
    names = ("cpu_s_per_t_c", "forced_cpu_s_per_t_c", "ns_per_cell_and_step", "floor_sweeps_ns", "floor_transforms_ns")
    rows = []
    for row in found["figures"]:
        poisson = f"{100 * row['shares']['Poisson']:.0f}"
        rows.append((f"{row['cells']:,}, {row['precision']}", *(row[name] for name in names), poisson))
    heads = (
        "cells", "CPU s per t_c", "at full amplitude", "ns per cell and step", "floor: memory", "floor: transforms",
        "Poisson, %",
    )  # fmt: skip
    return table(heads, rows)
