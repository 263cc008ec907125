"""A USB video camera as a pure library: bytes in, bytes out; no sockets, no clock, no threads.

Sources: "USB Device Class Definition for Video Devices" 1.0 (descriptors: section 3,
requests: section 4, payloads: section 2.4.3) and "Universal Serial Bus Specification" 2.0,
chapter 9. All numbers are little endian.
"""
