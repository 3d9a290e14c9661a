"""The truck in the flow: its outline, jets, sensors and forces, stepped one control period at a time."""
