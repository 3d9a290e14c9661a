"""A run as one self-contained HTML page: table, time series, wake before and after, settings."""

import base64
import html
import io
import math
from pathlib import Path
from typing import Any, Final

import matplotlib as mpl
import matplotlib.image
import numpy as np
from matplotlib.figure import Figure

from can_bridge.wire.messages import Mode
from contract.atomic import replacing
from contract.errors import StillwakeError
from firmware_sim.bench.closed_loop import AFTER, BEFORE, SERIES
from firmware_sim.runs import run_log
from firmware_sim.runs.run_log import RunLog
from firmware_sim.runs.statistics import latency, reduction_percent, regimes

REPORT: Final = "report.html"

_STYLE: Final = """
body { font: 16px/1.5 system-ui, sans-serif; max-width: 62rem; margin: 2rem auto; padding: 0 1rem; color: #1b2530; }
h1 { margin-bottom: 0; } h2 { margin-top: 2rem; } .note { color: #56616d; }
table { border-collapse: collapse; margin: 1rem 0; } th, td { padding: .3rem .9rem; border-bottom: 1px solid #d9dee3; }
th { text-align: left; font-weight: 600; } td { text-align: right; font-variant-numeric: tabular-nums; }
img { max-width: 100%; } pre { background: #f4f6f8; padding: .8rem; overflow-x: auto; font-size: 13px; }
"""


def write_report(folder: Path) -> Path:
    """Write `report.html` into a run folder and return its path.

    Raises:
        StillwakeError: if the folder does not hold a run, or cannot be written.
    """
    log, pictures = _read(folder)
    page = folder / REPORT
    with replacing(page) as temporary:
        temporary.write_text(_page(log, pictures), encoding="utf-8")
    return page


def write_picture(folder: Path, target: Path) -> None:
    """Write the run as one picture: the wake before and under control, drag and action over time.

    Raises:
        StillwakeError: if the folder does not hold a run, or the target cannot be written.
    """
    log, pictures = _read(folder)
    s, t = log.series, log.series["t"]
    figure = Figure(figsize=(10.0, 9.4), dpi=100, layout="constrained")
    axes = figure.subplots(4, 1, height_ratios=(3.1, 3.1, 1.6, 1.6))
    for axis, picture in zip(axes, pictures, strict=False):
        axis.imshow(mpl.image.imread(io.BytesIO(picture), format="png"))
        axis.set_axis_off()
    for axis, name, label in zip(axes[2:], ("Cd", "action"), ("$C_d$ (wall)", r"action / $U_\infty W$"), strict=True):
        axis.plot(t, s[name], color="black" if name == "Cd" else "tab:orange", linewidth=1.1)
        axis.axvline(t[log.enabled_at], color="0.4", linewidth=1.0, linestyle=":")
        axis.set_ylabel(label)
        axis.grid(alpha=0.25)
    axes[-1].set_xlabel(r"$t U_\infty / W$   (dotted: control requested)")
    with replacing(target) as temporary:
        figure.savefig(temporary, format="png")


def _read(folder: Path) -> tuple[RunLog, list[bytes]]:
    """The series and the pictures before and under control."""
    log = run_log.load(folder / SERIES)
    try:
        return log, [(folder / name).read_bytes() for name in (BEFORE, AFTER)]
    except OSError as error:
        raise StillwakeError(f"{error.filename}: {error.strerror}") from error


def drag_rows(log: RunLog) -> list[tuple[str, str, str]]:
    """(quantity, uncontrolled, controlled), formatted: the same table on the page and in the terminal."""
    before, under = regimes(log, log.facts["settle"])
    lines = (
        ("mean Cd (wall)", "Cd", ".4f"),
        ("std of Cd", "Cd_std", ".4f"),
        ("mean base Cp", "base_Cp", "+.4f"),
        ("mean |Cl|", "abs_Cl", ".3f"),
        ("mean Cl", "mean_Cl", "+.3f"),
        ("rms action / U_inf W", "rms_action", ".4f"),
        ("mean Cd, wall + slots + jet momentum", "Cd_net", ".4f"),
        ("mean jet power / (rho U_inf^3 W / 2)", "jet_power", ".4f"),
        ("std of Uy at (10, 0)", "Uy_std", ".3f"),
    )
    return [
        (label, f"{getattr(before, name):{style}}", f"{getattr(under, name):{style}}") for label, name, style in lines
    ]


def service_rows(log: RunLog) -> list[tuple[str, str]]:
    """(quantity, value), formatted: what happened on the bus and in the ECU."""
    timing = latency(log)
    ages = [age for age in log.series["age_ms"] if not math.isnan(age)]
    measured = f"{timing.p50:.2f} / {timing.p99:.2f} / {timing.max:.2f} ms" if timing.steps else "no control step ran"
    return [
        ("plant", log.facts.get("plant", "stillwake")),
        ("control step computed by", log.facts.get("computed_by", "ONNX Runtime")),
        ("control step, wall clock p50 / p99 / max", measured),
        ("budget", f"{log.facts['budget_ms']:.0f} ms"),
        ("sample to jets in virtual time, max", f"{max(ages):.2f} ms" if ages else "no command arrived"),
        ("frames sent", str(log.bus.sent)),
        ("frames lost", str(log.bus.lost)),
        ("frames rejected", str(log.bus.rejected)),
        ("periods in control / in all", f"{timing.steps} / {len(log.series['t'])}"),
    ]


def headline(log: RunLog) -> str:
    """One sentence: the reduction, and whether it counts."""
    before, under = regimes(log, log.facts["settle"])
    percent = reduction_percent(before, under)
    if math.isnan(percent):
        return "The run is too short for controlled averages."
    text = f"Wall drag {before.Cd:.3f} to {under.Cd:.3f}: {abs(percent):.1f} % {'more' if percent < 0 else 'less'}"
    # A two-dimensional wake can be bent sideways to trade drag for lift; such a reduction does not count.
    if under.abs_Cl > before.abs_Cl or abs(under.mean_Cl) > 0.1 * before.abs_Cl + 0.1:
        return f"{text}, but the wake is deflected: mean |Cl| {under.abs_Cl:.2f}, mean Cl {under.mean_Cl:+.2f}."
    return f"{text}, side force down (mean |Cl| {before.abs_Cl:.2f} to {under.abs_Cl:.2f})."


def _page(log: RunLog, pictures: list[bytes]) -> str:
    before, under = (_embed(picture) for picture in pictures)
    facts = log.facts
    signed = f"signed by key {facts['signer']}" if facts.get("signer") else "unsigned"
    drag = "".join(f"<tr><th>{html.escape(a)}</th><td>{b}</td><td>{c}</td></tr>" for a, b, c in drag_rows(log))
    service = "".join(f"<tr><th>{html.escape(a)}</th><td>{b}</td></tr>" for a, b in service_rows(log))
    return f"""<!doctype html>
<html lang="en"><head><meta charset="utf-8"><title>stillwake run</title><style>{_STYLE}</style></head><body>
<h1>Closed loop over CAN</h1>
<p class="note">{html.escape(facts["controller"])}, {signed}, sensors
{html.escape(", ".join(facts["sensors"]))}</p>
<p><strong>{html.escape(headline(log))}</strong></p>
<table><tr><th></th><th>uncontrolled</th><th>controlled</th></tr>{drag}</table>
<p class="note">Uncontrolled: everything before control was requested. Controlled: from {facts["settle"]:g}
convective times after that to the end. Two-dimensional flow at Re = {facts["config"]["flow"]["reynolds"]:g}:
the method's test bed, not a truck on a road.</p>
<h2>Time series</h2><img alt="time series" src="{_embed(_png(series_figure(log)))}">
<h2>The wake</h2>
<img alt="vorticity before control" src="{before}"><img alt="vorticity under control" src="{under}">
<h2>Bus and ECU</h2><table>{service}</table>
<p class="note">Virtual time charges {facts["config"]["ecu"]["compute_time_ms"]:g} ms for a control step whatever
this machine took; frame times are worst cases at {facts["config"]["bus"]["nominal_bitrate"] / 1e3:g} kbit/s and
{facts["config"]["bus"]["data_bitrate"] / 1e6:g} Mbit/s.</p>
<h2>Settings</h2><pre>{html.escape(_settings(facts))}</pre>
</body></html>
"""


def series_figure(log: RunLog) -> Figure:
    """Drag, lift, base pressure, action and latency over time."""
    s, t = log.series, log.series["t"]
    figure = Figure(figsize=(10.0, 10.5), dpi=110, layout="constrained")
    axes = figure.subplots(5, 1, sharex=True)
    axes[0].plot(t, s["Cd"], color="black", linewidth=1.1, label="flow")
    # A forecast made at t_k is for t_{k+1}.
    axes[0].plot(t[1:], s["predicted_Cd"][:-1], color="tab:blue", linewidth=0.9, alpha=0.8, label="one step ahead")
    axes[1].plot(t, s["Cl"], color="black", linewidth=1.1)
    axes[1].plot(t[1:], s["predicted_Cl"][:-1], color="tab:blue", linewidth=0.9, alpha=0.8)
    axes[2].plot(t, s["base_Cp"], color="tab:green", linewidth=1.1)
    axes[3].plot(t, s["action"], color="tab:orange", linewidth=1.1)
    planned = s["mode"] == Mode.CONTROL
    slowest = np.nanmax(s["step_ms"][planned], initial=log.facts["budget_ms"])
    axes[4].plot(t[planned], s["step_ms"][planned], ".", color="tab:purple", markersize=2.5)
    axes[4].axhline(log.facts["budget_ms"], color="tab:red", linewidth=1.0, linestyle="--")
    axes[4].text(t[0], log.facts["budget_ms"], " budget", color="tab:red", va="top", fontsize=9)
    axes[4].set_ylim(0.0, 1.1 * slowest)
    labels = ("$C_d$ (wall)", "$C_l$", "base $C_p$", r"action / $U_\infty W$", "control step / ms")
    for axis, label in zip(axes, labels, strict=True):
        axis.set_ylabel(label)
        axis.grid(alpha=0.25)
        if log.enabled_at < len(t):
            axis.axvline(t[log.enabled_at], color="0.4", linewidth=1.0, linestyle=":")
            axis.axvspan(t[log.enabled_at], t[log.enabled_at] + log.facts["settle"], color="0.93", zorder=0)
    axes[0].legend(loc="upper right", ncols=2, frameon=False)
    axes[-1].set_xlabel(r"$t U_\infty / W$   (grey: settling, left out of the averages)")
    figure.align_ylabels()
    return figure


def _settings(facts: Any) -> str:
    lines = [f"{name}: {value}" for name, value in facts["mpc"].items() if name != "weights"]
    lines += [f"weight {name}: {value}" for name, value in facts["mpc"]["weights"].items()]
    lines += [f"ecu {name}: {value}" for name, value in facts["config"]["ecu"].items()]
    lines += [f"{name} {value}" for name, value in facts["versions"].items()]
    return "\n".join(lines)


def _png(figure: Figure) -> bytes:
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png")
    return buffer.getvalue()


def _embed(png: bytes) -> str:
    return "data:image/png;base64," + base64.b64encode(png).decode("ascii")
