"""A socket of the guest that something is plugged into: connecting plugs it in, closing pulls the plug."""

from __future__ import annotations

import socket
import threading
from pathlib import Path
from typing import Self


class Plug:
    """A context manager: plugged inside, unplugged after; `serve` runs in a thread of its own meanwhile."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._thread: threading.Thread | None = None
        self._failure: BaseException | None = None

    def __enter__(self) -> Self:
        self.plug()
        return self

    def __exit__(self, *_: object) -> None:
        self.unplug()

    def plug(self) -> None:
        """Plug it in."""
        wire = socket.socket(socket.AF_UNIX)
        wire.connect(str(self._path))
        self._ending, self._end = socket.socketpair()
        self._thread = threading.Thread(target=self._run, args=(wire,), name=self._path.name, daemon=True)
        self._thread.start()

    def unplug(self) -> None:
        """Pull the plug; a second call does nothing. Raises what went wrong in the thread, if anything."""
        if self._thread is None:
            return
        self._end.close()
        self._thread.join()
        self._thread = None
        self._ending.close()
        if self._failure is not None:
            raise self._failure

    def serve(self, wire: socket.socket, ending: socket.socket) -> None:
        """Play the instrument on the wire until the other side goes away or `ending` is closed."""
        raise NotImplementedError

    def _run(self, wire: socket.socket) -> None:
        try:
            with wire:
                self.serve(wire, self._ending)
        except ConnectionError:
            pass  # the guest was switched off
        except BaseException as failure:
            self._failure = failure
