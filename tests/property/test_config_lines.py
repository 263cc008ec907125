"""Any document that tomlkit writes: each key is found on a line that begins with it."""

import tomlkit
from hypothesis import given
from hypothesis import strategies as st

from fieldkit.config.files import key_lines

keys = st.from_regex(r"[a-z][a-z0-9_]{0,6}", fullmatch=True)
values = st.one_of(
    st.integers(-99, 99),
    st.booleans(),
    st.text("ab \n=[]{}#'\"\\", max_size=12),
    st.lists(st.lists(st.integers(0, 9), max_size=3), max_size=3),
)
tables = st.dictionaries(keys, values, max_size=5)


@given(st.dictionaries(keys, st.one_of(tables, st.lists(tables, min_size=1, max_size=3)), max_size=4))
def test_each_key_stands_on_its_line(document):
    text = tomlkit.dumps(document)
    lines, found = text.splitlines(), key_lines(text)
    for name, content in document.items():
        elements = enumerate(content) if isinstance(content, list) else [(None, content)]
        for index, table in elements:
            path = (name,) if index is None else (name, index)
            for key in table:
                assert lines[found[(*path, key)] - 1].startswith(f"{key} =")
