"""The picture of the rooms is drawn from the imports as they are, and refuses imports that it cannot show."""

from pathlib import Path

import pytest

from docs import rooms


@pytest.mark.slow  # reads every file
def test_the_picture_is_up_to_date():
    assert rooms.PICTURE.read_text(encoding="utf-8") == rooms.draw(), "docs/rooms.svg is stale: run `make generated`"


def _write(root: Path, **content: str) -> None:
    for room in rooms.ROOMS:
        (root / room).mkdir()
        (root / room / "__init__.py").write_text(content.get(room, ""))


def test_imports_are_counted_by_module_in_every_form(tmp_path):
    late = "def f():\n    from contract.errors import E\n"
    _write(tmp_path, wake=f"from contract import errors, geometry\nimport contract.errors\n{late}")
    for name in ("errors", "geometry"):
        (tmp_path / "contract" / f"{name}.py").write_text("import numpy\nfrom contract import sensors\n")
    assert rooms.imports(tmp_path) == {("wake", "contract"): 2}


def test_a_circle_is_refused():
    with pytest.raises(ValueError, match=r"in a circle: .*wake.*: cut one"):
        rooms.floors({("wake", "train"): 1, ("train", "wake"): 1})
