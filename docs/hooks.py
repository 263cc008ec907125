"""What the theme lacks: a name of its search dialog for screen readers, and a search without decisions."""

from __future__ import annotations

from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import Files
from mkdocs.structure.pages import Page

NAMELESS = 'data-md-component="search" role="dialog"'


def on_page_markdown(markdown: str, page: Page, config: MkDocsConfig, files: Files) -> None:
    """Called by mkdocs with each page as it is read: who searches wants to use fieldkit, not to change it."""
    if page.file.src_uri.startswith("explanation/decisions/"):
        page.meta["search"] = {"exclude": True}  # as `search: {exclude: true}` at the head of a page


def on_post_page(output: str, page: Page, config: MkDocsConfig) -> str:
    """Called by mkdocs with each page as it is written."""
    return output.replace(NAMELESS, f'{NAMELESS} aria-label="Search"')
