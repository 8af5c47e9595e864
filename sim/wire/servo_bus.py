"""Emulated servos on one half-duplex bus: what each instruction makes them do and say."""

from sim.wire import packets
from sim.wire.packets import BROADCAST, Parser, crc16, status
from sim.wire.servo import Servo

END = 147  # of the control table


class ServoBus:
    """Implements `sim.wire.line.Device`."""

    busy_s = 0.0

    def __init__(self, servos: dict[int, Servo]):
        self.servos = servos
        self.deaf: set[int] = set()  # ids whose cable is off
        self.parser = Parser()
        self.log: list[tuple[int, int]] | None = None  # (id, instruction) of all packets, if somebody wants them
        self._registered: dict[int, tuple[int, bytes]] = {}

    def receive(self, data: bytes) -> list[bytes]:
        out: list[bytes] = []
        for number, instruction, params, good in self.parser.feed(data):
            if self.log is not None:
                self.log.append((number, instruction))
            if not good:
                if number in self.servos:
                    out.append(status(number, 3 | self.servos[number].alert))
                continue
            for servo in self.servos.values():
                servo.feed()
            out += self._obey(number, instruction, params)
        return out

    def restarted(self) -> None:
        """Servos are fed by their own supply: a USB plug is nothing to them."""

    def _there(self, number: int) -> list[Servo]:
        chosen = self.servos.values() if number == BROADCAST else [self.servos[number]] if number in self.servos else []
        return [s for s in chosen if s.id not in self.deaf]

    def _obey(self, number: int, instruction: int, p: bytes) -> list[bytes]:
        if instruction in (0x82, 0x8A):
            address, size = _two(p)
            return self._blocks([(i, address, size) for i in p[4:]], fast=instruction == 0x8A)
        if instruction in (0x92, 0x9A):
            wanted = [(p[k], *_two(p[k + 1 : k + 5])) for k in range(0, len(p), 5)]
            return self._blocks(wanted, fast=instruction == 0x9A)
        if instruction == 0x83:
            address, size = _two(p)
            for k in range(4, len(p), 1 + size):
                for servo in self._there(p[k]):
                    servo.write(address, p[k + 1 : k + 1 + size])
            return []
        if instruction == 0x93:
            while len(p) >= 5:
                address, size = _two(p[1:5])
                for servo in self._there(p[0]):
                    servo.write(address, p[5 : 5 + size])
                p = p[5 + size :]
            return []
        replies = [status(s.id, *self._single(s, instruction, p)) for s in self._there(number)]
        return replies if number != BROADCAST or instruction == 0x01 else []

    def _single(self, s: Servo, instruction: int, p: bytes) -> tuple[int, bytes]:
        error, data = 0, b""
        if instruction == 0x01:
            data = bytes([*s.table[0:2], s.table[6]])
        elif instruction == 0x02:
            address, size = _two(p)
            if address + size > END:
                return 4 | s.alert, b""
            data = s.read(address, size)
        elif instruction == 0x03:
            error = s.write(int.from_bytes(p[:2], "little"), p[2:])
        elif instruction == 0x04:
            self._registered[s.id] = int.from_bytes(p[:2], "little"), p[2:]
        elif instruction == 0x05:
            if s.id in self._registered:
                error = s.write(*self._registered.pop(s.id))
        elif instruction == 0x08:
            s.power_on()
        elif instruction == 0x10:
            pass  # multi-turn counts: position mode has none
        else:
            error = 2
        return error | s.alert, data

    def _blocks(self, wanted: list[tuple[int, int, int]], fast: bool) -> list[bytes]:
        """Sync and bulk reads. An absent servo ends it: those behind it wait for its reply and never answer."""
        found = []
        for number, address, size in wanted:
            there = self._there(number)
            if not there:
                break
            found.append((there[0], there[0].read(address, size)))
        if not fast:
            return [status(s.id, s.alert, data) for s, data in found]
        if len(found) < len(wanted) or not found:
            return []
        # one packet for all: error, id, data of each, with a running CRC after each but the last
        length = sum(len(d) + 4 for _, d in found) + 1
        out = packets.HEADER + bytes([BROADCAST]) + length.to_bytes(2, "little") + bytes([packets.STATUS])
        for s, data in found:
            out += bytes([s.alert, s.id]) + data
            out += crc16(out).to_bytes(2, "little")
        return [out]


def _two(p: bytes) -> tuple[int, int]:
    return int.from_bytes(p[:2], "little"), int.from_bytes(p[2:4], "little")
