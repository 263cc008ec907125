"""What the theme leaves out of a page: the name of its search dialog, which screen readers announce."""

from __future__ import annotations

from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.pages import Page

NAMELESS = 'data-md-component="search" role="dialog"'


def on_post_page(output: str, page: Page, config: MkDocsConfig) -> str:
    """Called by mkdocs with each page as it is written."""
    return output.replace(NAMELESS, f'{NAMELESS} aria-label="Search"')
