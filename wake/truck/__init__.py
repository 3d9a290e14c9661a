"""The truck in the flow: its outline, jets, sensors and forces, advanced one control period at a time."""
