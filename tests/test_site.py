"""The documentation site, opened from the disk in a real browser. Its pages' code and commands: test_docs.py."""

import pytest
from mkdocs.commands.build import build
from mkdocs.config import load_config

from agents.docs.readme import ROOT

pytestmark = pytest.mark.slow  # builds the site and opens it in a browser


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    """The folder where the site was built."""
    path = tmp_path_factory.mktemp("site")
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(ROOT)
        build(load_config(str(ROOT / "mkdocs.yml"), site_dir=str(path)))
    return path


@pytest.fixture
def opened(browser, site):
    """The site's first page, and what it asked for."""
    page = browser.new_page()
    requests = []
    page.on("request", lambda request: requests.append(request.url))
    page.goto((site / "index.html").as_uri())
    yield page
    page.close()
    assert [url for url in requests if not url.startswith(("file:", "data:", "about:"))] == []


def test_the_search_finds_a_name_in_pages_opened_from_the_disk(opened):
    opened.locator("input.md-search__input").fill("envelope_margin")
    result = opened.locator(".md-search-result__link").first
    result.wait_for(timeout=20_000)
    assert result.get_attribute("href").startswith("file:")
    result.click()
    opened.wait_for_url("**/*.html*")
    assert "envelope_margin" in opened.locator("article").inner_text()


def test_the_first_page_has_a_picture_and_code(opened):
    picture = opened.locator("article img").first
    assert opened.evaluate("document.querySelector('article img').naturalWidth") > 300
    assert picture.get_attribute("alt")
    assert "gymnasium.make" in opened.locator("article pre code").first.inner_text()
