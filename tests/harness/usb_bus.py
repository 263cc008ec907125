"""A USB bus in memory, below pyusb: drivers and pyusb above it are the real ones, the bytes an instrument's.

pyusb reaches the wire by a backend object (`usb.backend.IBackend`); `Bus` is one. Like Linux it refuses what
is not allowed (errno EACCES), claimed by a kernel driver (EBUSY), silent (ETIMEDOUT) or gone (ENODEV).
"""

import errno
from types import SimpleNamespace

from usb.backend import IBackend
from usb.core import USBError, USBTimeoutError

IN, STRING = 0x80, 0x0300
GET_DESCRIPTOR = 0x06
US_ENGLISH = bytes([4, 3, 9, 4])


class Instrument:
    """What hangs on the bus; a kind of its own says its ids, endpoints, and how it answers.

    `endpoints` are (interface, alternate setting, its endpoints as address and transfer type: 2 bulk,
    3 interrupt).
    """

    ids = (0xFFFF, 0xFFFF)
    strings = ("maker", "product", "")
    endpoints = ()

    def __init__(self, port=2):
        self.port = port
        self.gone = self.forbidden = self.claimed_by_kernel = False

    def unplug(self):
        """Pull its cable."""
        self.gone = True

    def plug(self):
        """Put it back: it begins anew."""
        self.__init__(self.port)

    def control(self, kind, request, value, index, data):
        """Answer a control transfer: bytes for one that reads, None to stall."""

    def written(self, endpoint, data):
        """Take what is written to an endpoint."""

    def pending(self, endpoint):
        """What an endpoint has to say now, at most one transfer; empty for nothing."""
        return b""


class Bus(IBackend):
    """The instruments that are plugged in."""

    def __init__(self, *instruments):
        super().__init__()
        self.instruments = list(instruments)

    def enumerate_devices(self):
        return (one for one in self.instruments if not one.gone)

    def get_device_descriptor(self, one):
        names = [place * bool(text) for place, text in enumerate(one.strings, 1)]
        return SimpleNamespace(
            bLength=18, bDescriptorType=1, bcdUSB=0x0200,
            bDeviceClass=0, bDeviceSubClass=0, bDeviceProtocol=0, bMaxPacketSize0=64,
            idVendor=one.ids[0], idProduct=one.ids[1], bcdDevice=0x0100,
            iManufacturer=names[0], iProduct=names[1], iSerialNumber=names[2], bNumConfigurations=1,
            address=one.port + 1, bus=1, port_number=one.port, port_numbers=(one.port,), speed=3,
        )  # fmt: skip

    def get_configuration_descriptor(self, one, config):
        interfaces = {number for number, _, _ in one.endpoints}
        return SimpleNamespace(
            bLength=9, bDescriptorType=2, wTotalLength=9, bNumInterfaces=len(interfaces),
            bConfigurationValue=1,
            iConfiguration=0, bmAttributes=0x80, bMaxPower=250, extra_descriptors=[],
        )  # fmt: skip

    def get_interface_descriptor(self, one, intf, alt, config):
        points = _endpoints(one).get((intf, alt))
        if points is None:
            raise IndexError(f"no interface {intf}, {alt}")
        return SimpleNamespace(
            bLength=9, bDescriptorType=4, bInterfaceNumber=intf, bAlternateSetting=alt,
            bNumEndpoints=len(points), bInterfaceClass=255, bInterfaceSubClass=0, bInterfaceProtocol=0,
            iInterface=0, extra_descriptors=[],
        )  # fmt: skip

    def get_endpoint_descriptor(self, one, ep, intf, alt, config):
        address, kind = _endpoints(one)[intf, alt][ep]
        return SimpleNamespace(
            bLength=7, bDescriptorType=5, bEndpointAddress=address, bmAttributes=kind, wMaxPacketSize=64,
            bInterval=1, bRefresh=0, bSynchAddress=0, extra_descriptors=[],
        )  # fmt: skip

    def open_device(self, one):
        _check(one)
        return one

    def close_device(self, one):
        pass

    def get_configuration(self, one):
        _check(one)
        return 1

    def set_configuration(self, one, config_value):
        _check(one)

    def set_interface_altsetting(self, one, intf, altsetting):
        _check(one)

    def claim_interface(self, one, intf):
        _check(one)
        if one.claimed_by_kernel:
            raise USBError("Resource busy", errno=errno.EBUSY)

    def release_interface(self, one, intf):
        _check(one)

    def is_kernel_driver_active(self, one, intf):
        return one.claimed_by_kernel

    def detach_kernel_driver(self, one, intf):
        one.claimed_by_kernel = False

    def ctrl_transfer(self, one, kind, request, value, index, data, timeout):
        _check(one)
        if kind == IN and request == GET_DESCRIPTOR and value & 0xFF00 == STRING:
            answer = _string(one, value & 0xFF)
        else:
            answer = one.control(kind, request, value, index, len(data) if kind & IN else data.tobytes())
        if answer is None:
            raise USBError("Pipe error", errno=errno.EPIPE)
        return _fill(data, answer) if kind & IN else len(data)

    def bulk_read(self, one, ep, intf, buff, timeout):
        _check(one)
        said = one.pending(ep)
        if not said:
            raise USBTimeoutError("Operation timed out", errno=errno.ETIMEDOUT)
        return _fill(buff, said)

    def bulk_write(self, one, ep, intf, data, timeout):
        _check(one)
        one.written(ep, data.tobytes())
        return len(data)

    intr_read, intr_write = bulk_read, bulk_write


def _endpoints(one):
    return {(interface, alternate): points for interface, alternate, points in one.endpoints}


def _check(one):
    if one.gone:
        raise USBError("No such device", errno=errno.ENODEV)
    if one.forbidden:
        raise USBError("Access denied", errno=errno.EACCES)


def _string(one, index):
    if index == 0:
        return US_ENGLISH
    text = one.strings[index - 1].encode("utf-16-le")
    return bytes([2 + len(text), 3]) + text


def _fill(buffer, answer):
    for place, byte in enumerate(answer[: len(buffer)]):
        buffer[place] = byte
    return min(len(answer), len(buffer))
