"""Sessions from recordings of other programs, and for other programs."""
