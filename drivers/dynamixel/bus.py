"""One owner for a bus of Dynamixel servos: every transaction is whole, verified, and repeated when the wire lied.

The handlers of dynamixel-sdk do the packets. What they do not see (HARDWARE: the seven traps) is seen here: a lock in
place of a flag; after a timeout the line is let fall silent and cleared, and a ping has to be answered before anything
else is believed, so that no late reply is taken for the next one; the error byte and the length are looked at before
the value; each servo's error byte of a sync read is kept.
"""

import threading
from collections.abc import Callable, Mapping, Sequence
from typing import TypeVar

from dynamixel_sdk import COMM_RX_CORRUPT, COMM_SUCCESS

from drivers.dynamixel.handler import PacketHandler
from drivers.dynamixel.port import BAUDS, Port
from drivers.dynamixel.tables import STATUS_ERRORS, Register
from drivers.gone import PortGone
from gonio.rig.errors import DeviceFault

TRIES = 6  # a ping that puts the line in step again takes one of them
QUIET_S = 0.03  # after a timeout, until the line counts as silent: longer than a USB latency timer of 16 ms
DAMAGED_S = 0.005  # after a damaged reply: only the rest of it can still come
ALERT = 0x80

T = TypeVar("T")


class NoAnswer(Exception):
    """A transaction failed on the wire: nothing came, or not what was asked for. quiet: seconds until that is over."""

    quiet = QUIET_S


class Refused(Exception):
    """A servo answered with an error; `code` as in STATUS_ERRORS."""

    def __init__(self, code: int):
        super().__init__(STATUS_ERRORS.get(code, f"status error {code}"))
        self.code = code


class Bus:
    """names: servo id -> what the operator calls it. Methods may be called from any thread."""

    def __init__(self, name: str, baud: int, names: Mapping[int, str]):
        if baud not in BAUDS:
            raise DeviceFault(
                "stage", f"baud rate {baud} is none of {', '.join(map(str, BAUDS))}", "set devices.stage.baud to one"
            )
        self.names = dict(names)
        self.baud = baud
        self.port = Port(name, baud)
        self.packets = PacketHandler()
        self.lock = threading.RLock()
        self.failures = 0  # transactions that had to be repeated
        self._dirty = QUIET_S  # how long the line must be silent before the next transaction

    # ---- the port --------------------------------------------------------------------------------------------------

    def open(self) -> None:
        """Raises PortGone where it is not there or somebody else has it."""
        with self.lock:
            self.port.openPort()
            self._dirty = QUIET_S

    def reopen(self) -> None:
        """After the port has gone. Raises PortGone where it has not come back."""
        with self.lock:
            self.port.close()
            self.open()

    def close(self) -> None:
        with self.lock:
            self.port.close()

    # ---- transactions ----------------------------------------------------------------------------------------------

    def ping(self, servo: int) -> int:
        """Model number."""

        def once() -> int:
            packet, _ = self._reply(servo, lambda: self._send(servo, 0x01, []))
            if len(packet) != 3:
                raise NoAnswer
            return packet[0] | packet[1] << 8

        return self._whole(servo, once, last=servo)

    def read(self, servo: int, register: Register) -> int:
        """Raises DeviceFault where it does not answer, Refused."""

        def once() -> int:
            request = [register.address & 255, register.address >> 8, register.size, 0]
            data, _ = self._reply(servo, lambda: self._send(servo, 0x02, request))
            if len(data) != register.size:
                raise NoAnswer
            return int.from_bytes(data, "little", signed=register.signed)

        return self._whole(servo, once, last=servo)

    def write(self, servo: int, register: Register, value: int) -> None:
        """Written and acknowledged. Raises DeviceFault, Refused."""
        data = value.to_bytes(register.size, "little", signed=value < 0)
        request = [register.address & 255, register.address >> 8, *data]

        def once() -> None:
            more, _ = self._reply(servo, lambda: self._send(servo, 0x03, request))
            if more:  # an acknowledgement has no data: that was the answer to something else
                raise NoAnswer

        self._whole(servo, once, last=servo)

    def reboot(self, servo: int) -> None:
        self._whole(servo, lambda: self._reply(servo, lambda: self._send(servo, 0x08, [])), last=servo)

    def sync_write(self, register: Register, data: Mapping[int, bytes]) -> None:
        """Nobody answers: whoever calls this must read back. Raises PortGone."""
        params = [b for servo, d in data.items() for b in (servo, *d)]

        def once() -> None:
            head = [register.address & 255, register.address >> 8, register.size, 0]
            if self._send(0xFE, 0x83, [*head, *params]) != COMM_SUCCESS:
                raise NoAnswer

        self._whole(0xFE, once)

    def sync_read(self, register: Register, servos: Sequence[int]) -> tuple[dict[int, bytes], dict[int, int]]:
        """Bytes and error byte of every servo. Raises DeviceFault, naming who is silent."""

        def once() -> tuple[dict[int, bytes], dict[int, int]]:
            sent = self.packets.syncReadTx(self.port, register.address, register.size, list(servos), len(servos), False)
            if sent != COMM_SUCCESS:
                raise NoAnswer
            data, errors = {}, {}
            for servo in servos:
                data[servo], errors[servo] = self._receive(servo)
                if len(data[servo]) != register.size:
                    raise NoAnswer
            return data, errors

        try:
            return self._whole(0xFE, once, last=servos[-1])
        except NoAnswer:
            silent = [s for s in servos if not self.answers(s)]
            raise self.silent(silent or list(servos)) from None

    def answers(self, servo: int) -> bool:
        try:
            self.ping(servo)
            return True
        except DeviceFault:
            return False

    def silent(self, servos: Sequence[int]) -> DeviceFault:
        """What to tell of servos that do not answer."""
        who = ", ".join(f"{self.names.get(s, 'servo')} (id {s})" for s in servos)
        return DeviceFault(who, "no answer on the bus", "check its cable, supply, id and baud rate")

    # ---- underneath ------------------------------------------------------------------------------------------------

    def _whole(self, servo: int, once: Callable[[], T], last: int | None = None) -> T:
        """A transaction, repeated with the line cleared before each repetition.

        last: the servo whose answer comes last, None where nobody answers.
        """
        for _ in range(TRIES):
            with self.lock:
                if not self.port.is_open:
                    raise PortGone(f"{self.port.port_name}: not open")
                if self._dirty:
                    self.port.drain(self._dirty)
                    if last is not None and self._dirty == QUIET_S and not self._in_step(last):
                        self.failures += 1
                        continue
                self._dirty = QUIET_S  # until it is known to have ended well; an exception may come at any byte
                self.port.is_using = False  # what an interrupted transaction may have left behind
                try:
                    result = once()
                    self._dirty = 0.0
                    return result
                except Refused:
                    self._dirty = DAMAGED_S if servo == 0xFE else 0.0  # the others' replies are still to come
                    raise
                except NoAnswer as e:
                    self._dirty = e.quiet
                    self.failures += 1
                except IndexError:
                    self.failures += 1
                finally:
                    self.port.is_using = False
        if servo == 0xFE:
            raise NoAnswer
        raise self.silent([servo])

    def _in_step(self, servo: int) -> bool:
        """Whether a ping was answered. Replies keep their order: whatever was late has come before that."""
        self.port.is_using = False
        self._send(servo, 0x01, [])
        while True:
            packet, result = self.packets.rxPacket(self.port, False)
            if result == COMM_SUCCESS and packet[4] == servo and packet[5:8] == [7, 0, 0x55]:
                return True  # nothing else that is asked for has three bytes
            if self.port.timed_out:
                return False

    def _send(self, servo: int, instruction: int, params: list[int]) -> int:
        params = stuffed(params)  # 4.1.0 stuffs a copy and sends the original
        length = len(params) + 3
        head = [0, 0, 0, 0, servo, length & 255, length >> 8, instruction]
        result = int(self.packets.txPacket(self.port, [*head, *params, 0, 0]))
        self.port.setPacketTimeout(100)
        return result

    def _reply(self, servo: int, send: Callable[[], int]) -> tuple[bytes, int]:
        if send() != COMM_SUCCESS:
            raise NoAnswer
        data, error = self._receive(servo)
        return data, error

    def _receive(self, servo: int) -> tuple[bytes, int]:
        """Parameters and error byte of the next status packet. Raises NoAnswer, Refused."""
        packet, result = self.packets.rxPacket(self.port, False)
        if result != COMM_SUCCESS or packet[4] != servo or packet[7] != 0x55:
            failed = NoAnswer()
            if result == COMM_RX_CORRUPT and not self.port.timed_out:
                failed.quiet = DAMAGED_S
            raise failed
        error = packet[8]
        if error & ~ALERT == 3:  # it says that what it got was damaged
            raise NoAnswer
        if error & ~ALERT:
            raise Refused(error & ~ALERT)
        end = 5 + (packet[5] | packet[6] << 8)
        return bytes(packet[9:end]), error


def stuffed(params: list[int]) -> list[int]:
    """An FD more after each FF FF FD, so that no data looks like a header."""
    out: list[int] = []
    for b in params:
        out.append(b)
        if out[-3:] == [0xFF, 0xFF, 0xFD]:
            out.append(0xFD)
    return out
