"""What cyclictest 2.4 printed, read back."""

from firmware_sim.latency.cyclictest import Cyclictest, parsed

PRINTED = """# /dev/cpu_dma_latency set to 0us
T: 0 (17571) P:50 I:20000 C:    201 Min:     24 Act:   37 Avg:   45 Max:     889
"""


def test_the_summary_line_is_in_us():
    assert parsed(PRINTED) == Cyclictest(priority=50, count=201, min_ms=0.024, mean_ms=0.045, max_ms=0.889)


def test_without_permission_there_is_none():
    assert parsed("FATAL: could not set scheduler\n") is None
    assert parsed("T: 0 (17571) P:50 I:20000 C:      0 Min:1000000 Act:    0 Avg:    0 Max:       0\n") is None
