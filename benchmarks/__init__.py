"""Paired measurements: each a ratio, in one run, against what a user would write or pick instead."""
