"""The whole report of a session in the paper's own world, where eqs. (6), (7) and (10) are exact."""

import hashlib
import re
from dataclasses import replace
from html.parser import HTMLParser

import pytest

from fieldkit.model.samples import Event, EventKind
from fieldkit.model.slope import SlopeState
from fieldkit.views.report import ReportData, write_report
from fieldkit.views.report.assessment import assess
from fieldkit.views.report.series import modelled_temperature, series, temperature_rmse_k
from tests.harness.learnt import learnt
from tests.unit.calibration.test_calibration_record import SAND


class Page(HTMLParser):
    """Words, headings, addresses and unclosed elements of a page."""

    VOID = frozenset({"meta", "input", "img"})

    def __init__(self, text: str) -> None:
        super().__init__()
        self.words: list[str] = []
        self.addresses: list[str] = []
        self.alternatives: list[str] = []
        self.open: list[str] = []
        self.feed(text)
        self.text = " ".join(" ".join(self.words).split())

    def handle_starttag(self, tag, attrs):
        given = dict(attrs)
        self.addresses += [given[name] for name in ("src", "href", "xlink:href") if name in given]
        if tag == "svg" and not given["aria-label"].startswith("Thermal image"):
            self.alternatives.append(given["aria-label"])
        if tag not in self.VOID:
            self.open.append(tag)

    def handle_startendtag(self, tag, attrs):
        self.handle_starttag(tag, attrs)
        self.handle_endtag(tag)

    def handle_endtag(self, tag):
        if tag not in self.VOID:
            assert self.open.pop() == tag

    def handle_data(self, data):
        if "style" not in self.open:
            self.words.append(data)


def report_data(session, minutes, settings) -> ReportData:
    """The data of a session's report, with the site, regions and configuration that it stores."""
    return ReportData(
        session, minutes, settings, session.site, tuple(session.regions), session.config_toml,
        frame=session.stream("camera").frame(100),
    )  # fmt: skip


@pytest.fixture
def written(tmp_path, session, minutes, settings):
    """What `write_report` makes of the session, with these changes."""

    def write(**changes: object) -> str:
        path = tmp_path / "report.html"
        write_report(path, replace(report_data(session, minutes, settings), **changes))
        return path.read_text(encoding="utf-8")

    return write


@pytest.fixture(scope="module")
def page_text(tmp_path_factory, session, minutes, settings):
    """The report of the session as it is."""
    path = tmp_path_factory.mktemp("page") / "report.html"
    write_report(path, report_data(session, minutes, settings))
    return path.read_text(encoding="utf-8")


def test_report_is_one_whole_file_that_asks_for_nothing_outside(page_text):
    page = Page(page_text)
    assert page.open == []
    assert page.addresses
    assert all(address.startswith(("data:image/png;base64,", "#")) for address in page.addresses)
    assert re.findall(r"url\((?!#)", page_text) == []
    assert "<script" not in page_text
    assert "@import" not in page_text


def test_an_emissivity_found_from_the_session_is_shown_with_figure_and_validity(written, tmp_path):
    with_figure, without = tmp_path / "sand.toml", tmp_path / "again.toml"
    with_figure.with_suffix(".svg").write_text("<svg/>", encoding="utf-8")
    page = Page(written(calibrations=[(SAND, with_figure), (replace(SAND, name="again"), without)]))
    assert [address for address in page.addresses if "svg" in address] == [
        "data:image/svg+xml;base64,PHN2Zy8+"
    ]
    for expected in ("0.915 ± 0.030", "41.2 to 58.3 °C", "2027-12-10", "probe to skin temperature", "again"):
        assert expected in page.text


def test_the_emissivity_that_slopes_use_is_shown_with_what_speaks_against_it(written):
    page = Page(written(active={"surface.emissivity": SAND}, cautions=["colder <than> it"]))
    for expected in ("0.915 ± 0.030", "surface.emissivity", "colder <than> it"):
        assert expected in page.text


def test_report_states_what_where_when_and_how_good(page_text, recorded):
    page = Page(page_text)
    for needed in (
        "sand <slopes>",
        "35.5587 N 139.3952 E, 9 m · 2017-12-11 12:00 to 12:44 (JST, UTC+09:00), 45 min",
        "b15 15.",
        "1 device lost while recording",
        "1 gap while recording",
        "15°/180°", "25°/180°", "eq10 /0.44, no diffuse, horizontal",
        "covers noise of 0.05 K, an offset between regions of 0.25 K, an irradiance scale good to 8%, "
        "an exchange with the air good to 15%, and 20% of scale for what the paper's model omits",
        "SD by eq. (9) as printed", "camera back after 14 s", "3 clock checks (system)", "+4.0 ms",
        "A. Nonymous", "fieldkit record --for 45m", "unit-norm, model paper", "numpy", 'azimuth = "known"',
        hashlib.sha256(recorded.read_bytes()).hexdigest(),
    ):  # fmt: skip
        assert needed in page.text, needed
    assert "Simulated." not in page.text  # one that is: tests/unit/cli/test_report_and_live.py


def test_results_in_the_papers_world_are_right(page_text, minutes, regions, settings):
    columns = series(minutes, regions)
    for bed in columns.targets:
        assert bed.final_estimate.tilt_deg == pytest.approx(bed.region.tilt_deg, abs=0.15)  # counts of 0.01 K
    modelled = {
        bed.region.name: modelled_temperature(columns, bed, settings.surface) for bed in columns.targets
    }
    assert temperature_rmse_k(columns.temperature_k, modelled) < 0.02
    assert "RMSE 0.0" in Page(page_text).text


def test_every_figure_has_words_and_a_free_azimuth_its_own_figure(page_text, written, settings):
    page = Page(page_text)
    assert len(page.alternatives) == 5  # the azimuth was given: no figure of it
    assert all(len(words) > 20 for words in page.alternatives)
    assert 'role="img" aria-label="Thermal image' in re.sub(r"xmlns=\S+ ", "", page_text)
    assert page_text.count("<polygon") == 2 * 3
    for name in ("flat", "b15", "b25"):
        assert f">{name}</text>" in page_text
    free = Page(written(settings=replace(settings, azimuth="free")))
    assert len(free.alternatives) == 6


@pytest.mark.usefixtures("without_matplotlib")  # its words are of a table
@pytest.mark.parametrize(("sd", "said"), [("paper", "2.0 (0.25)"), ("usual", "2.0 (1.00)")])
def test_sd_is_the_one_asked_for(written, make_minute, sd, said):
    minutes = [make_minute(index, tilt_deg=15.0 + error) for index, error in enumerate([1.0, -3.0] * 8)]
    text = Page(written(minutes=minutes, sd=sd)).text
    assert said in text  # sixteen errors of 1 and 3 degrees about their mean of 2
    assert ("as printed" in text) == (sd == "paper")


@pytest.mark.usefixtures("without_matplotlib")
def test_without_matplotlib_tables_stay_and_it_says_what_to_install(written):
    page = Page(written())
    assert "pip install 'fieldkit-slope[lab]'" in page.text
    assert page.alternatives == []
    assert "15°/180°" in page.text
    assert "diffuse light" in page.text
    assert "RMSE 0.0" in page.text


def test_a_session_without_minutes_still_has_its_report(written):
    page = Page(written(minutes=[], frame=None))
    assert "2 targets" in page.text
    assert "unflagged frame" in page.text


def test_the_same_session_gives_the_same_bytes(written, page_text):
    assert written() == page_text


@pytest.mark.usefixtures("without_matplotlib")
def test_the_error_budget_compares_the_models(written, minutes, settings, page_text):
    final = minutes[-1].estimates[0]
    full = [replace(slope, tilt_deg=slope.tilt_deg + 0.5) for slope in minutes[-1].estimates]
    rows = rows_of(written(by_others={"full": full}), "model")
    assert [row[0] for row in rows] == ["model", "paper", "full"]
    assert rows[1][1].startswith(f"{final.tilt_deg:.1f}")
    assert rows[2][1].startswith(f"{final.tilt_deg + 0.5:.1f}")
    learned = written(settings=replace(settings, model="learned"), by_others={"paper": full, "full": full})
    assert [row[0] for row in rows_of(learned, "model")] == ["model", "paper", "full", "learned"]
    assert "<strong>learned</strong>" in learned
    assert "learned model" in Page(learned).text
    assert rows_of(page_text, "model") == []


def rows_of(text: str, heading: str) -> list[list[str]]:
    """The cells of the table that has a column of this name."""
    for table in re.findall(r"<table>.*?</table>", text, re.DOTALL):
        if f">{heading}<" in table:
            rows = re.findall(r"<tr>.*?</tr>", table, re.DOTALL)
            cells = [re.findall(r"<t[hd][^>]*>(.*?)</t[hd]>", row, re.DOTALL) for row in rows]
            return [[re.sub(r"<[^>]*>", "", cell) for cell in row] for row in cells]
    return []


def test_a_region_of_another_surface_says_of_which(written, settings):
    rows = rows_of(written(settings=replace(settings, kinds={"b15": "rock"})), "own emissivity")
    assert [row[1] for row in rows[1:]] == ["reference", "target, rock", "target"]


def test_what_the_data_taught_has_its_section(written, minutes, settings, page_text):
    taught = [replace(minute, learnt=learnt(n)) for n, minute in enumerate(minutes)]
    text = written(minutes=taught, settings=replace(settings, model="learned"))
    page = Page(text)
    last = learnt(len(minutes) - 1)
    rows = rows_of(text, "from data")
    assert len(rows) == 1 + len(last.parameters)
    assert rows[3][0].startswith("thermal inertia, J m⁻²")
    assert rows[3][3] == "570 (378 to 860)"  # 570 exp(+-1.645 x 0.25)
    assert rows[3][1] == f"{1 - last.parameters[2].share_of_prior:.0%}"
    assert rows_of(text, "autocorrelation")[3] == ["b25", "0.071", "0.41"]
    assert "b25 are correlated" in page.text
    assert any("prior" in words for words in page.alternatives)
    assert "0.1 K/h" in page.text
    assert rows_of(page_text, "from data") == []


@pytest.mark.usefixtures("without_matplotlib")
def test_full_model_says_that_it_has_the_terms(written, settings):
    page = Page(written(settings=replace(settings, model="full", conductivity_sd=0.2)))
    assert "full model" in page.text
    assert "good to 20%" in page.text
    assert "model omits" not in page.text


def test_verdict_names_the_worst_bed(make_minute, regions):
    found = assess(series([make_minute(0, tilt_deg=19.0)], regions), [], "sealed")
    slopes, truths, error = found.headline.split(". ")
    assert slopes == "b15 19.0° (17.6–20.6); b25 24.0° (23.0–25.0), not resolved, or 43.3°/181°"
    assert re.search("90 % .*1 of 2", truths)
    assert error.endswith("4.0° (b15).")
    (warning,) = found.warnings
    assert re.fullmatch("b25 .*43.3°/181°.", warning)


def test_a_headline_over_wide_regions_has_their_numbers_and_warnings_their_reasons(make_minute, regions):
    minute = make_minute(0, tilt_deg=30.4, state=SlopeState.WIDE)
    bounds = {"tilt_low_deg": 14.1, "tilt_high_deg": 46.9, "tilt_half_width_deg": 16.4}
    reason = "anything fits; one region narrows; b15 does not cool: is it shaded?"
    wide = replace(minute.estimates[0], **bounds, reason=reason)
    held = replace(wide, region="b25", state=SlopeState.HELD_CLOUD)
    found = assess(series([replace(minute, estimates=(wide, held))], regions), [], "sealed")
    assert found.headline.startswith("b15 30.4° (14.1–46.9), wide; b25 30.4° (14.1–46.9), held: cloud.")
    sentences = r"Anything fits\. One region narrows\. b15 does not cool: is it shaded\?"
    assert re.fullmatch(rf"b15 .*wide\. {sentences}", found.warnings[0])
    certain = replace(minute, estimates=(replace(wide, state=SlopeState.OK),))
    warning = assess(series([certain], regions), [], "sealed").warnings[0]
    assert re.fullmatch(rf"b15 .*ok\. {sentences}", warning)


@pytest.mark.usefixtures("without_matplotlib")
def test_the_state_beside_a_slope_is_its_own_and_how_the_bed_ended_too(written, minutes):
    first, last = minutes[0].estimates[0], minutes[-1].estimates[0]
    lost = replace(last, state=SlopeState.NO_INTERSECTION, tilt_deg=float("nan"))
    ended = [*minutes[:-1], replace(minutes[-1], estimates=(lost, *minutes[-1].estimates[1:]))]
    assert first.region == lost.region
    assert re.search("wide; .*no intersection", Page(written(minutes=ended)).text)


def test_verdict_without_truth_says_so(make_minute, regions):
    unknown = tuple(replace(region, tilt_deg=float("nan")) for region in regions)
    assert "given tilts" in assess(series([make_minute(0)], unknown), [], "sealed").headline


def test_verdict_without_slopes_is_plain(make_minute, regions):
    held = make_minute(0, estimates=())
    headline = assess(series([held], regions), [], "sealed").headline
    assert "2 targets" in headline
    assert "°" not in headline


def test_verdict_counts_troubles_and_names_an_unsealed_session(make_minute, regions):
    lost = [Event(EventKind.LOST, 0, 0, "lost"), Event(EventKind.LOST, 1, 1, "lost")]
    warnings = assess(series([make_minute(0, state=SlopeState.OK)], regions), lost, "interrupted").warnings
    assert any(warning.startswith("2 devices lost") for warning in warnings)
    assert any("interrupted" in warning for warning in warnings)


def test_without_regions_no_axes_of_slopes_are_drawn(written, minutes):
    page = Page(written(minutes=minutes, regions=()))
    words = " ".join(page.alternatives)
    assert "Tilt against" not in words
    assert "Azimuth" not in words
    assert "Illuminance" in words
