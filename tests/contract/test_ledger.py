"""The drag ledger adds up, for one instant and for a series."""

import numpy as np

from contract.ledger import LEDGER_FIELDS, DragLedger, ledger_of


def test_the_ledger_adds_up_for_an_instant_and_a_series():
    one = DragLedger(Cd=1.0, Cl=-2.0, Cd_slot_pressure=0.25, Cd_slot_viscous=-0.125, Cd_momentum=-0.5, jet_power=0.01)
    assert (one.Cd_slot, one.Cd_net) == (0.125, 0.625)
    rng = np.random.default_rng(0)
    series = {name: rng.normal(size=5) for name in (*LEDGER_FIELDS, "t")}
    whole = ledger_of(series)
    for k in range(5):
        one = ledger_of({name: float(values[k]) for name, values in series.items()})
        assert (whole.Cd_slot[k], whole.Cd_net[k]) == (one.Cd_slot, one.Cd_net)
