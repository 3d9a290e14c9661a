from contract import geometry
from contract.config.tree import Config


def test_action_limit_is_the_papers_jet_velocity():
    """A mean velocity of 1.5 U_inf over a slot 0.05 W wide is a flow rate of 0.075 U_inf W (paper, section 2.1)."""
    assert abs(1.5 * geometry.JET_WIDTH - Config().flow.action_limit) < 1e-15
