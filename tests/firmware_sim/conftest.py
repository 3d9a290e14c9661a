"""The bench of the ECU's own tests."""

from tests.ecu.conftest import bench, bench_of, bundle_of, recording_controller

__all__ = ["bench", "bench_of", "bundle_of", "recording_controller"]
