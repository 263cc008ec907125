"""Vendor requests by pyusb while uvcvideo holds the camera and streams."""

from __future__ import annotations

import errno
from typing import Any

import usb.core

from fieldkit.drivers.cameras.v4l2 import V4l2Source
from fieldkit.model.clock import HostClock


def ask_p2pro_while_streaming(path: str) -> dict[str, Any]:
    """Read the firmware date, set low gain and read it back, pictures flowing before, between and after."""
    device = usb.core.find(idVendor=0x0BDA, idProduct=0x5830)  # loads libusb, for longer than buffers last
    source = V4l2Source(path, "YUYV", [(256, 384)], HostClock())
    sequences: list[int] = []
    try:
        _watch(source, sequences)
        device.ctrl_transfer(0x41, 0x45, 0x78, 0x1D00, bytes.fromhex("0584 01000000 0008"))
        date = bytes(device.ctrl_transfer(0xC1, 0x44, 0x78, 0x1D08, 8))
        _watch(source, sequences)
        device.ctrl_transfer(0x41, 0x45, 0x78, 0x9D00, bytes.fromhex("14c5 0005 00000000"))
        device.ctrl_transfer(0x41, 0x45, 0x78, 0x1D08, bytes(8))
        device.ctrl_transfer(0x41, 0x45, 0x78, 0x9D00, bytes.fromhex("1485 0005 00000000"))
        device.ctrl_transfer(0x41, 0x45, 0x78, 0x1D08, bytes.fromhex("00000000 00000002"))
        gain = bytes(device.ctrl_transfer(0xC1, 0x44, 0x78, 0x1D10, 2))
        class_request = _class_request(device)
        _watch(source, sequences)
    finally:
        source.close()
        usb.util.dispose_resources(device)
    return {"date": date.hex(), "gain": gain.hex(), "class_request": class_request, "sequences": sequences}


def _watch(source: V4l2Source, sequences: list[int], pictures: int = 10) -> None:
    for _ in range(pictures):
        buffer = source.read(1.0)
        if buffer is not None:
            sequences.append(buffer.sequence)


def _class_request(device: usb.core.Device) -> str:
    try:
        device.ctrl_transfer(0xA1, 0x85, 0x0100, 0x0200, 2)
    except usb.core.USBError as error:
        return errno.errorcode.get(error.errno or 0, str(error))
    return "allowed"
