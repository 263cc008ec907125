"""The recorder: one reading thread per device, one that stores and shows, and one that estimates.

A sample goes from `DeviceReader` through the bounded `SampleQueue` to `Recorder.run`: to the session first,
then to the estimator, then to the views. A failing device, estimator or view never ends a recording.
"""

from fieldkit.recorder.device_reader import Sampling
from fieldkit.recorder.estimator_thread import EstimatorThread
from fieldkit.recorder.recorder import Recorder, ShutterRequest, Summary, View
from fieldkit.recorder.sample_queue import SampleQueue

__all__ = ["EstimatorThread", "Recorder", "SampleQueue", "Sampling", "ShutterRequest", "Summary", "View"]
