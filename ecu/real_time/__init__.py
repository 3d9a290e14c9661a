"""The tools to run control periods by a computer's own clock: deadlines, sleep, privileges, and times of stages."""
