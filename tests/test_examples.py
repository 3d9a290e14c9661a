import runpy
import sys
from pathlib import Path

EXAMPLES = Path(__file__).parents[1] / "examples"


def test_naive_feedback_compares_with_and_without(monkeypatch, capsys):
    monkeypatch.setattr(sys, "argv", ["naive_feedback.py", "3"])
    runpy.run_path(str(EXAMPLES / "naive_feedback.py"), run_name="__main__")
    drag = [float(line.split()[3].rstrip(",")) for line in capsys.readouterr().out.splitlines()]
    assert len(drag) == 3
    assert len(set(drag)) > 1 and all(0.8 < value < 1.2 for value in drag)
