"""From a session to numbers one can trust; functions of arrays."""
