"""The prior of the plan, trained through the flow in closed loop."""
