"""A zone is taken from words that state one; what leaves it open, or states two, is asked."""

from zoneinfo import ZoneInfo

import pytest

from fieldkit.model.errors import ConfigError
from fieldkit.model.next_step import Argument
from fieldkit.model.site import Site
from fieldkit.results.importing import ImportOptions, import_into, import_recording
from fieldkit.sessions.formats.imported import MissingOptionsError
from fieldkit.sessions.reader import open_session
from tests.harness.logs import notes, read, readings
from tests.harness.next_steps import at, steps

NOON_S = 1_781_179_200  # 2026-06-11T12:00Z by date(1)
ROWS = "2026-06-11 12:00:00,20\n2026-06-11 12:01:00,21\n"
WINTER = ROWS.replace("-06-", "-01-")
OPEN_METEO = (
    "latitude,utc_offset_seconds,timezone,timezone_abbreviation\n52.5,{},{},{}\n\ntime,T [C]\n" + ROWS
)


def table(field: str, head: str = "time", rows: str = ROWS) -> str:
    return f'{field}\n"{head}",T [C]\n{rows}'.lstrip()


# hours ahead of UTC; Windows' names by CLDR's windowsZones, offsets of June by the IANA data base
STATED = [
    (table("", "time (UTC)"), 0),
    (table("", "time_utc"), 0),
    (table("", "dateutc"), 0),
    (table("", "日時(UTC)"), 0),
    (table("", "Time [UTC+2]"), 2),
    (table("", "Time (GMT Daylight Time)"), 1),
    (table("", "Date Time (British Summer Time GMT+1)"), 1),
    (table("", "Fecha Tiempo, GMT-05:00"), -5),
    (table("", "time (CET = UTC+1)"), 1),
    (table("", "Date (Etc/GMT-2)"), 2),
    (table("Time Zone: GMT Daylight Time"), 1),
    (table("Time zone: W. Europe Daylight Time"), 2),
    (table("Time zone: Tokyo Standard Time"), 9),
    (table("Timezone: Europe/Berlin (UTC+2)"), 2),
    (table("Fuseau horaire;Europe/Paris"), 2),
    (table("/*!40103 SET TIME_ZONE='+00:00' */"), 0),
    (table("@@session.time_zone,+02:00"), 2),
    (table("utc_offset_seconds,7200"), 2),
    (table("UTC offset [h]: 5.5"), 5.5),
    (table("Offset from UTC: -180 min"), -3),
    (table("Time Zone: UTC-7, no DST"), -7),
    (table("Time zone,UTC+1\nDaylight saving,off"), 1),
    (OPEN_METEO.format(7200, "Europe/Berlin", "GMT+2"), 2),
    (OPEN_METEO.format(7200, "Europe/Berlin", "CEST"), 2),
    ("time,T [C],tz\n" + ROWS.replace("\n", ",Europe/Berlin\n"), 2),
]
OPEN = [
    (table("timezone_offset_to_utc,120"), "120"),
    (table("Time zone: (UTC+01:00) Amsterdam, Berlin, Bern, Rome"), "Amsterdam"),
    (
        table("Time zone: GMT Standard Time"),
        "GMT Standard Time",
    ),  # all year in Windows, of winter by its words
    (table("Time Zone: GMT Daylight Time", rows=WINTER), "GMT Daylight Time"),
    (table("Time zone: local, not UTC"), "local, not UTC"),
    (table("", "Date-Time (CEST)"), "CEST"),
    (table("", "Zeit (UTC+1/+2)"), "UTC"),
    (table("time_zone,SYSTEM"), "SYSTEM"),
    (table("UTC offset,-420"), "-420"),  # minutes, not four hours and twenty
    (table("All times are UTC"), "All times"),
    (table("Summer time: yes\nTime zone: UTC+1"), "Summer time"),
    (table("Time zone: UTC+1\nDaylight saving: on"), "Daylight saving"),
    (table("Timezone: Europe/Berlin", "Time (UTC)"), "Europe/Berlin"),
    (OPEN_METEO.format(3600, "Europe/Berlin", "GMT+1"), "Europe/Berlin"),
    ("time,T [C],tz\n2026-06-11 12:00,20,Europe/Berlin\n2026-06-11 12:01,20,Europe/London\n", "London"),
]


@pytest.mark.parametrize(("text", "hours"), STATED)
def test_a_zone_is_read_from_words_that_state_one_and_stands_in_the_output(tmp_path, text, hours):
    imported = read(tmp_path, text, zone=None)
    assert readings(imported)[0].time_ns == (NOON_S - hours * 3600) * 10**9
    assert "times in " in notes(imported)
    with pytest.raises(ConfigError, check=at(tmp_path / "log.csv", Argument("zone"), Argument("offset_s"))):
        read(tmp_path, text, zone=ZoneInfo("Asia/Kathmandu"))


@pytest.mark.parametrize(("text", "words"), OPEN)
def test_a_zone_that_is_open_or_stated_twice_is_asked_with_the_words(tmp_path, text, words):
    with pytest.raises(MissingOptionsError, match=words, check=at(tmp_path / "log.csv")) as caught:
        read(tmp_path, text, zone=None)
    assert [step.name for step in steps(caught.value)] == ["zone"]


@pytest.mark.parametrize(("text", "zone"), [(OPEN[1][0], "Europe/Berlin"), (OPEN[2][0], "Europe/London")])
def test_an_open_zone_is_what_is_given(tmp_path, text, zone):
    imported = read(tmp_path, text, zone=ZoneInfo(zone))
    assert f"times in {zone}" in notes(imported)


def test_a_zone_of_which_nothing_is_said_is_the_campaigns_and_said_to_be(tmp_path, monkeypatch):
    (tmp_path / "fieldkit.toml").write_text(
        '[site]\nlatitude_deg = 47.1\nlongitude_deg = 8.5\nelevation_m = 400.0\ntimezone = "Europe/Zurich"\n'
    )
    log = tmp_path / "log.csv"
    log.write_text(table(""))
    made = import_recording(log, tmp_path / "a.h5", campaign=tmp_path)
    assert "Europe/Zurich" in f"{made.notes}"
    both = import_into(tmp_path / "a.h5", log, tmp_path / "b.h5", ImportOptions(name="more"))
    for path in (made.path, both.path):
        with open_session(path) as session:
            assert session.start_ns == (NOON_S - 2 * 3600) * 10**9
    log.write_text(OPEN[0][0])
    with pytest.raises(MissingOptionsError):
        import_recording(log, tmp_path / "c.h5", campaign=tmp_path)


def test_outside_a_campaign_zone_and_site_are_asked_at_once(tmp_path):
    log = tmp_path / "log.csv"
    log.write_text(table(""))
    with pytest.raises(MissingOptionsError) as caught:
        import_recording(log, tmp_path / "a.h5", campaign=tmp_path)
    assert [step.name for step in steps(caught.value)] == ["zone", "site"]
    site = ImportOptions(site=Site(47.1, 8.5, 400.0))
    with pytest.raises(
        MissingOptionsError, check=at("'2026-06-11 12:00:00'", Argument("zone", "Asia/Tokyo"))
    ):
        import_recording(log, tmp_path / "a.h5", site, campaign=tmp_path)
