"""Several sessions in one report, with errors that can be counted on the fingers."""

import re
from dataclasses import replace

import pytest

from fieldkit.views.report import Part, write_campaign_report
from fieldkit.views.report.error_budget import ErrorBudget, pool
from fieldkit.views.report.series import series

DAY_NS = 86_400 * 10**9


@pytest.fixture
def parts(recorded, site, regions, settings, make_minute):
    """Two days of ten minutes; b15 off by +1 and -3 in turn, then by +2; b25 by -1 always."""

    def part(day, errors):
        minutes = [make_minute(i, tilt_deg=15.0 + error) for i, error in enumerate(errors)]
        shifted = [replace(minute, time_ns=minute.time_ns + day * DAY_NS) for minute in minutes]
        return Part(recorded, site, series(shifted, regions), settings)

    return [part(0, [1.0, -3.0] * 5), part(1, [2.0] * 10)]


@pytest.fixture
def written(tmp_path, parts):
    def write(**changes: object) -> str:
        write_campaign_report(tmp_path / "campaign.html", "sand & sun", parts, **changes)
        return (tmp_path / "campaign.html").read_text(encoding="utf-8")

    return write


def test_errors_are_by_bed_and_day_and_over_all(written):
    text = written(sd="usual")
    assert re.search(r"1\.5° over 40\b", text)  # 2, 2, 1 and 1 degrees
    for needed in ("2017-12-11", "2017-12-12", "2.0 (1.00)", "2.0 (0.00)", "1.0 (0.00)", "sand &amp; sun"):
        assert needed in text
    assert "2.0 (0.32)" in written(sd="paper")  # eq. (9) as printed: smaller by the root of ten


def test_slopes_and_both_figures_of_the_paper_are_there_and_nothing_is_fetched(written):
    text = written()
    words = re.findall(r'<svg role="img" aria-label="([^"]*)"', text)
    assert re.findall(r"b\d\d [\d.]+°", words[0]) == ["b15 12.0°", "b25 24.0°", "b15 17.0°", "b25 24.0°"]
    assert len(words) == 3
    assert re.findall(r'(?:src|href)="(?!#)', text) == []


def test_a_session_that_was_simulated_and_its_warnings_are_named(written, parts):
    assert "of 2 sessions" not in written()
    parts[1] = replace(parts[1], simulated=True, warnings=["1 gap"])
    text = written()
    assert "1 of 2 sessions" in text
    assert "<li>1 gap</li>" in text
    assert 'class="verdict doubt"' in text


@pytest.mark.usefixtures("without_matplotlib")
def test_without_matplotlib_the_table_stays(written):
    text = written()
    assert "pip install" in text
    assert "2.0 (0.32)" in text


def test_sessions_without_slopes_have_no_errors(written, parts, site, regions):
    parts[:] = [replace(parts[0], columns=series([], regions))]
    assert not re.search(r"[\d.]+° over", written())


def test_the_error_budget_is_by_given_tilt_over_all_sessions(written):
    text = written()
    budget = text[text.index("Error budget") :]
    assert "<th" in budget[: budget.index("15°")]
    for cause in (
        "omitted: diffuse light",
        "heat stored in the sand",
        "half the width of the likelihood region",
        "irradiance wrong",
    ):
        assert cause in budget
    assert "1.5°" in budget  # a tenth of the irradiance is a tenth of 15 degrees


def test_medians_over_sessions_leave_out_what_is_not_known():
    days = [ErrorBudget("b15", *(float(value),) * 8) for value in (1, 9, 2, float("nan"))]
    found = pool("15°", days)
    assert (found.name, found.storage_w_m2, found.tilt_deg) == ("15°", 2.0, 2.0)
