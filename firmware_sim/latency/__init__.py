"""How late a loop in real time is: stages, an idle loop beside it, whose fault each miss is, and a budget to keep."""
