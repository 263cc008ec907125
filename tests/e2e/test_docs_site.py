"""The check of the built documentation finds what it is for; ``make docs`` runs it on the site itself."""

import pytest

from tests.e2e.test_docs import loaded
from tests.harness.field_page import axe_source, chromium

SOUND = '<!doctype html><html lang="en"><title>A</title><main><h1>A</h1>{}</main></html>'
FAULTS = {
    "fetches": '<img alt="" src="http://192.0.2.1/a.png">',
    "does not find": '<img alt="" src="missing.png">',
    "wider than a phone": '<div style="width: 600px">x</div>',
}
"""What is wrong with a page, by words of the report; the address is one for documentation (RFC 5737)."""

site = loaded("check_site")


@pytest.fixture(scope="module")
def page():
    with chromium() as browser:
        page = browser.new_page(viewport=site.PHONE)
        page.route("http://**", lambda route: route.abort())
        yield page


def problems(page, folder, body, axe=None):
    path = folder / "page.html"
    path.write_text(SOUND.format(body), encoding="utf-8")
    return list(site.of_page(page, path, axe))


@pytest.mark.parametrize("words", FAULTS)
def test_a_fault_is_found_and_only_that(page, tmp_path, words):
    assert problems(page, tmp_path, "x") == []
    (problem,) = problems(page, tmp_path, FAULTS[words])
    assert words in problem


def test_an_image_without_words_is_found_by_axe(page, tmp_path):
    assert problems(page, tmp_path, "x", axe_source()) == []
    (problem,) = problems(
        page, tmp_path, '<img src="data:image/gif;base64,R0lGODlhAQABAAAAACw=">', axe_source()
    )
    assert problem.startswith("image-alt")


def test_sheets_are_counted(page, tmp_path):
    path = tmp_path / "page.html"
    for sheets in (1, 2):
        path.write_text(
            SOUND.format('<p style="break-after: page">x</p>' * (sheets - 1) + "y"), encoding="utf-8"
        )
        assert site.sheets(path, page.context.browser) == sheets
