"""The spectrometer's own protocol: `S`, exposure in microseconds (u32), pixels (u16), all little endian; it answers
with so many counts (u16) and their sum modulo 65536."""

import socket
import struct

import numpy as np

FULL = 65_535


class Link:
    def __init__(self, host: str, port: int, timeout_s: float = 2.0):
        self.address, self.timeout_s = (host, port), timeout_s
        self.socket: socket.socket | None = None

    def open(self) -> None:
        self.close()
        self.socket = socket.create_connection(self.address, self.timeout_s)

    def close(self) -> None:
        if self.socket is not None:
            self.socket.close()
            self.socket = None

    def spectrum(self, seconds: float, pixels: int) -> np.ndarray:
        """Counts (pixels,), uint16. Raises OSError, ValueError for a damaged answer."""
        if self.socket is None:
            raise OSError("not open")
        self.socket.settimeout(self.timeout_s + seconds)
        self.socket.sendall(b"S" + struct.pack("<IH", round(1e6 * seconds), pixels))
        answer = b""
        while len(answer) < 2 * pixels + 2:
            part = self.socket.recv(65536)
            if not part:
                raise OSError("it hung up")
            answer += part
        counts = np.frombuffer(answer, "<u2")
        if len(counts) != pixels + 1 or counts[:-1].sum() % 65536 != counts[-1]:
            raise ValueError("a damaged answer")
        return counts[:-1]
