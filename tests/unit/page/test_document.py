"""The document of the field page: small, whole, and with nothing in it that its policy forbids."""

import gzip
import re
from html.parser import HTMLParser

import pytest

from fieldkit.page.document import document
from fieldkit.phrases import LANGUAGES

MAX_GZIP_BYTES = 40_000
NONCE = "aB3-_x"


class Elements(HTMLParser):
    """The elements of a document with their attributes."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.found: list[tuple[str, dict[str, str | None]]] = []
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.found.append((tag, dict(attrs)))


@pytest.mark.parametrize("language", LANGUAGES)
def test_it_is_small_and_every_placeholder_is_filled(language):
    page = document(NONCE, language)
    assert f'lang="{language}"' in page
    assert len(gzip.compress(page.encode())) <= MAX_GZIP_BYTES
    assert "{{" not in page


def test_each_answer_carries_its_own_nonce_and_only_that():
    for nonce in (NONCE, "another"):
        marked = [
            attributes for tag, attributes in Elements(document(nonce)).found if tag in ("script", "style")
        ]
        assert [attributes["nonce"] for attributes in marked] == [nonce, nonce]


def test_nothing_inline_and_nothing_from_elsewhere():
    for tag, attributes in Elements(document(NONCE)).found:
        assert "style" not in attributes, tag
        assert not [name for name in attributes if name.startswith("on")], tag
        for source in (attributes.get("src"), attributes.get("href")):
            assert source is None or source.startswith(("#", "data:")), (tag, source)
    assert not re.findall(r"https?://(?!www\.w3\.org/2000/svg)", document(NONCE))


def test_text_never_becomes_markup():
    forbidden = r"innerHTML|outerHTML|insertAdjacentHTML|document\.write|\beval\(|new Function|srcdoc"
    assert not re.findall(forbidden, document(NONCE))


def test_every_label_id_and_reference_exists_once():
    elements = Elements(document(NONCE)).found
    ids = [str(attributes["id"]) for _, attributes in elements if "id" in attributes]
    assert len(ids) == len(set(ids))
    for _, attributes in elements:
        for key in ("aria-labelledby", "aria-describedby", "for"):
            assert set(str(attributes.get(key) or "").split()) <= set(ids)
    assert set(re.findall(r'\$\("([\w-]+)"\)', document(NONCE))) <= set(ids)
