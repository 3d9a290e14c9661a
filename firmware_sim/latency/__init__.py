"""How late a loop in real time is: stages, an idle loop of the same run, and a budget to keep."""
