"""Pseudo-terminals that can be unplugged, served by one thread, and what may go wrong on them."""

import contextlib
import heapq
import itertools
import os
import select
import threading
import time
import tty
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Protocol

import numpy as np

TICK_S = 0.003  # between two turns of the loop of a device that sends by itself
FULL_S = 1.0  # that a host may leave a terminal full; the rest is lost then


class Device(Protocol):
    """What sits at the far end of a line. busy_s: machine seconds that it takes for its last answer."""

    busy_s: float

    def receive(self, data: bytes) -> list[bytes]:
        """Bytes from the host; packets to answer with."""
        ...

    def restarted(self) -> None:
        """Its port was opened anew, or its USB plug was out: an Arduino begins from the beginning."""
        ...


@dataclass
class Wire:
    """Share of packets that go wrong, each in its own way; late replies come after `late_s` seconds."""

    lost_byte: float = 0.0
    flipped_bit: float = 0.0
    lost_packet: float = 0.0
    late: float = 0.0
    late_s: float = 0.045
    seed: int = 0
    count: int = 0
    rng: np.random.Generator = field(init=False)

    def __post_init__(self) -> None:
        self.rng = np.random.default_rng(self.seed)

    @property
    def clean(self) -> bool:
        return not (self.lost_byte or self.flipped_bit or self.lost_packet or self.late)

    def carry(self, packet: bytes) -> tuple[bytes, float]:
        """What arrives of a packet, and after how many seconds."""
        if self.clean or not packet:
            return packet, 0.0
        u = self.rng.random()
        for share, kind in ((self.lost_byte, "byte"), (self.flipped_bit, "bit"), (self.lost_packet, "packet")):
            if u < share:
                self.count += 1
                k = int(self.rng.integers(len(packet)))
                if kind == "byte":
                    return packet[:k] + packet[k + 1 :], 0.0
                if kind == "packet":
                    return b"", 0.0
                return packet[:k] + bytes([packet[k] ^ 1 << int(self.rng.integers(8))]) + packet[k + 1 :], 0.0
            u -= share
        if u < self.late:
            self.count += 1
            return packet, self.late_s
        return packet, 0.0


class Line:
    """One pseudo-terminal; the host opens `path`, a symbolic link that follows a replug."""

    def __init__(self, path: Path, device: Device):
        self.path, self.device = path, device
        self.wire = Wire()
        self.packets = 0  # times that bytes came from the host
        self.plans: dict[int, Callable[[], None]] = {}  # what happens when so many have come, before they are obeyed
        self.busy_until = 0.0  # what comes after a late packet waits behind it: a line keeps its order
        self.fds: tuple[int, int] | None = None
        self.plug()

    def plug(self) -> None:
        host, slave = os.openpty()
        tty.setraw(slave)
        os.set_blocking(host, False)
        self.fds = host, slave
        self.path.unlink(missing_ok=True)
        self.path.symlink_to(os.ttyname(slave))

    def detach(self) -> tuple[int, ...]:
        """Gone from the folder; the file descriptors, still to be closed."""
        fds, self.fds = self.fds, None
        self.path.unlink(missing_ok=True)
        return fds or ()


class Server(threading.Thread):
    """Serves lines until `close`."""

    def __init__(self, lines: list[Line]):
        super().__init__(daemon=True, name="wire")
        self.lines = lines
        self.lock = threading.RLock()
        self._wake = os.pipe()
        self._closed = False
        self._rounds = 0
        self._late: list[tuple[float, int, Line, bytes]] = []
        self._order = itertools.count()
        self.start()

    def run(self) -> None:
        talkers = [line for line in self.lines if hasattr(line.device, "tick")]
        while not self._closed:
            self._rounds += 1
            ports = {line.fds[0]: line for line in self.lines if line.fds}
            left = max(0.0, self._late[0][0] - time.monotonic()) if self._late else None
            if talkers:
                left = TICK_S if left is None else min(left, TICK_S)
            try:
                ready = select.select([self._wake[0], *ports], [], [], left)[0]
            except (OSError, ValueError):
                continue  # unplugged meanwhile
            with self.lock:
                self._send_late()
                for line in talkers:
                    self._talk(line)
                for fd in ready:
                    if fd == self._wake[0]:
                        os.read(fd, 64)
                    elif (line := ports[fd]).fds:
                        self._serve(line)

    def _serve(self, line: Line) -> None:
        assert line.fds
        try:
            data = os.read(line.fds[0], 4096)
        except OSError:
            return
        line.packets += 1
        if (plan := line.plans.pop(line.packets, None)) is not None:
            plan()
        data, _ = line.wire.carry(data)
        at_once = b""
        for reply in line.device.receive(data) if data else ():
            packet, delay = line.wire.carry(reply)
            now = time.monotonic()
            delay = max(delay + line.device.busy_s, line.busy_until - now)
            if delay > 1e-4:  # less than that is gone already
                line.busy_until = now + delay
                heapq.heappush(self._late, (line.busy_until, next(self._order), line, packet))
            else:
                at_once += packet
        self._write(line, at_once)

    def _send_late(self) -> None:
        while self._late and self._late[0][0] <= time.monotonic():
            *_, line, packet = heapq.heappop(self._late)
            self._write(line, packet)

    def _talk(self, line: Line) -> None:
        """One turn of the loop of a device that sends by itself; what the terminal does not hold is lost."""
        if line.fds:
            with contextlib.suppress(OSError):
                os.write(line.fds[0], line.device.tick())  # type: ignore[attr-defined]

    def say(self, line: Line, text: bytes) -> None:
        """What a device says without being asked."""
        with self.lock:
            self._write(line, text)

    def _write(self, line: Line, packet: bytes) -> None:
        with contextlib.suppress(OSError):
            while line.fds and packet:
                try:
                    packet = packet[os.write(line.fds[0], packet) :]
                except BlockingIOError:  # the terminal is full: as soon as the host has read
                    if not select.select([], [line.fds[0]], [], FULL_S)[1]:
                        return

    def unplug(self, line: Line) -> None:
        """Gone when this returns: a pseudo-terminal that is still waited on would live a little longer."""
        with self.lock:
            fds = line.detach()
        before, end = self._rounds, time.monotonic() + 1
        self._poke()
        while self._rounds == before and time.monotonic() < end:
            time.sleep(5e-4)
        for fd in fds:
            os.close(fd)

    def flap(self, line: Line) -> None:
        """Out and in again at once, by another pseudo-terminal. For a plan: in the server's own thread."""
        fds = line.detach()
        line.plug()
        for fd in fds:
            os.close(fd)
        line.device.restarted()

    def send_late(self) -> None:
        """What is late comes now."""
        with self.lock:
            self._late = [(0.0, order, line, packet) for _, order, line, packet in self._late]
            self._send_late()

    def plug(self, line: Line) -> None:
        with self.lock:
            line.plug()
        self._poke()

    def close(self) -> None:
        self._closed = True
        self._poke()
        self.join(timeout=5)
        for fd in (*(fd for line in self.lines for fd in line.detach()), *self._wake):
            os.close(fd)

    def _poke(self) -> None:
        with contextlib.suppress(OSError):
            os.write(self._wake[1], b"x")
