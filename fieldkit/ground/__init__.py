"""From the frame to the ground: products of a slope map, on the ground by the camera's pose, and horizons."""
