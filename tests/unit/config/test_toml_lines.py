from fieldkit.config.files import key_lines

DOCUMENT = '''\
schema = 1
# a comment with [brackets] and = signs

[site]  # where
latitude_deg = 35.5
"quoted key" = 1
a.b.c = 2

[[region]]
name = """
[not a table]
nor = "a key"
"""
points_px = [
  [1, 2],  # ]
  [3, 4],
]
tilt_deg = 5
[region.more]
x = 1

[[ region ]]
name = "second"
[device.probe]
options = { labels = ["a"], deep = { er = 1 } }
'''


def test_every_key_and_table_has_the_line_it_stands_on():
    assert key_lines(DOCUMENT) == {
        ("schema",): 1,
        ("site",): 4,
        ("site", "latitude_deg"): 5,
        ("site", "quoted key"): 6,
        ("site", "a"): 7,
        ("site", "a", "b"): 7,
        ("site", "a", "b", "c"): 7,
        ("region",): 9,
        ("region", 0): 9,
        ("region", 0, "name"): 10,
        ("region", 0, "points_px"): 14,
        ("region", 0, "tilt_deg"): 18,
        ("region", 0, "more"): 19,
        ("region", 0, "more", "x"): 20,
        ("region", 1): 22,
        ("region", 1, "name"): 23,
        ("device", "probe"): 24,
        ("device", "probe", "options"): 25,
        ("device", "probe", "options", "labels"): 25,
        ("device", "probe", "options", "deep"): 25,
        ("device", "probe", "options", "deep", "er"): 25,
    }


def test_windows_line_ends_do_not_matter():
    assert key_lines("[site]\r\nlatitude_deg = 1\r\n") == {("site",): 1, ("site", "latitude_deg"): 2}
