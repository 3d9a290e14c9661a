"""A control period on a computer's own clock: deadlines, sleeping, privileges, and the times of stages."""
