"""Physics of sun, surface and radiation: pure functions, arrays in, arrays out."""
