"""Real, virtual and simulated buses behind one interface, and the parts that receive from them."""
