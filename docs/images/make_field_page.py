"""The field page on a phone's screen, at stages of the journey that its test makes in Chromium."""

from __future__ import annotations

from demo_day import DemoDay

from tests.harness import field_page_journey as journey
from tests.harness.field_page import Watched, chromium, opened, served

SHOWN = ("drawing", "slopes", "alarm", "plot")
IMAGES = tuple(f"field-page-{stage}.png" for stage in SHOWN)


def main(day: DemoDay) -> None:
    """Draw two regions, record, be warned, stop."""

    def take(name: str, watched: Watched) -> None:
        if name in ("slopes", "plot"):
            # what was answered covers what is shown, and leaves by itself at some time
            watched.page.evaluate("document.getElementById('answers').replaceChildren()")
        if name == "slopes":
            watched.page.locator("#card-b15").scroll_into_view_if_needed()
        if name in SHOWN:
            watched.page.screenshot(path=day.images / f"field-page-{name}.png")

    with chromium() as browser:
        campaign = journey.empty_campaign(day.folder / "field-page")
        with served(campaign, *journey.SETTINGS) as page:
            watched = opened(browser, page.link())
            watched.wait_for_picture()
            journey.draw(watched, "flat", journey.FLAT, take)
            journey.draw(watched, "b15", journey.B15, take, tilt="15")
            with journey.quick(campaign):
                journey.record(watched, take)
            journey.be_warned(watched, take)
            watched.page.locator("#plot").scroll_into_view_if_needed()
            watched.page.locator("#plot").tap()
            take("plot", watched)
            journey.stop(watched, take)
