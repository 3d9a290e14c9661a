"""The built site in a browser, from its files: it shows, it finds, it asks nothing of a network, all can read it."""

from pathlib import Path

import pytest

from tests.browser import PHONE, Visit, visit

SITE = Path(__file__).resolve().parents[2] / "build" / "docs"
API = "generated/api/can_bridge.e2e.html"

pytestmark = [
    pytest.mark.proofs,  # `make test` writes no site
    pytest.mark.browser,
    pytest.mark.skipif(not (SITE / "index.html").exists(), reason="the site is not built: make docs"),
]


def _open(browser, page: str, **window) -> Visit:
    return visit(browser, f"{SITE.as_uri()}/{page}", home=SITE.as_uri(), **window)


def test_the_first_page_leads_to_all_parts(browser):
    found = _open(browser, "index.html")
    captions = found.page.locator(".sidebar-tree .caption").all_inner_texts()
    assert [caption.upper() for caption in captions] == [
        *("START", "TUTORIAL", "EXAMPLES", "HOW TO", "REFERENCE", "EXPLANATION", "FOR DEVELOPERS")
    ]
    assert found.page.locator("article img").first.evaluate("image => image.naturalWidth") > 100
    assert found.troubles == []


def test_search_finds_a_word_without_a_server(browser):
    found = _open(browser, "search.html?q=freshness")
    # Hits appear one after the other.
    for title in ("Protection", "can_bridge.secoc.freshness_store"):
        found.page.locator("#search-results li a", has_text=title).first.wait_for()
    hits = found.page.locator("#search-results li a").all_inner_texts()
    (prose,) = (number for number, hit in enumerate(hits) if hit.startswith("Protection"))
    assert prose < hits.index("can_bridge.secoc.freshness_store")
    # The hits come without excerpts: a browser lets no file read another.
    assert [one for one in found.troubles if one.startswith("request")] == []


def test_formulas_and_links_to_the_code_show(browser):
    found = _open(browser, "reference/equations.html")
    assert found.page.locator("div.math math").first.evaluate("formula => formula.getBoundingClientRect().height") > 20
    found.page.get_by_role("link", name="export.reference.mpc.cost_terms").click()
    assert found.page.locator("dt:target").inner_text().startswith("cost_terms(")
    assert found.troubles == []


@pytest.mark.parametrize("page", ["index.html", API, "reference/results.html"])
def test_everyone_can_read_it(browser, page):
    for dark in (False, True):
        opened = _open(browser, page, dark=dark)
        assert opened.troubles == [], (page, dark)
        # axe asks for the style sheets by requests that a browser refuses for files: troubles of its own.
        assert opened.violations() == [], (page, dark)
        opened.page.context.close()


def test_no_page_is_wider_than_a_phone(browser):
    opened = _open(browser, "index.html", width=PHONE, height=800)
    for page in ("index.html", API, "reference/equations.html"):
        opened.page.goto(f"{opened.home}/{page}")
        assert not opened.is_wider_than_its_window, page
