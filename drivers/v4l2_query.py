"""What a V4L2 device says of itself, without starting it: its name, and the pixel formats that it offers.

Two calls of the kernel (linux/videodev2.h): VIDIOC_QUERYCAP and VIDIOC_ENUM_FMT.
"""

import fcntl
import os
import struct
from collections.abc import Callable

QUERYCAP, ENUM_FMT = 0x80685600, 0xC0405602
CAPABILITY = struct.Struct("16s32s32sIII12x")  # driver, card, bus, version, capabilities, of this node
FORMAT = struct.Struct("III32s4s16x")  # index, type, flags, description, four characters
VIDEO_CAPTURE, IS_CAPTURE = 1, 1  # buffer type, capability bit

Ioctl = Callable[[int, int, bytearray], object]


def query(path: str, ioctl: Ioctl = fcntl.ioctl) -> tuple[str, list[str]]:
    """Its name, and formats as four characters. Raises OSError where it cannot be opened or is no camera."""
    fd = os.open(path, os.O_RDWR | os.O_NONBLOCK)
    try:
        data = bytearray(CAPABILITY.size)
        ioctl(fd, QUERYCAP, data)
        _, card, bus, _, _, node = CAPABILITY.unpack(data)
        if not node & IS_CAPTURE:
            raise OSError("it delivers no pictures; take its other node")
        formats: list[str] = []
        while True:
            data = bytearray(FORMAT.size)
            struct.pack_into("II", data, 0, len(formats), VIDEO_CAPTURE)
            try:
                ioctl(fd, ENUM_FMT, data)
            except OSError:  # EINVAL: that was the last
                break
            formats.append(FORMAT.unpack(data)[4].decode("ascii", "replace"))
        return f"{_text(card)} at {_text(bus)}", formats
    finally:
        os.close(fd)


def _text(field: bytes) -> str:
    return field.split(b"\0")[0].decode("utf-8", "replace")
