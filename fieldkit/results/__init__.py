"""From sessions to results as plain functions: minutes, slopes, maps, checks, reports, exports, imports.

They raise, return results and report progress through callbacks; they never print or ask.
"""
