"""What the comparison of the controllers runs, that it does not run it twice, and what its table says."""

import json
from pathlib import Path

import pytest

from benchmarks.controller import loop as controller_loop
from benchmarks.controller import tables as controller_tables
from contract.errors import StillwakeError

REDUCTIONS = {"run_onnx_float32": 22.0, "run_onnx_int8": 21.75, "run_c_float32": 22.0, "run_c_int8": 22.5}


class Commands:
    """Stands for `stillwake`: keeps the calls, and writes what they would."""

    def __init__(self) -> None:
        self.calls: list[list[str]] = []

    def __call__(self, *arguments: object) -> None:
        words = [str(argument) for argument in arguments]
        self.calls.append(words)
        if words[0] == "export":
            Path(words[2]).mkdir(parents=True)
            return
        name = Path(words[1]).name
        reduction = next(value for start, value in REDUCTIONS.items() if name.startswith(start))
        figures = {key: 0.5 for key in controller_loop._KEPT} | {"reduction_percent": reduction, "computed_by": name}
        Path(words[words.index("--json") + 1]).write_text(json.dumps({"figures": figures}))


@pytest.fixture
def commands(monkeypatch) -> Commands:
    found = Commands()
    monkeypatch.setattr(controller_loop, "stillwake", found)
    return found


def test_each_controller_closes_the_loop_once(commands, tmp_path, capsys):
    model, parts, results = tmp_path / "model", tmp_path / "parts", tmp_path / "results"
    model.mkdir()
    (model / "model.json").write_text(json.dumps({"weights_sha256": "abcdef" * 10}))
    for _ in range(2):
        controller_loop.main(
            model=model,
            dataset=tmp_path / "data.h5",
            json_file=results / "controller_loop.json",
            parts=parts,
            lead_in=25.0,
            controlled=100.0,
            settle=40.0,
        )
    exports = [words for words in commands.calls if words[0] == "export"]
    runs = [words for words in commands.calls if words[0] == "run"]
    assert [words[words.index("--precision") + 1] for words in exports] == ["float32", "int8"]
    folder = parts / "abcdefabcdef"
    bundles = [words[words.index("--bundle") + 1] for words in runs]
    assert bundles == [str(folder / f"bundle_{precision}") for precision in ("float32", "int8", "float32", "int8")]
    libraries = [words[words.index("--library") + 1] for words in runs if "--library" in words]
    assert libraries == [str(folder / f"c_{precision}") for precision in ("float32", "int8")]
    assert all(words[words.index("--lead-in") + 1] == "25.0" for words in runs)
    rows = json.loads((results / "controller_loop.json").read_text())["figures"]
    assert [row["points"] for row in rows] == [0.0, -0.25, 0.0, 0.5]
    assert "by 0.50 percentage points: within 0.5" in " ".join(capsys.readouterr().out.split())

    lines = controller_tables.loop(results / "controller_loop.json").splitlines()
    assert lines[-1] == "| C library, int8 | 22.50 % | +0.50 | 0.5 | 0.5 | 0.5 | 0.50 / 0.50 |"


@pytest.mark.parametrize(("content", "said"), [(None, "No such file"), ("{}", "not a model's description")])
def test_a_folder_without_a_model_is_refused(tmp_path, content, said):
    if content is not None:
        (tmp_path / "model.json").write_text(content)
    with pytest.raises(StillwakeError, match=said):
        controller_loop.main(model=tmp_path, dataset=tmp_path, parts=tmp_path)
