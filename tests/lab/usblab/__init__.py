"""A virtual USB lab: emulated instruments on one side, a real Linux kernel on the other.

`uvc` is a USB camera as a pure library, `models` are the instruments played with it,
`redir` and `port` carry them into the emulator, `guest` builds and runs the small Linux
that sees them, `inside` is the code that runs in there. Nothing here knows pytest.
"""
