"""The page in docs/ is what the files in results/ say."""

from pathlib import Path

from benchmarks import tables


def test_the_results_page_is_up_to_date() -> None:
    assert tables.PAGE.read_text(encoding="utf-8") == tables.render(tables.ROOT / "results"), (
        "docs/results.md is stale: run `make tables`"
    )
    for page in tables.FILLED:
        assert page.read_text(encoding="utf-8") == tables.render_filled(page, tables.ROOT / "results"), (
            f"{page.name} is stale: run `make tables`"
        )


def test_figures_reach_the_page(tmp_path: Path) -> None:
    for item in (tables.ROOT / "results").glob("*.json"):
        (tmp_path / item.name).write_text(item.read_text(encoding="utf-8"), encoding="utf-8")
    changed = (tmp_path / "demo.json").read_text(encoding="utf-8").replace('"frames_sent": ', '"frames_sent": 9')
    (tmp_path / "demo.json").write_text(changed, encoding="utf-8")
    assert tables.render(tmp_path) != tables.render(tables.ROOT / "results")
