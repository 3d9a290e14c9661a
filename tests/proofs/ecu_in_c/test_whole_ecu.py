"""The ECU in C and the Python ECU side by side: the same frames, times and answers of the networks, to the bit."""

from collections import Counter

import pytest

from ecu.fail_safe import OperatingMode
from tests.proofs.ecu_in_c import campaign
from tests.proofs.ecu_in_c.library import Library, sources
from tests.proofs.ecu_in_c.planted import PLANTED
from tests.proofs.ecu_in_c.variants import VARIANTS

pytestmark = pytest.mark.compiler
PERIODS = 600
"""Of each stretch."""


@pytest.mark.proofs  # test_c_ecu.py has a short one
def test_both_ecus_live_through_the_same_periods_alike_in_every_mode(tmp_path):
    modes = Counter[str]()
    for name in VARIANTS:
        library = campaign.build(name, tmp_path)
        for seed in "01":
            lived = campaign.stretch(library, name, seed, PERIODS)
            assert lived.mismatch is None, str(lived.mismatch)
            assert lived.steps == PERIODS
            modes += lived.modes
    # Otherwise nothing much would be compared.
    assert set(modes) == {mode.name for mode in OperatingMode}
    assert modes["CONTROL"] > 0.15 * modes.total()


@pytest.mark.proofs  # compiles each
def test_a_fault_that_is_planted_in_c_is_found_again_and_again(tmp_path):
    for number, planted in enumerate(PLANTED):
        contents = planted.into(sources(VARIANTS[planted.variant]))
        broken = Library(contents, tmp_path / f"broken_{number}.so")
        stretches = ((seed, campaign.stretch(broken, planted.variant, seed, 2_000, chunk=100)) for seed in "130")
        seed, lived = next(((seed, one) for seed, one in stretches if one.mismatch is not None), ("", None))
        assert lived is not None and lived.mismatch is not None and lived.mismatch.fields, planted.what
        if planted.what.startswith("a counter begins again"):
            again = campaign.stretch(broken, planted.variant, seed, 2_000, chunk=100)
            assert again.mismatch == lived.mismatch
            assert [field.split(":")[0] for field in lived.mismatch.fields] == ["state.command_counter"]
