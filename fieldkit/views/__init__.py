"""Views: the terminal while recording; images, reports, plan and study pages afterwards.

A view receives samples, events, minutes and health through `show`; it only reads them, and a recording never
depends on it. Pages are rendered from the templates in ``templates/``.
"""
