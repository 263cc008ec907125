"""The recorder: one reading thread per device, one thread that writes, estimates and shows.

::

    device ─ Feed (thread) ─ Inbox (bounded per stream) ─ Recorder.run ─┬─ session (first)
                                                                        ├─ estimator
                                                                        └─ views (may fail)

The recording ends because somebody or the plan says so, or because nothing can be stored
any more; never because a device, the estimator or a view failed.
"""

from fieldkit.recorder.device_reader import Sampling
from fieldkit.recorder.recorder import Recorder, Summary, View
from fieldkit.recorder.sample_queue import SampleQueue

__all__ = ["Recorder", "SampleQueue", "Sampling", "Summary", "View"]
