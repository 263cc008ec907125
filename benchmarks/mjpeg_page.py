"""The page that everybody writes: Flask, and a multipart stream of coloured JPEG pictures for each viewer.

    python -m benchmarks.mjpeg_page PORT

It shows prepared pictures of the simulated sand slopes at the camera's rate.
"""

from __future__ import annotations

import itertools
import sys
import time
from collections.abc import Iterator

import cv2
import numpy as np
from flask import Flask, Response

from benchmarks.recorder import lepton_frames

RATE_HZ = 8.7
BOUNDARY = b"--frame\r\nContent-Type: image/jpeg\r\n\r\n"
app = Flask(__name__)
frames = [np.frombuffer(data, "<u2")[: 120 * 160].reshape(120, 160) for data in lepton_frames(90)]


def pictures() -> Iterator[bytes]:
    """One viewer's stream."""
    for counts in itertools.cycle(frames):
        low, high = float(counts.min()), float(counts.max())
        grey = ((counts - low) * (255.0 / (high - low))).astype(np.uint8)
        image = cv2.resize(cv2.applyColorMap(grey, cv2.COLORMAP_INFERNO), (640, 480))
        yield BOUNDARY + cv2.imencode(".jpg", image)[1].tobytes() + b"\r\n"
        time.sleep(1.0 / RATE_HZ)


@app.route("/stream")
def stream() -> Response:
    """The pictures, for as long as the browser is connected."""
    return Response(pictures(), mimetype="multipart/x-mixed-replace; boundary=frame")


if __name__ == "__main__":
    app.run("127.0.0.1", int(sys.argv[1]), threaded=True)
