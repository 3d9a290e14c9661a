"""Whether a control step fits into a control period on the core, clock by clock, by the model of its pipeline."""

from collections.abc import Iterator, Mapping


def verdicts(modelled_ms: Mapping[str, float], period: float) -> Iterator[tuple[str, str]]:
    """(what, verdict) for people, one a clock.

    Args:
        modelled_ms: of a control step, by clock in MHz (`firmware_sim.mcu.measure.Measurement.modelled_ms`).
        period: the control period, ms.
    """
    yield "control period", f"{period:g} ms (from the settings; the library does not hold it)"
    for clock, needed in modelled_ms.items():
        share = needed / period
        if share <= 1.0:
            yield f"at {clock} MHz, by the model", f"fits: {100.0 * share:.0f} % of the period"
        else:
            yield f"at {clock} MHz, by the model", f"DOES NOT FIT: {share:.1f} times the period"
