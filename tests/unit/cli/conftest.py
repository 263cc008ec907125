"""What commands say is worded for the command line, also where a test looks at the error itself."""

import pytest

from fieldkit.model.wording import typed


@pytest.fixture(autouse=True)
def in_a_terminal():
    with typed():
        yield
