"""The browser of the tests in Chromium, one for each file."""

import pytest

from tests.harness.field_page import chromium


@pytest.fixture(scope="module")
def browser():
    with chromium() as browser:
        yield browser


@pytest.fixture
def closed_afterwards(browser):
    """Close what a test has opened: a page serves few browsers at once."""
    yield
    for context in browser.contexts:
        context.close()
