"""The tables in the documents are those that the files in results/ give."""

import pytest

from benchmarks import tables
from benchmarks.common.command_line import ROOT
from benchmarks.common.documents import fill, names


@pytest.fixture(scope="module")
def made() -> dict[str, str]:
    return tables.tables(ROOT / "results")


def test_every_page_is_up_to_date(made):
    assert len(tables.pages()) > 5
    for page in tables.pages():
        text = page.read_text(encoding="utf-8")
        assert text == fill(text, made), f"{page} is stale: run `make tables`"


def test_every_table_has_a_place(made):
    placed = [name for page in tables.pages() for name in names(page.read_text(encoding="utf-8"))]
    assert set(made) == set(placed)


def test_a_place_without_table_or_end_is_refused():
    for page, message in (
        ("<!-- table other -->\n<!-- end -->\n", "no table 'other'"),
        ("<!-- table one -->\n", "'one' has no '<!-- end"),
    ):
        with pytest.raises(ValueError, match=message):
            fill(page, {"one": "new"})
