"""The table of what training costs."""

from pathlib import Path

from benchmarks.common.markdown import read, table


def tables(results: Path) -> dict[str, str]:
    """All tables by their names."""
    measured = read(results / "training.json")["figures"]
    lines = [
        ("straightforward: every window read for itself by torch.nn.LSTM", measured["straightforward_ms"]),
        ("shared windows, own backward pass (`train.networks.recurrence`)", measured["shared_ms"]),
        ("of it the LSTM", measured["lstm_ms"]),
        ("arithmetic floor of the step", measured["step_floor_ms"]),
        ("arithmetic floor of the LSTM", measured["lstm_floor_ms"]),
        ("LSTM read as a stream, as many latents", measured["stream_lstm_ms"]),
    ]
    heads = ("one step, batch of 512 samples, one thread", "ms")
    return {"training": table(heads, [(name, f"{ms:.1f}") for name, ms in lines])}
