"""Take the pictures of the field page: the journey that its test makes, on a phone's screen in Chromium.

    python docs/images/make_field_page.py

Writes ``field-page-NAME.png`` beside this file, for each stage of the journey in `SHOWN`.
"""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path

HERE = Path(__file__).resolve().parent
sys.path.insert(0, str(HERE.parents[1]))

from tests.harness import field_page_journey as journey  # noqa: E402
from tests.harness.field_page import Watched, chromium, opened, served  # noqa: E402

SHOWN = ("drawing", "slopes", "alarm")


def take(name: str, watched: Watched) -> None:
    """Keep what the phone shows, if it is one of the pictures wanted."""
    if name == "slopes":
        watched.page.locator("#answers button").click()  # what was answered covers the card
        watched.page.locator("#card-b15").scroll_into_view_if_needed()
    if name in SHOWN:
        watched.page.screenshot(path=HERE / f"field-page-{name}.png")


def main() -> None:
    """Draw two regions, record, be warned, stop."""
    with tempfile.TemporaryDirectory() as folder, chromium() as browser:
        campaign = journey.empty_campaign(Path(folder) / "sandslope")
        with served(campaign, *journey.SETTINGS) as page:
            watched = opened(browser, page.link())
            watched.wait_for_picture()
            journey.draw(watched, "flat", journey.FLAT, take)
            journey.draw(watched, "b15", journey.B15, take, tilt="15")
            journey.record(watched, take)
            journey.be_warned(watched, take)
            journey.stop(watched, take)


if __name__ == "__main__":
    main()
