"""Meters: illuminometers and contact thermometers, one module per protocol."""
