"""Pages that fieldkit writes, as a browser shows them: the plan of a day, the report of a session."""

from __future__ import annotations

from pathlib import Path

from demo_day import DemoDay, browser_page

PLAN = ("--site", "35.558675,139.395232,9", "--zone", "Asia/Tokyo", "--on", "2026-12-11")
FACETS = ("--facet", "5,180", "--facet", "15,180", "--facet", "25,180")
IMAGES = ("plan.png", "report.png", "report-phone.png")
LAPTOP, PHONE = (1000, 1100), (390, 844)


def main(day: DemoDay) -> None:
    """Write the pages and take their pictures."""
    plan = day.folder / "plan.html"
    day.run("plan", *PLAN, *FACETS, "--out", str(plan), within=day.demo)
    report = day.session.parents[1] / "reports" / f"{day.session.stem}.html"
    take(day, plan, "plan", LAPTOP)
    take(day, report, "report", LAPTOP)
    take(day, report, "report-phone", PHONE)


def take(day: DemoDay, html: Path, name: str, size: tuple[int, int]) -> None:
    """The top of a page on a screen of that size."""
    png = html.with_name(f"{name}.png")
    with browser_page(*size) as page:
        page.goto(html.as_uri())
        page.screenshot(path=png)
    day.write_png(png, name, size[0])
