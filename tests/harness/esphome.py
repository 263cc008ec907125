"""An ESPHome device with one serial proxy, by the messages of its native API; unencrypted."""

from __future__ import annotations

import socket
import threading
import time
from contextlib import suppress
from typing import Any

from aioesphomeapi import api_pb2 as pb
from aioesphomeapi.core import MESSAGE_TYPE_TO_PROTO

NUMBERS = {proto: number for number, proto in MESSAGE_TYPE_TO_PROTO.items()}
CONFIGURED = pb.SERIAL_PROXY_REQUEST_TYPE_CONFIGURE


class SerialProxy:
    """Sends `talk` through its proxy ``meter`` to every client that subscribes."""

    def __init__(self, talk: bytes) -> None:
        self.lines: list[Any] = []
        """Requests for a line."""
        self._talk, self._listener = talk, socket.create_server(("127.0.0.1", 0))
        self.url = f"esphome://127.0.0.1:{self._listener.getsockname()[1]}/?port_name=meter"
        self._thread = threading.Thread(target=self._serve)
        self._thread.start()

    def unplug(self) -> None:
        """End the connection."""
        with suppress(OSError):
            self._connection.shutdown(socket.SHUT_RDWR)
        self._thread.join(5)
        self._connection.close()
        self._listener.close()

    def _serve(self) -> None:
        self._connection, _ = self._listener.accept()
        with self._connection.makefile("rb") as received, suppress(OSError):
            while received.read(1):
                length, number = _varint(received), _varint(received)
                self._answer(MESSAGE_TYPE_TO_PROTO[number].FromString(received.read(length)))

    def _answer(self, request: Any) -> None:
        match type(request).__name__:
            case "HelloRequest":
                self._send(pb.HelloResponse(api_version_major=1, api_version_minor=16, name="board"))
            case "AuthenticationRequest":
                self._send(pb.AuthenticationResponse())
            case "DeviceInfoRequest":
                self._send(pb.DeviceInfoResponse(serial_proxies=[pb.SerialProxyInfo(name="meter")]))
            case "SerialProxyConfigureRequest":
                self.lines.append(request)
                self._send(pb.SerialProxyRequestResponse(type=CONFIGURED))
            case "SerialProxyRequest":
                self._send(pb.SerialProxyRequestResponse(type=request.type))
                for _ in range(2):
                    self._send(pb.SerialProxyDataReceived(data=self._talk))
                    time.sleep(0.05)

    def _send(self, message: Any) -> None:
        body = message.SerializeToString()
        assert max(len(body), NUMBERS[type(message)]) < 1 << 14
        sizes = b"".join(bytes([n & 0x7F | 0x80, n >> 7]) for n in (len(body), NUMBERS[type(message)]))
        self._connection.sendall(b"\0" + sizes + body)


def _varint(stream: Any) -> int:
    number, shift = 0, 0
    while (byte := stream.read(1)[0]) & 0x80:
        number, shift = number | (byte & 0x7F) << shift, shift + 7
    return number | byte << shift
