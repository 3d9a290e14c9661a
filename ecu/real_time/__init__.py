"""The means to run a control period on a computer's own clock: deadlines, sleeping, privileges, and times of stages."""
