"""The page of settings is what the tree has, and lists all of it."""

from contract.config.loading import load_config, to_tree
from docs import settings


def test_the_page_is_up_to_date():
    assert settings.PAGE.read_text(encoding="utf-8") == settings.page(), (
        "docs/reference/settings.md: run `make generated`"
    )


def test_every_setting_has_a_line():
    def leaves(prefix: str, tree: dict) -> set[str]:
        found = set()
        for name, value in tree.items():
            full = f"{prefix}.{name}".lstrip(".")
            found |= leaves(full, value) if isinstance(value, dict) else {full}
        return found

    lines = [line.split("`")[1] for line in settings.page().splitlines() if line.startswith("| `")]
    assert sorted(lines) == sorted(leaves("", to_tree(load_config())))


def test_a_line_has_default_release_unit_bounds_source_and_meaning():
    rows = [line for line in settings.page().splitlines() if line.startswith("| `")]
    lines = {row.split("`")[1]: [cell.strip() for cell in row.split(" | ")] for row in rows}
    assert lines["train.epochs"][1:6] == ["300", "40", "passes", "positive", "paper, section 2.2.4"]
    assert lines["train.selection"][4] == "shap, qr, greedy, random, hand"
    assert lines["bus.e2e.window"][6] == "Latest checks that are judged together. |"
    assert lines["flow.refinement"][5] == "ours: [the grid of the mesh study](../explanation/mesh-study.md)"
