"""Tables of a row per sensor: a channel for each, whatever tells them.

Shapes re-typed from public examples: the history of Home Assistant, The Things Network's storage, InfluxDB's
annotated CSV ("Annotated CSV", InfluxData), ``mosquitto_sub -F``.
"""

import math

import pytest

from fieldkit.model.errors import ConfigError
from fieldkit.model.next_step import Argument
from tests.harness.logs import notes, read, readings
from tests.harness.next_steps import steps

MINUTES = [f"2026-06-11T10:0{minute}" for minute in range(6)]


def rows(*columns: str, head: str, mark: str = ",") -> str:
    """A row per minute and thing; each column is a pattern of the minute `m` and its time `t`."""
    lines = [column.format(m=m, t=time) for m, time in enumerate(MINUTES) for column in columns]
    return "\n".join([head.replace(",", mark), *(line.replace(",", mark) for line in lines), ""])


def channels(imported):
    """The numbers of each channel, without those that a row does not have."""
    return {
        (info.unit, label): [
            round(reading.values[place], 6)
            for reading in readings(imported, info.name)
            if not math.isnan(reading.values[place])
        ]
        for info in imported.streams
        for place, label in enumerate(info.channels)
    }


def kelvin(*numbers: float) -> list[float]:
    return [round(number + 273.15, 6) for number in numbers]


SAND, AIR = kelvin(*range(40, 46)), kelvin(*range(20, 26))
TWO = {("K", "sand"): SAND, ("K", "air"): AIR}
INFLUX = ",result,table,_start,_time,_value,_field,_measurement"
CASES = {
    "a history": (
        rows("s.sand,4{m}.0,{t}:00.1Z", "s.air,2{m}.0,{t}:20.4Z", head="entity_id,state [C],last_changed"),
        {("K", "s.sand"): SAND, ("K", "s.air"): AIR},
    ),
    "a column of units": (
        rows("{t}:00Z,sand,°C,4{m}", "{t}:03Z,sky,klx,9{m}", head="time,name,unit_of_measurement,value"),
        {("K", "sand"): SAND, ("lx", "sky"): [90e3, 91e3, 92e3, 93e3, 94e3, 95e3]},
    ),
    "units in the cells": (
        rows("{t}:00Z,sand,4{m} °C", "{t}:03Z,sky,9{m} klx", head="time,topic,payload"),
        {("K", "sand"): SAND, ("lx", "sky"): [90e3, 91e3, 92e3, 93e3, 94e3, 95e3]},
    ),
    "numeric ids": (
        rows("{t}:00Z,1,4{m}", "{t}:31Z,2,2{m}", head="time,id,T [C]"),
        {("K", "1"): SAND, ("K", "2"): AIR},
    ),
    "inputs that come round, of no name": (
        rows("{t}:00Z,1,4{m}", "{t}:31Z,2,2{m}", head="time,x,T [C]"),
        {("K", "1"): SAND, ("K", "2"): AIR},
    ),
    "rows of one time, of no name": (rows("{t}:00Z,sand,4{m}", "{t}:00Z,air,2{m}", head="time,x,T [C]"), TWO),
    "words that alternate, of no name": (
        rows("{t}:00Z;sand;4{m}", "{t}:09Z;air;2{m}", head="time;x;T [C]"),
        TWO,
    ),
    "first one, then the other": (
        rows("{t}:00Z,sand,4{m}", head="time,plot,T [C]") + rows("{t}:30Z,air,2{m}", head="").lstrip(),
        TWO,
    ),
    "several values a row": (
        rows("d1,{t}:00Z,1,4{m},2{m}", "d2,{t}:40Z,1,2{m},4{m}", head="dev_id,received,f_port,bed_c,air_c"),
        {
            ("K", "d1 bed_c"): SAND, ("K", "d1 air_c"): AIR, ("K", "d2 bed_c"): AIR, ("K", "d2 air_c"): SAND,
            ("", "d1 f_port"): [1.0] * 6, ("", "d2 f_port"): [1.0] * 6,
        },
    ),
    "units in the names": (
        rows("{t}:00Z,home/sand/temp_c,4{m}", "{t}:03Z,home/sky/lux,9{m}", head="time,topic,payload"),
        {("K", "home/sand/temp_c"): SAND, ("lx", "home/sky/lux"): [90.0, 91.0, 92.0, 93.0, 94.0, 95.0]},
    ),
    "ids as a spreadsheet writes them": (
        rows("{t}:00Z,1.0,4{m}", "{t}:31Z,2.0,2{m}", head="time,id,T [C]"),
        {("K", "1.0"): SAND, ("K", "2.0"): AIR},
    ),
    "bursts of no name": (
        rows("{t}:00Z,1,4{m}", "{t}:20Z,1,4{m}", "{t}:40Z,2,2{m}", head="time,x,T [C]"),
        {("K", "1"): [number for number in SAND for _ in range(2)], ("K", "2"): AIR},
    ),
    "a database": (
        "#group,false,false,true,false,false,true,true\n"
        "#datatype,string,long,dateTime:RFC3339,dateTime:RFC3339,double,string,string\n#default,_result,,,,,,\n"
        + rows(",,0,2026-06-11T00:00:00Z,{t}:00Z,4{m},sand,°C", head=INFLUX)
        + "\n#group,false,false,true,false,false,true,true\n#default,_result,,,,,,\n"
        + rows(",,1,2026-06-11T00:00:00Z,{t}:30Z,9{m},sky,klx", head=INFLUX),
        {("K", "sand"): SAND, ("lx", "sky"): [90e3, 91e3, 92e3, 93e3, 94e3, 95e3]},
    ),
}  # fmt: skip


@pytest.mark.parametrize(("text", "expected"), CASES.values(), ids=CASES)
def test_a_row_per_sensor_becomes_a_channel_per_sensor(tmp_path, text, expected):
    imported = read(tmp_path, text, zone=None)
    assert channels(imported) == expected
    assert all(label.split()[0] in notes(imported) for _, label in expected)


@pytest.mark.parametrize("columns", ["x,T [C]", "note,T [C]", "OK,T [C]"])
@pytest.mark.parametrize(
    "cells", ["dry dry dry wet wet wet", "1 2 3 4 5 6", "20 20 21 21 20 20", "7 7 7 7 7 7"]
)
def test_a_note_or_a_number_beside_the_values_tells_no_things(tmp_path, columns, cells):
    text = "".join(
        f"{time}:00Z,{cell},4{m}\n" for m, (time, cell) in enumerate(zip(MINUTES, cells.split(), strict=True))
    )
    imported = read(tmp_path, f"time,{columns}\n{text}", zone=None, columns=("T",))
    assert channels(imported) == {("K", "T"): SAND}


def test_channels_are_chosen_by_the_things_and_all_units_are_asked_for(tmp_path):
    text = rows("{t}:00Z,sand,4{m}", "{t}:03Z,sky,9{m}000", head="time,entity_id,state")
    with pytest.raises(ConfigError, match=r"entity_id.*sand, sky") as caught:
        read(tmp_path, text, zone=None, unit="C")
    assert steps(caught.value) == [Argument("columns", "sand"), Argument("columns", "sky")]
    assert channels(read(tmp_path, text, zone=None, unit="C", columns=("sand",))) == {("K", "sand"): SAND}


def test_words_that_may_tell_things_are_named(tmp_path):
    words = ["sand", "air", "sand", "sand", "air", "air", "sand", "air", "sand"]
    text = "".join(f"2026-06-11T10:0{m}:00Z,{word},20.{m}\n" for m, word in enumerate(words))
    imported = read(tmp_path, "time,what,T [C]\n" + text, zone=None)
    assert imported.streams[0].channels == ("T",)
    assert "several what" in notes(imported)


def test_a_row_that_is_too_long_is_named_as_it_stands(tmp_path):
    text = (
        rows("{t}:00Z,sand,4{m}", "{t}:03Z,air,2{m}", head="time,name,T [C]") + "2026-06-11T11:00Z,sand,4,5\n"
    )
    imported = read(tmp_path, text, zone=None)
    assert "row 14 " in notes(imported)
    assert channels(imported) == TWO
