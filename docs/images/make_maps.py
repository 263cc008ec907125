"""Images that fieldkit writes itself: a frame to draw regions on, the slope map, terrain products."""

from __future__ import annotations

from demo_day import DemoDay

IMAGES = ("frame.png", "slope-map.png", "risk-map.png")
WIDTH = 640


def main(day: DemoDay) -> None:
    """Run the commands that write them."""
    frame = day.folder / "frame.png"
    day.run("live", "-C", str(day.sandslope), "--png", str(frame), "--set", "simulation.speed=max")
    day.write_png(frame, "frame", WIDTH)
    maps = day.folder / "maps/beds"
    hour = next((day.sandslope / "recordings").glob("*clear.h5"))
    day.run("map", str(hour), "-o", str(maps), "--products", "ptilt", "--limit-deg", "10")
    day.write_png(maps.with_suffix(".png"), "slope-map", WIDTH)
    day.write_png(maps.with_name("beds-ptilt.png"), "risk-map", WIDTH)
