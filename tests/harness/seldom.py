"""Meters read every 4 s: a simulated recording takes half the time where their rate is not what is tested."""

SELDOM = ("lux.every_s=4", "thermometer.every_s=4")
SET_SELDOM = ("--set", SELDOM[0], "--set", SELDOM[1])
