"""The ECU in C and the Python ECU side by side: the same frames, times and answers of the networks, to the bit."""

from collections import Counter
from random import Random

import pytest

from firmware_sim.ecu.state_machine import OperatingMode
from tests.each import each
from tests.proofs.ecu_in_c import campaign
from tests.proofs.ecu_in_c.edges import Edges
from tests.proofs.ecu_in_c.library import Layout, Library, sources
from tests.proofs.ecu_in_c.planted import PLANTED
from tests.proofs.ecu_in_c.python_twin import PythonTwin
from tests.proofs.ecu_in_c.variants import VARIANTS

pytestmark = pytest.mark.compiler
PERIODS = 600
"""Of each stretch."""


@pytest.fixture(scope="module")
def library(tmp_path_factory):
    """The library of a variant, by its name."""
    folder, built = tmp_path_factory.mktemp("twins"), dict[str, Library]()

    def get(name: str) -> Library:
        if name not in built:
            built[name] = campaign.build(name, folder)
        return built[name]

    return get


@each("seed", ["0", "1"])
@each("name", VARIANTS)
def test_both_ecus_live_through_the_same_periods_alike(library, name, seed):
    found = campaign.stretch(library(name), name, seed, PERIODS)
    assert found.mismatch is None, str(found.mismatch)
    assert found.steps == PERIODS


@pytest.mark.proofs
def test_both_ecus_live_through_a_million_periods_alike(library):
    for number in range(400):
        name = list(VARIANTS)[number % len(VARIANTS)]
        found = campaign.stretch(library(name), name, str(number), 2_500)
        assert found.mismatch is None, str(found.mismatch)


def test_the_traffic_reaches_every_mode_and_keeps_control_for_long():
    """Or nothing much would be compared."""
    modes = Counter[str]()
    for name in ("as shipped", "late actuator, long windows"):
        for seed in "01":
            twin, rng = PythonTwin(VARIANTS[name], Layout(sources(VARIANTS[name]))), Random(seed)
            edges, traffic = (
                Edges(VARIANTS[name], rng) if seed == "1" else None,
                campaign.traffic(name, seed, twin.horizon),
            )
            campaign.recorded(twin, traffic, 600, modes=modes, edges=edges, rng=rng)
    assert set(modes) == {mode.name for mode in OperatingMode}
    assert modes["ACTIVE"] > 0.2 * sum(modes.values())


@pytest.mark.parametrize("planted", PLANTED, ids=lambda item: item.what)
def test_a_fault_that_is_planted_in_c_is_found(planted, tmp_path):
    contents = planted.into(sources(VARIANTS[planted.variant]))
    broken = Library(contents, tmp_path / "broken.so")
    found = (campaign.stretch(broken, planted.variant, seed, 2_000, chunk=100).mismatch for seed in "130")
    mismatch = next((item for item in found if item is not None), None)
    assert mismatch is not None
    assert mismatch.fields


def test_a_mismatch_says_where_it_is_and_happens_again(tmp_path):
    planted = PLANTED[4]
    broken = Library(planted.into(sources(VARIANTS[planted.variant])), tmp_path / "broken.so")
    first, again = (campaign.stretch(broken, planted.variant, "1", 400).mismatch for _ in range(2))
    assert first == again
    assert first is not None
    (field,) = first.fields
    assert field.startswith("state.command_counter: ")
