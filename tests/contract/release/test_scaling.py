"""The scaling of the controller's window, column by column."""

from contract.release.manifest import Scaling


def test_the_action_is_the_windows_last_column_and_keeps_its_zero():
    """Zero must stay zero: an action and its mirror image differ in sign only."""
    scaling = Scaling(
        pressure_mean=(-0.3, 0.2), pressure_std=(0.1, 0.4), action_std=0.05, force_mean=(1.0, 0.0), force_std=(0.1, 0.8)
    )
    assert scaling.window_mean == (-0.3, 0.2, 0.0)
    assert scaling.window_std == (0.1, 0.4, 0.05)
