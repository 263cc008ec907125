import codecs
import subprocess
import sys
import tomllib

import pytest

from fieldkit.config import ConfigMistakesError
from fieldkit.config.edit import add_region, change_region, editing, remove_region, set_key
from fieldkit.config.files import key_lines
from fieldkit.model.errors import ConfigError, StorageError
from tests.harness.next_steps import at
from tests.harness.rights import ordinary_rights

TEXT = """\
# my campaign
[site]
latitude_deg = 35.5  # measured with the phone
longitude_deg = 139.4

[[region]]
name = "flat"  # the flat bed
kind = "reference"
points_px = [[0, 0], [9, 0], [9, 9]]

[surface]
albedo = 0.25
"""
BED = {"name": "b05", "kind": "target", "points_px": [[20, 0], [29, 0], [29, 9.5]]}


def changed(file, change, *arguments):
    with editing(file) as draft:
        change(draft, *arguments)


@pytest.fixture
def file(tmp_path):
    path = tmp_path / "fieldkit.toml"
    path.write_text(TEXT, encoding="utf-8")
    return path


def test_a_region_is_added_and_removed_and_nothing_else_is_touched(file):
    changed(file, add_region, BED)
    text = file.read_text()
    assert text.startswith(TEXT)
    assert tomllib.loads(text)["region"][1] == BED
    changed(file, remove_region, "b05")
    assert file.read_text().rstrip() == TEXT.rstrip()


def test_removing_keeps_the_comments_of_the_others(file):
    changed(file, add_region, BED)
    changed(file, remove_region, "flat")
    text = file.read_text()
    assert TEXT.split("\n")[2] in text  # with a comment
    assert [region["name"] for region in tomllib.loads(text)["region"]] == ["b05"]
    changed(file, remove_region, "b05")
    assert "region" not in tomllib.loads(file.read_text())


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"name": "FLAT"}, "'flat'"),
        ({"name": "no spaces"}, "letters, digits"),
        ({"points_px": [[0, 0], [1, 1]]}, "at least 3"),
        ({"tilt_deg": 95.0}, "0 to 90"),
    ],
)
def test_a_region_with_a_mistake_is_not_added(file, change, said):
    bed = {**BED, **change}
    where = f"{bed['name']}: region[1].{next(iter(change))}"
    with pytest.raises(ConfigMistakesError, match=said, check=at(where)):
        changed(file, add_region, bed)
    assert file.read_text() == TEXT


def test_a_region_that_is_not_there_cannot_be_removed(file):
    with pytest.raises(ConfigError, check=at("hill")) as caught:
        changed(file, remove_region, "hill")
    assert "flat" in caught.value.fix


def test_a_folder_that_takes_no_file_is_told(file):
    file.parent.chmod(0o500)
    with ordinary_rights(), pytest.raises(StorageError, check=at(file)):
        changed(file, add_region, BED)
    assert file.read_text() == TEXT


CHANGES = [
    lambda file: changed(file, add_region, BED),
    lambda file: changed(file, change_region, "flat", {"emissivity": 0.9}),
    lambda file: changed(file, remove_region, "flat"),
]


@pytest.mark.parametrize("change", CHANGES)
def test_a_linked_file_stays_a_link_and_keeps_who_may_read_it(file, tmp_path, change):
    file.chmod(0o640)
    link = tmp_path / "campaign" / "fieldkit.toml"
    link.parent.mkdir()
    link.symlink_to(file)
    change(link)
    assert link.is_symlink()
    assert file.read_text() != TEXT
    assert file.stat().st_mode & 0o777 == 0o640


@pytest.mark.parametrize("change", CHANGES)
@pytest.mark.parametrize("mark", [b"", codecs.BOM_UTF8])
@pytest.mark.parametrize("end", ["\n", "\r\n"])
def test_line_ends_and_byte_order_mark_stay_as_they_were(file, change, mark, end):
    file.write_bytes(mark + TEXT.replace("\n", end).encode())
    change(file)
    data = file.read_bytes()
    assert data.startswith(mark + b"# my campaign")
    assert data.count(b"\n") == data.count(end.encode())
    assert tomllib.loads(data.decode("utf-8-sig"))["site"]["latitude_deg"] == 35.5


@pytest.mark.parametrize("ending", ["", "\n"])
def test_a_new_key_stands_with_the_keys_of_its_region(file, ending):
    steep = '# steep\n[[region]]\nname = "b15"\npoints_px = [\n  [0, 20],\n  [9, 20],\n  [9, 29],\n]'
    file.write_text(TEXT.replace("[surface]", f"{steep}\n\n# the sand\n[surface]").rstrip() + ending)
    changed(file, change_region, "flat", {"emissivity": 0.9})
    changed(file, change_region, "b15", {"tilt_deg": 15.0, "azimuth_deg": 180.0})
    text = file.read_text()
    assert "[9, 9]]\nemissivity = 0.9\n\n# steep\n[[region]]\n" in text
    assert "\n]\ntilt_deg = 15.0\nazimuth_deg = 180.0\n\n# the sand\n[surface]\n" in text


@pytest.mark.parametrize("change", CHANGES[1:])
def test_tables_between_regions_stay_where_they_are(file, change):
    changed(file, add_region, BED)
    after = file.read_text().partition("\n[surface]")[2]
    change(file)
    assert file.read_text().partition("\n[surface]")[2] == after


def test_a_region_that_is_removed_leaves_the_comments_around_it(file):
    steep = '# the steep one\n[[region]]\nname = "b15"\npoints_px = [[0, 20], [9, 20], [9, 29]]\n\n'
    file.write_text(TEXT.replace("[surface]", f"{steep}# the sand\n[surface]"))
    changed(file, remove_region, "flat")
    assert f"longitude_deg = 139.4\n\n{steep}# the sand\n" in file.read_text()
    changed(file, remove_region, "b15")
    assert "# the sand\n[surface]\n" in file.read_text()


def test_a_new_key_at_the_end_of_a_file_has_a_line_of_its_own(file):
    file.write_text(TEXT.partition("\n[surface]")[0].rstrip())
    changed(file, change_region, "flat", {"emissivity": 0.9})
    assert tomllib.loads(file.read_text())["region"][0]["emissivity"] == 0.9


@pytest.mark.parametrize(
    "inline",
    ["region = []", 'region = [{ name = "flat", kind = "reference", points_px = [[0, 0], [9, 0], [9, 9]] }]'],
)
@pytest.mark.parametrize("change", CHANGES)
def test_regions_written_inline_are_left_to_the_hand(file, change, inline):
    text = inline + "\n[surface]\nalbedo = 0.25\n"
    file.write_text(text)
    with pytest.raises(ConfigError, check=at(file)) as caught:
        change(file)
    assert "[[region]]" in caught.value.fix
    assert file.read_text() == text


@pytest.mark.parametrize("change", CHANGES)
def test_a_file_of_other_letters_is_told(file, change):
    file.write_bytes("# März\n".encode("latin-1") + TEXT.encode())
    with pytest.raises(ConfigError, check=at(file)) as caught:
        change(file)
    assert "UTF-8" in caught.value.fix


def test_regions_added_at_the_same_time_are_all_there(file):
    """By processes: those of two terminals, or of a script that does not wait."""
    code = (
        "import sys; from pathlib import Path; from fieldkit.config.edit import add_region, editing\n"
        "for n in range(5):\n"
        "    with editing(Path(sys.argv[1])) as draft:\n"
        "        corners = [[20, 0], [29, 0], [29, 9]]\n"
        "        add_region(draft, {'name': f'b{sys.argv[2]}-{n}', 'points_px': corners})\n"
    )
    adding = [subprocess.Popen([sys.executable, "-c", code, str(file), str(n)]) for n in range(2)]
    assert [process.wait(timeout=120) for process in adding] == [0] * 2
    names = [region["name"] for region in tomllib.loads(file.read_text())["region"]]
    assert sorted(names) == sorted(["flat", *(f"b{n}-{m}" for n in range(2) for m in range(5))])
    assert [path.name for path in file.parent.iterdir()] == ["fieldkit.toml"]


@pytest.mark.parametrize("change", CHANGES)
@pytest.mark.parametrize("separator", ["\u2028", "\u2029", "\x85"])
def test_line_separators_in_comments_and_strings_end_no_line(file, change, separator):
    """As pasted from a web page or a word processor; TOML's own lines end with a line feed only."""
    written = TEXT.replace("the flat bed", f"the flat{separator}bed of = sand").replace(
        "# my campaign", f'# my{separator}[campaign]\n[campaign]\ntitle = "sand{separator}slopes"\n'
    )
    file.write_text(written, encoding="utf-8", newline="")
    before = tomllib.loads(written)
    change(file)
    after = tomllib.loads(file.read_text(encoding="utf-8"))
    assert after["campaign"] == before["campaign"]
    assert after["surface"] == before["surface"]
    assert key_lines(written)["region", 0, "name"] == written.split("\n").index("[[region]]") + 2


# --- a key of a table set in a file whose comments and other lines stay


BEFORE = """schema = 1
# where we are
[site]
latitude_deg = 35.5   # by GPS
longitude_deg = 139.4

# camera
[camera]
driver = "purethermal"
"""


SEVERAL_LINES = "horizon = [\n  [0, 1],\n  [90, 20],\n]\n\n# camera"


@pytest.mark.parametrize(
    ("before", "place"),
    [(BEFORE, "[site]\n"), (BEFORE.replace("\n# camera", SEVERAL_LINES), SEVERAL_LINES.rpartition("\n#")[0])],
    ids=["below the header", "for a value of several lines"],
)
def test_a_key_is_set_in_its_place(tmp_path, before, place):
    file = tmp_path / "fieldkit.toml"
    file.write_text(before)
    with editing(file) as draft:
        set_key(draft, "site", "horizon", "horizon.csv")
    header = place if place.startswith("[") else ""
    assert file.read_text() == before.replace(place, f'{header}horizon = "horizon.csv"\n')


def test_a_site_without_a_table_is_left_to_its_owner(tmp_path):
    file = tmp_path / "fieldkit.toml"
    text = "schema = 1\nsite = { latitude_deg = 35.5, longitude_deg = 139.4 }\n"
    file.write_text(text)
    with pytest.raises(ConfigError, check=at(file)), editing(file) as draft:
        set_key(draft, "site", "horizon", "horizon.csv")
    assert file.read_text() == text
