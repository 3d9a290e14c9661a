"""The settings' rules, the sources of their defaults, and the places of a body's sensors on its surface."""

import math
import re
from operator import attrgetter
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from contract import sensors
from contract.config.body import BodyConfig, layout_of
from contract.config.controller import MpcConfig
from contract.config.learning import ModelConfig, TrainConfig
from contract.config.listing import sections
from contract.config.operating_point import OperatingPoint
from contract.config.plant import FlowConfig
from contract.config.tree import Config
from contract.config.vehicle import BusConfig, E2eConfig, EcuConfig
from contract.errors import ConfigError
from contract.geometry import HALF_WIDTH, JET_WIDTH


def test_every_number_must_be_finite_and_none_but_a_reference_may_be_negative():
    for section in sections(Config()):
        group = attrgetter(section.name)(Config())
        assert group.section == section.name
        for one in section.settings:
            name = one.name.rpartition(".")[2]
            if isinstance(one.value, str | bool):
                continue
            bad = [math.nan, math.inf, -math.inf]
            if name != "drag_reference":
                bad.append(-1 if isinstance(one.value, int) else -1e-9)
            for wrong in bad:
                with pytest.raises(ConfigError, match=rf"{one.name} = {wrong}: must be"):
                    type(group)(**{name: wrong})


def test_a_rule_holds_up_to_its_bound_and_no_further():
    bounds: list[tuple[type[Any], str, object, object, str]] = [
        (OperatingPoint, "speed", 1000.0, 1001.0, r"in 0\.01\.\.1000"),
        (FlowConfig, "action_limit", 1e-12, 0.0, "positive"),
        (FlowConfig, "substeps", 10_000, 10**12, r"in 1\.\.10000: with more, a period takes hours"),
        (EcuConfig, "rearm_frames", 1, 0, "at least 1"),
        (EcuConfig, "loss_limit", 50, 51, r"in 1\.\.loss_window"),
        (ModelConfig, "dropout", math.nextafter(1.0, 0.0), 1.0, r"in \[0, 1\)"),
        (MpcConfig, "horizon", 2, 1, "at least 2"),
        (TrainConfig, "batch_size", 2, 1, "at least 2, for the variance over a batch"),
        (BusConfig, "data_bitrate", 500_000, 499_999, r"in nominal_bitrate\.\.8000000"),
        (E2eConfig, "min_ok", 5, 6, r"in 1\.\.window"),
        (E2eConfig, "max_delta", 127, 128, r"in 1\.\.127"),
    ]
    for kind, name, good, bad, must in bounds:
        assert getattr(kind(**{name: good}), name) == good
        with pytest.raises(ConfigError, match=rf"\.{name} = {re.escape(repr(bad))}: must be {must}"):
            kind(**{name: bad})
    assert BusConfig(frames="classic", data_bitrate=1).data_bitrate == 1, "classic frames have no data bit rate"
    with pytest.raises(ConfigError, match=r"leading_edge_radius = 0\.4: must be at most half the length"):
        BodyConfig(length=0.6, leading_edge_radius=0.4)


DOCS = Path(__file__).resolve().parents[3] / "docs"

# Read off the manuscript, in the order of the text: what each place gives. Equations are counted through.
PAPER: dict[str, set[object]] = {
    "section 2.1": {7.647, 0.118, 500, 0.2, 0.075, 40, 10, 0.05, 0.25, 0.005, 0.45, 0.1, 0.4},
    "section 2.2.1": {32, 8},
    "section 2.2.4": {0.25, 0.02, 5, 512, 0.001, 300, 32, 8},
    "table 1": {64, 8, 256, 128, 2, 0.25},
    "equation 5": set(),  # the loss and its terms
    "section 2.3.1": {"shap", 100, 500, 10},
    "section 2.3.2": set(),  # distillation of the encoder, and of it alone
    "section 2.4": {25},
    "section 2.4.1": {1.051, 0.1, 0.01, 8.0},
    "equation 13": set(),  # mean and fluctuation of drag
    "equation 14": set(),  # lift: its mean magnitude
    "equation 15": set(),  # control: smoothness
    "section 2.4.2": {5, 0.001},
    "section 3.2": {4},
    "appendix A": {0.01, 0.8},
    "appendix B": {0},  # delays of 0 to 12 steps; noise on the sensors
}


def test_every_default_has_a_source_that_gives_it():
    for one in [one for section in sections(Config()) for one in section.settings]:
        assert one.source is not None, one.name
        assert one.source.place if one.source.kind in ("paper", "standard") else one.source.note, one.name
        if one.source.kind == "paper":
            # A note says how the default follows from what is not written at that place.
            assert one.source.place in PAPER, one.name
            assert one.source.note or one.paper in PAPER[one.source.place], one.name
        assert (DOCS / one.source.page.partition("#")[0]).exists(), one.name


def test_the_defaults_are_the_papers_truck_and_the_rule_gives_its_table():
    assert layout_of(BodyConfig()) is sensors.TRUCK
    # With another length the rule decides. The paper's table has 0.204555 once, for 0.204545.
    near = layout_of(BodyConfig(length=7.648))
    assert near.names == sensors.NAMES
    assert np.abs(near.positions[80:, 1] - sensors.TRUCK.positions[80:, 1]).max() == pytest.approx(1e-5, rel=1e-6)
    assert np.abs(near.positions[:80] - sensors.TRUCK.positions[:80]).max() < 1.1e-3


@given(length=st.floats(0.5, 15.0), radius=st.floats(1e-9, 0.5), sides=st.integers(1, 120), on_base=st.integers(1, 20))
def test_sensors_lie_on_sides_and_base_clear_of_edge_and_slots(length, radius, sides, on_base):
    assume(radius <= 0.5 * length)
    body = BodyConfig(length=length, leading_edge_radius=radius, sensors_per_side=sides, sensors_on_base=on_base)
    layout = layout_of(body)
    assert len(layout) == 2 * sides + on_base
    x, y = layout.positions.T
    base = np.zeros(len(layout), dtype=bool)
    base[layout.base] = True
    assert (x[base] == length).all() and (np.abs(y[base]) < HALF_WIDTH - JET_WIDTH).all()
    assert (np.abs(y[~base]) == HALF_WIDTH).all()
    assert ((x[~base] > radius - 1e-6) & (x[~base] < length + 1e-6)).all()
    # Front to rear, top to bottom, and each its own mirror image.
    assert (np.diff(x[:sides]) >= 0).all() and (np.diff(y[base]) < 0).all()
    assert layout.mirror is not None
    assert np.array_equal(layout.positions[layout.mirror], layout.positions * (1.0, -1.0))
    assert layout.names[layout.mirror[layout.names.index("upper_00")]] == "lower_00"
