"""Order of the sections in the built documentation: what a newcomer needs first stands first."""

from __future__ import annotations

from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import Files
from mkdocs.structure.nav import Navigation

SECTIONS = ("Tutorial", "How to", "Reference", "Explanation")


def on_nav(nav: Navigation, config: MkDocsConfig, files: Files) -> Navigation:
    """Called by mkdocs once it has found the pages; pages outside the sections stay in front."""
    order = {title: number for number, title in enumerate(SECTIONS, start=1)}
    nav.items.sort(key=lambda item: order.get(item.title or "", 0))
    return nav
