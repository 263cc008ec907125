import tomllib

import pytest

from fieldkit.config import ConfigMistakesError
from fieldkit.config.edit import add_region, remove_region
from fieldkit.errors import ConfigError, StorageError

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


@pytest.fixture
def file(tmp_path):
    path = tmp_path / "fieldkit.toml"
    path.write_text(TEXT, encoding="utf-8")
    return path


def test_a_region_is_added_and_nothing_else_is_touched(file):
    add_region(file, BED)
    text = file.read_text()
    assert text.startswith(TEXT)
    assert tomllib.loads(text)["region"][1] == BED


def test_a_region_added_and_removed_leaves_the_other_words_as_they_were(file):
    add_region(file, BED)
    remove_region(file, "b05")
    assert file.read_text().rstrip() == TEXT.rstrip()


def test_removing_keeps_the_comments_of_the_others(file):
    add_region(file, BED)
    remove_region(file, "flat")
    text = file.read_text()
    assert "# measured with the phone" in text
    assert [region["name"] for region in tomllib.loads(text)["region"]] == ["b05"]
    remove_region(file, "b05")
    assert "region" not in tomllib.loads(file.read_text())


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"name": "FLAT"}, "two regions"),
        ({"name": "no spaces"}, "letters, digits"),
        ({"points_px": [[0, 0], [1, 1]]}, "at least 3"),
        ({"tilt_deg": 95.0}, "from 0 to 90"),
    ],
)
def test_a_region_with_a_mistake_is_not_added(file, change, said):
    with pytest.raises(ConfigMistakesError, match=said):
        add_region(file, {**BED, **change})
    assert file.read_text() == TEXT


def test_a_region_that_is_not_there_cannot_be_removed(file):
    with pytest.raises(ConfigError, match="'hill'") as caught:
        remove_region(file, "hill")
    assert "flat" in (caught.value.fix or "")


def test_a_folder_that_takes_no_file_is_told(file, monkeypatch):
    def refuse(*_: object) -> None:
        raise OSError(30, "Read-only file system")

    monkeypatch.setattr("os.replace", refuse)
    with pytest.raises(StorageError, match="Read-only file system"):
        add_region(file, BED)
    assert file.read_text() == TEXT
