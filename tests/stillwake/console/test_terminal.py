"""What commands print: bars that fit a narrow terminal, lines where there is none, and text as it is."""

import io
import time

import pytest
from rich.console import Console
from rich.progress import Progress
from rich.table import Column, Table

from stillwake.console.progress import ProgressBar, ProgressLines, progress, span
from stillwake.console.terminal import PlainConsole, make_console, visible

RUN_NOTE = "CONTROL  Cd 1.031  base Cp -0.512  action +0.0123  step 12.3 ms"
TRAIN_NOTE = "total 0.4317  prediction 0.2416  force 0.1201  variance 0.9000  covariance 0.0312"


class Clock:
    """Seconds that pass when a test says so."""

    now = 0.0

    def __call__(self) -> float:
        return self.now


@pytest.fixture(autouse=True)
def _able(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("TERM", "xterm")  # on a dumb terminal rich draws no bar, whatever is forced


def terminal(width: int = 80) -> Console:
    return Console(width=width, force_terminal=True, force_interactive=True, file=io.StringIO(), color_system=None)


def log() -> Console:
    return Console(force_terminal=False, file=io.StringIO(), width=10_000)


def text(console: Console) -> str:
    assert isinstance(console.file, io.StringIO)
    return console.file.getvalue()


def test_a_narrow_table_keeps_words_and_numbers_whole(monkeypatch):
    monkeypatch.setenv("COLUMNS", "40")
    console = make_console()
    console.file = io.StringIO()
    texts = "bias:sensor=a_long_name_at_the_base,level=0.5@2.14..3", "-0.123456789012"
    table = Table("disturbance", *(Column(name, justify="right") for name in ("mean", "rms", "largest")))
    table.add_row(*texts, *texts)
    console.print(table)
    rows = [[cell.strip() for cell in line.split("│")[1:-1]] for line in text(console).splitlines() if "│" in line]
    assert ["".join(cells) for cells in zip(*rows, strict=True)] == [*texts, *texts]


def test_bar_count_and_time_left_stay_and_the_note_gives_way():
    of_training = ("iterations", "distil predictor", 123_456, TRAIN_NOTE)
    for unit, task, total, note in (("periods", "closed loop", 625, RUN_NOTE), of_training):
        for width in (80, 100, 200):
            console, clock = terminal(width), Clock()
            bar = ProgressBar(console=console, estimate_over=30.0, clock=clock)
            number = bar.add_task(task, total=total, note=note, unit=unit)
            for clock.now in (0.0, 10.0, 20.0):
                # Not through `update`, which would show the bar from a thread of its own.
                Progress.update(bar, number, completed=total * clock.now / 100.0, note=note)
            console.print(bar)
            (line,) = text(console).splitlines()
            assert len(line) <= width
            for part in (task, "━", f"{int(total * 0.2)}/{int(total)}", unit, "01:20", note if width == 200 else ""):
                assert part in line, (part, width)
            assert line.rstrip().endswith("…" if len(line.rstrip()) == width and note else note)


def test_nothing_is_shown_before_the_first_report():
    console = terminal()
    with progress("periods", console=console) as report:
        assert text(console) == ""
        report("closed loop", 0, 4)
        assert "0/4 periods" in text(console)
    # A task may count in a unit of its own.
    console = log()
    with progress("phases", console=console) as report:
        report("export", 0, 4)
        for done in (0, 70):
            report("sensor estimator", done, 70, unit="batches")
    begins = [line.partition(" (")[0] for line in text(console).splitlines()]
    assert begins == ["export: 0/4 phases", "sensor estimator: 70/70 batches"]
    for console in (terminal(), log()):
        with pytest.raises(ValueError, match="refused"), progress("periods", console=console):
            raise ValueError("refused")
        assert text(console) == ""


def test_a_log_has_a_line_at_the_start_every_half_minute_at_the_end_and_at_a_stop():
    console, clock = log(), Clock()
    with progress("periods", console=console, clock=clock) as report:
        for done in range(1001):
            clock.now = done / 8.0  # exact in binary
            report("closed loop", done, 1000, "Cd 1.03  [base]")
    first, *middle, last = text(console).splitlines()
    assert first.startswith("closed loop: 0/1000 periods (0 %)")
    shares = [line.partition(",")[0] for line in middle]
    assert shares == [f"closed loop: {10 * share}/1000 periods ({share} %)" for share in (24, 48, 72, 96)]
    assert middle[0].partition(", ")[2] == "8 periods/s, 1 min 35 s left, 30 s so far; Cd 1.03 [base]"
    # Two workers end their first runs together, 40 s after they began; what was there before counts for no speed.
    with progress("runs", estimate_over=3600.0, console=console, clock=clock) as report:
        for done, passed in ((100, 0.0), (101, 40.0), (102, 0.5)):
            clock.now += passed
            report("campaign", done, 280)
    assert text(console).splitlines()[-1].endswith(", 0.0494 runs/s, 1 h 0 min left, 40 s so far")
    # A stop shows how far it was, also what was held back; times are written for people.
    with pytest.raises(KeyboardInterrupt), progress("steps", console=console, clock=clock) as report:
        for done, passed in ((0, 0.0), (1, 5.0), (2, 5.0), (3, 5.0), (4, 0.01)):
            clock.now += passed
            report("running", done, 50)
        raise KeyboardInterrupt
    assert text(console).splitlines()[-1].startswith("running: 4/50 steps (8 %), 0.2")
    for seconds, words in ((0.4, "0 s"), (59.6, "1 min 0 s"), (7500, "2 h 5 min"), (1e6, "11.6 days")):
        assert span(seconds) == words
    assert last == "closed loop: 1000/1000 periods (100 %), done in 2 min 5 s; Cd 1.03 [base]"


def test_what_is_over_at_once_is_not_shown_and_reports_are_drawn_at_most_so_often(monkeypatch):
    console, clock, shown = log(), Clock(), list[float]()
    monkeypatch.setattr(ProgressLines, "update", lambda _bar, _task, **changes: shown.append(changes["completed"]))
    with progress("frames", console=console, clock=clock) as report:
        for clock.now in (0.0, 0.05, 0.09):
            report("short", 100.0 * clock.now + 1.0, 10.0)
        for clock.now in (1.0, 1.05, 1.125, 1.15, 1.25):
            report("long", clock.now)
    assert shown == [1.125, 1.25]


def test_one_long_step_is_no_silence():
    for is_begun in (True, False):
        console = log()
        with ProgressLines(console=console, estimate_over=30.0, clock=time.monotonic, interval=0.1) as bar:
            task = bar.add_task("compiling", total=3, note="", unit="steps")
            if is_begun:
                bar.update(task, completed=0)
            deadline = time.monotonic() + 20.0
            while text(console).count("\n") < 1 + is_begun and time.monotonic() < deadline:
                time.sleep(0.02)
        lines = text(console).splitlines()
        assert lines[0].startswith("compiling: 0/3 steps (0 %), ")
        assert len(lines) >= 1 + is_begun


def test_text_is_printed_as_it_is_and_a_pipe_has_no_right_edge(monkeypatch, capsys):
    monkeypatch.delenv("COLUMNS", raising=False)
    monkeypatch.delenv("FORCE_COLOR", raising=False)
    make_console().print("all is red 12 " + 300 * "x", style="red")
    assert capsys.readouterr().out == "all is red 12 " + "x" * 300 + "\n"
    console = PlainConsole(file=io.StringIO(), markup=False, emoji=False, width=200)
    assert visible("a\n\tb") == "a\n\tb"
    odd = {"[red]a[/red]": "[red]a[/red]", ":smile:": ":smile:", "a\x1b[2Jb": "a\\x1b[2Jb", "\udcff": "\\udcff"}
    for given in (*odd, "Zürich"):
        console.print(given)
    assert text(console).splitlines() == [*odd.values(), "Zürich"]
