"""What no wall, balance or logger gives is named with its cause; what real ones give is passed over."""

import re
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from contract.recording.dataset import Dataset, Episode
from contract.recording.episode import PlantFacts
from contract.recording.plausible import dominant_frequency, implausible, share_near
from contract.sensor_layout import SensorLayout
from tests.oscillating_wake import FILES, LIMIT, NAMES, PERIOD, POSITIONS, Array, series

Series = dict[str, Array]
ALL = tuple(FILES)
FACTS = PlantFacts(control_period=PERIOD, action_limit=LIMIT)
LAYOUT = SensorLayout.of(NAMES, np.array(POSITIONS), base=[2, 3], symmetric=True)
STEPS = np.arange(300)


def made(change: Callable[[Series], Series], files: tuple[str, ...] = ALL, layout: SensorLayout = LAYOUT) -> Dataset:
    """The data set with some of its files changed."""
    episodes = []
    for name, how in FILES.items():
        values = series(*how)
        values |= change(values) if name in files else {}
        role = "test" if name == "held_out" else "train"
        episodes.append(Episode(name=name, role=role, series=values, initial_action=0.0, provenance={}))  # type: ignore[arg-type]
    return Dataset(episodes=tuple(episodes), layout=layout, facts=FACTS)


def sensor(k: int, change: Callable[[Array], Array]) -> Callable[[Series], Series]:
    return lambda d: {"Cp": np.column_stack([change(c) if i == k else c for i, c in enumerate(d["Cp"].T)])}


def scaled(**by: float) -> Callable[[Series], Series]:
    return lambda d: {name: factor * d[name] for name, factor in by.items()}


def repeated(times: int) -> Callable[[Series], Series]:
    return lambda d: {name: d[name][STEPS // times] for name in ("Cp", "Cd", "Cl", "action")}


WRONG: list[tuple[Callable[[Series], Series], tuple[str, ...], str]] = [
    (scaled(Cd=-1), ALL, r"sweep: mean Cd is -1\.34; .*calm: .*drag above 0, .*--reference Cd=-1"),
    (scaled(Cd=-1), ("calm",), r"^episode calm: mean Cd is -1\.35: "),
    (scaled(Cp=75), ALL, r"Cp of p1, p2, p3 and p4 is -30\.1 in the mean, from -65\.\d to .*in Pa.*--reference Cp"),
    (scaled(Cp=10), ALL, r"from -8\.\d+ to .*--reference Cp"),
    (lambda d: {"Cp": 101.3 + 0.4 * d["Cp"]}, ALL, r"is 101 in the mean.*against p_inf"),
    (sensor(1, lambda p: 375 * p), ALL, r"Cp of p2 is -150 in the mean.*--reference p2=375Pa"),
    (sensor(1, lambda p: p / 1000), ALL, r"Cp of p2 is less than a hundredth"),
    (scaled(Cp=1 / 375), ALL, r"all Cp are within 0\.0023.*no --reference Cp"),
    (scaled(Cd=40, Cl=40), ALL, r"mean Cd is 53\.6; .*forces in N, .*--reference Cd=40N"),
    (scaled(Cd=-40), ALL, r"^episode sweep: mean Cd is -53\.6; .*above 0, .*--reference Cd=-40N$"),
    (scaled(Cl=40), ALL, r"the deviation of Cl is 22\.5; .*--reference Cl=40N"),
    (scaled(Cd=0.01), ALL, r"mean Cd is 0\.0134; .*has 0\.02 or more"),
    (lambda d: {"Cd": d["Cl"], "Cl": d["Cd"]}, ALL, r"mean Cl is 1\.34 and mean Cd 0\.0036.*--map Cd=Cl --map Cl=Cd"),
    (scaled(Cp=4), ("held_out",), r"^rms Cp is 1\.86 in held_out and 0\.46\d in sweep, a factor of 4\.0\d"),
    (scaled(Cd=3.5), ("calm",), r"^mean Cd is 4\.72 in calm and 1\.34 in sweep, a factor of 3\.5\d"),
    (scaled(Cl=12), ("held_out",), r"^the deviation of Cl divided by that of Cp is 29\.4 in held_out"),
    (sensor(1, lambda p: np.where((STEPS > 50) & (STEPS < 250), p[50], p)), ALL, r"p2 is constant at -0\.7\d+ for 20"),
    (sensor(1, lambda p: np.full(300, -0.37)), ("held_out",), r"p2 is constant at -0\.37 for 300 of 300"),
    (sensor(1, lambda p: p[STEPS // 3 * 3]), ALL, r"p2 is constant in 67% of the rows, while the other sensors"),
    (lambda d: {"Cl": np.where((STEPS > 50) & (STEPS < 100), d["Cl"][50], d["Cl"])}, ALL, r"Cl is constant at 0\.6"),
    (sensor(2, lambda p: np.where(STEPS >= 100, 99.99, p)), ALL, r"99\.99 occurs 200 times .* step 100 in p3"),
    (sensor(2, lambda p: np.full(300, 99.99)), ("calm",), r"p3 is constant at 99\.99 for 300 of"),
    (sensor(2, lambda p: np.where(STEPS % 90 == 7, -9.99, p)), ALL, r"-9\.99 occurs in 4 rows, first at step 7, in p3"),
    (sensor(2, lambda p: np.where(STEPS == 77, 55.0, p)), ALL, r"55 occurs at step 77 in p3"),
    (sensor(0, lambda p: np.minimum(p, -0.1)), ALL, r"p1 is at its largest value, -0\.1, in 64 of 300 .*saturated"),
    (sensor(0, lambda p: np.maximum(p, -0.7)), ("sweep",), r"p1 is at its smallest value, -0\.7, in 64 of 300"),
    (lambda d: {"Cp": d["Cp"][:, [0, 0, 2, 3]]}, ALL, r"p1 and p2 are equal in every row"),
    (repeated(2), ALL, r"every row occurs 2 times, 150 of 300 .*keep one of 2"),
    (repeated(3), ("calm",), r"^episode calm: every row occurs 3 times, 200 of 300"),
]  # fmt: skip


@pytest.mark.slow  # a data set a row
def test_what_cannot_be_is_named_with_its_cause():
    for change, files, text in WRONG:
        found = list(implausible(made(change, files)))
        assert any(re.search(text, line) for line in found), (text, found)
        assert all("\n" not in line for line in found)
    # Minus 99 in all columns is one thing; without mirror images, drag that changes its sign speaks for the exchange.
    gap = (STEPS >= 50) & (STEPS < 56)
    (line,) = implausible(
        made(lambda d: {"Cp": np.where(gap[:, None], -99, d["Cp"]), "Cd": np.where(gap, -99, d["Cd"])})
    )
    assert line.startswith("episode sweep: -99 occurs 6 times in a row from step 50 in p1, p2, p3, p4 and Cd, far from")
    alone = SensorLayout.of(NAMES, np.array(POSITIONS), base=[], symmetric=False)
    (line,) = implausible(made(lambda d: {"Cd": d["Cl"], "Cl": d["Cd"]}, ALL, alone))
    assert "seem exchanged" in line


@pytest.mark.slow  # a data set a row
def test_what_real_walls_and_loggers_give_is_passed_over():
    noise = np.random.default_rng(9).standard_normal((4, 300))
    rest = np.exp(np.minimum(0.0, 0.1 * (STEPS - 240)))

    def at_rest(d: Series) -> Series:
        """Begun at the steady wake, which grows at last, stored in steps of 2^-13."""
        grown = {"Cp": -0.4 + rest[:, None] * (d["Cp"] + 0.4), "Cd": 1.2 + rest * (d["Cd"] - 1.2), "Cl": rest * d["Cl"]}
        return {name: np.round(values * 2**13) / 2**13 for name, values in grown.items()} | {"action": 0 * rest}

    for change in (
        lambda d: {},
        sensor(0, lambda p: 1.0 + 0.1 * noise[0]),  # at the stagnation point, in gusts
        sensor(0, lambda p: -5.0 + 0.3 * noise[0]),  # at a suction peak
        lambda d: {"Cp": d["Cp"] + 0.2 * noise.T, "Cd": d["Cd"] + 0.8 * noise[1]},
        lambda d: {"Cp": np.round(d["Cp"] / 0.02) * 0.02, "Cl": np.round(d["Cl"] / 0.02) * 0.02},  # eight bits
        at_rest,
    ):
        for files in (ALL, ("calm",)):
            assert list(implausible(made(change, files))) == []
    # A blown jet lifts a symmetric body, and a wing lifts more than it drags.
    assert list(implausible(made(lambda d: {"action": np.full(300, 0.1), "Cl": d["Cl"] + 2.0}))) == []
    wing = SensorLayout.of(NAMES, np.array(POSITIONS), base=[], symmetric=False)
    assert list(implausible(made(lambda d: {"Cl": d["Cl"] + 2.0}, ALL, wing))) == []


def test_rows_of_another_file_are_found_and_a_wake_that_repeats_itself_is_none():
    sound = made(lambda d: {})
    sweep, calm, test = sound.episodes

    def part(rows: slice) -> Series:
        return {name: values[rows] for name, values in sweep.series.items()}

    rounded = {name: np.round(values, 3) for name, values in sweep.series.items()}
    mixed = {name: np.concatenate([sweep.series[name][260:], test.series[name][40:]]) for name in sweep.series}
    cases: list[tuple[dict[str, Any], str]] = [
        (part(slice(None)), "episode held_out (test) is a copy of sweep (train): a model must be tested on rows"),
        (rounded, "is a copy of sweep"),
        ({name: values[7:] for name, values in rounded.items()}, "has 293 rows or more of sweep"),
        (part(slice(270, 300)), "episode held_out (test) has 30 rows or more of sweep (train)"),
        (part(slice(1, None, 2)), "has 150 rows or more of sweep"),
        (part(slice(None, None, -1)), "has 300 rows or more of sweep"),
        (mixed, "has 40 rows or more of sweep"),
    ]
    for values, text in cases:
        values |= {"t": PERIOD * np.arange(len(values["Cd"]))}
        (line,) = implausible(replace(sound, episodes=(sweep, calm, replace(test, series=values))))
        assert text in line
    # By its hash, whatever became of the numbers.
    hashed = [replace(one, provenance={"source": one.name, "source_sha256": "ab"}) for one in (sweep, test)]
    (line,) = implausible(replace(sound, episodes=(hashed[0], calm, hashed[1])))
    assert "held_out (test) is a copy of sweep" in line
    # Cycles that are alike to the last digit, in a period of no whole number of rows, or of one.
    for period in (16.37, 25.0):
        cycles = []
        for k, one in enumerate(sound.episodes):
            w = 2 * np.pi * STEPS / period + k
            flow = {"t": one.series["t"], "action": 0.0 * w, "Cd": 1 + 0.1 * np.cos(2 * w), "Cl": np.sin(w)}
            flow["Cp"] = -0.4 + 0.3 * np.sin(w[:, None] + np.arange(4))
            cycles.append(replace(one, series=flow))
        assert list(implausible(replace(sound, episodes=tuple(cycles)))) == []


def test_a_frequency_between_the_lines_of_the_spectrum_is_found():
    for cycle in (7.3, 25.0, 60.0):
        values = 3.0 + np.sin(2 * np.pi * np.arange(500) / cycle + 1.0)
        # An eighth of 1 / duration.
        assert dominant_frequency(values, 0.25) == pytest.approx(4 / cycle, abs=4 / (8 * 500))
    # No frequency without a wave.
    assert dominant_frequency(np.ones(100), 0.25) is None and dominant_frequency(np.arange(5.0), 0.25) is None
    # Two waves share the power by their squares.
    t = 0.2 * np.arange(2000)
    waves = 3.0 * np.sin(2.0 * np.pi * 0.2 * t) + 1.0 * np.cos(2.0 * np.pi * 0.4 * t)
    assert share_near(waves, 0.2, 0.2, 0.1) == pytest.approx(0.9, abs=1e-3)
    assert share_near(waves, 0.2, 0.4, 0.1) == pytest.approx(0.1, abs=1e-3)
