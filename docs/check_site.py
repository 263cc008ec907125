"""Check the built documentation in Chromium as it opens from disk: ``python docs/check_site.py [SITE]``.

On a phone's screen each page must fetch nothing from elsewhere, find everything that it names, scroll in one
direction only, and pass axe; the search must find a page, and the field card must print on one A4 sheet.
``make docs`` runs it after the build. Without Chromium nothing is checked, which is an error only where the
variable `REQUIRED` is set; axe-core is taken from the folder that the variable `AXE` names, if any.
"""

from __future__ import annotations

import json
import os
import re
import shutil
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING
from urllib.parse import unquote, urlsplit

if TYPE_CHECKING:
    from playwright.sync_api import Browser, Page, Request

SITE = Path(__file__).resolve().parents[1] / "site"
REQUIRED, AXE = "FIELDKIT_ALL_REQUIRED", "FIELDKIT_AXE"
PHONE = {"width": 390, "height": 844}
FIRST_HITS = {
    "arduino": "devices/text",
    "esp32": "devices/text",
    "phyphox": "import-recordings",
    "uncertain": "trust",
    "undo": "field-page",
    "stop": "command-line",
    "shade": "two-experiments",
    "csv": "export-recordings",
    "raspberry": "raspberry-pi",
    "alarm": "alarms",
    "emissivity": "calibrate-emissivity",
}
"""Words that people type, and the page that is right for each."""
DECISIONS = "explanation/decisions/"
CARD, HOME = "how-to/field-card.html", "index.html"
RULES = ["wcag2a", "wcag2aa", "wcag21a", "wcag21aa", "wcag22aa", "best-practice"]
AXE_SCRIPT = """async (rules) => (await axe.run(document, {runOnly: rules})).violations.map(
    (violation) => violation.id + ": " + violation.nodes.slice(0, 3).map((node) => node.target).join(", "))"""
WIDER = "document.documentElement.scrollWidth - window.innerWidth"


def problems(site: Path, browser: Browser, axe: str | None) -> Iterator[str]:
    """What is wrong with each page, one line each."""
    page = browser.new_page(viewport=PHONE)
    for path in sorted(set(site.rglob("*.html")) - {site / "404.html"}):  # which only a server shows
        name = str(path.relative_to(site))
        yield from (f"{name}: {found}" for found in of_page(page, path, axe))


def of_page(page: Page, path: Path, axe: str | None) -> Iterator[str]:
    """What is wrong with one page."""
    asked: list[str] = []

    def on_request(request: Request) -> None:
        asked.append(request.url)

    page.on("request", on_request)
    page.goto(path.as_uri())
    page.remove_listener("request", on_request)
    yield from filter(None, map(wrong_request, asked))
    if (wider := page.evaluate(WIDER)) > 0:
        yield f"is {wider} px wider than a phone"
    if axe is not None:
        page.evaluate(axe)
        yield from page.evaluate(AXE_SCRIPT, RULES)


def wrong_request(url: str) -> str | None:
    """What is wrong with something that a page asks for: it is elsewhere, or is not there."""
    address = urlsplit(url)
    if address.scheme in ("data", "blob", "about"):
        return None
    if address.scheme != "file":
        return f"fetches {url}"
    return None if Path(unquote(address.path)).exists() else f"does not find {url}"


def search(site: Path, browser: Browser) -> Iterator[str]:
    """Which words that people type do not lead to their page first, in a site opened from disk."""
    from playwright.sync_api import TimeoutError as NothingFoundError

    index = json.loads((site / "search" / "search_index.json").read_text(encoding="utf-8"))
    if any(entry["location"].startswith(DECISIONS) for entry in index["docs"]):
        yield "the search finds decisions, which are for developers"
    for word, name in FIRST_HITS.items():
        page = browser.new_page()
        page.goto((site / HOME).as_uri())
        page.locator("input[name=query]").press_sequentially(word)
        hits = page.locator("a.md-search-result__link")
        try:
            hits.first.wait_for(state="attached", timeout=10_000)
        except NothingFoundError:
            yield f"the search finds nothing for {word}"
        else:
            if f"/{name}.html" not in (hit := hits.first.get_attribute("href") or ""):
                yield f"the search finds {hit} for {word}, not {name}"
        page.close()


def sheets(path: Path, browser: Browser) -> int:
    """How many A4 sheets a page prints on."""
    page = browser.new_page()
    page.goto(path.as_uri())
    printed = page.pdf(format="A4", prefer_css_page_size=True)
    return len(re.findall(rb"/Type\s*/Page\b", printed))


@contextmanager
def chromium() -> Iterator[Browser | None]:
    """The system's Chromium, None where there is none."""
    path = shutil.which("chromium")
    if path is None:
        yield None
        return
    from playwright.sync_api import sync_playwright

    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=path, args=["--no-sandbox"])
        yield browser
        browser.close()


def axe_source() -> str | None:
    """The text of axe-core, None where it is not named."""
    folder = os.environ.get(AXE)
    if folder is None:
        return None
    return (Path(folder) / "node_modules/axe-core/axe.min.js").read_text(encoding="utf-8")


def main(site: Path) -> int:
    """Print what is wrong; the exit code."""
    axe = axe_source()
    if axe is None:
        print(f"accessibility was not checked: npm install --prefix FOLDER axe-core, and {AXE}=FOLDER")
    with chromium() as browser:
        if browser is None:
            print("the site was not checked: no chromium here")
            return int(bool(os.environ.get(REQUIRED)))
        found = [*problems(site, browser, axe), *search(site, browser)]
        if (count := sheets(site / CARD, browser)) != 1:
            found.append(f"{CARD}: prints on {count} sheets, not on one")
    print("\n".join(found) or "the site is sound")
    return int(bool(found))


if __name__ == "__main__":
    sys.exit(main(Path(sys.argv[1]) if sys.argv[1:] else SITE))
