"""Does another checkout find the same numbers? ``make same OTHER=../other-checkout``."""
