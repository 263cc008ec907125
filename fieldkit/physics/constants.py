"""Physical constants (CODATA 2018), exact in the SI to the digits given."""

from __future__ import annotations

STEFAN_BOLTZMANN = 5.670374419e-8
"""sigma, W m-2 K-4."""
FIRST_RADIATION = 3.741771852e-16
"""2 pi h c^2, W m2."""
SECOND_RADIATION = 1.438776877e-2
"""h c / k, m K."""
