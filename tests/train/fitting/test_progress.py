"""Time is counted by phase, in this process, whatever order the calls come in."""

import pytest

from train.fitting.progress import Phase, Stopwatch


def test_time_belongs_to_the_phase_that_reports_next():
    now = {"cpu": 100.0, "wall": 5000.0}
    watch = Stopwatch(cpu=lambda: now["cpu"], wall=lambda: now["wall"])
    for phase, step, cpu, wall in (
        (Phase.FIT, 10, 30.0, 60.0),
        (Phase.FIT, 20, 30.0, 60.0),
        (Phase.DISTIL, 5, 6.0, 24.0),
    ):
        now["cpu"] += cpu
        now["wall"] += wall
        watch(phase, step, 20, {})
    fit, distilled = watch.figures()
    assert fit == {"phase": "joint fit", "steps": 20, "cpu_min": pytest.approx(1.0), "min": pytest.approx(2.0)}
    assert distilled == {
        "phase": "distil, windows",
        "steps": 5,
        "cpu_min": pytest.approx(0.1),
        "min": pytest.approx(0.4),
    }
