"""From the frame to the ground: products of a slope map, and both on the ground by the camera's pose."""
