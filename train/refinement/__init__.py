"""The training of the plan's prior in closed loop, with gradients through the flow solver."""
