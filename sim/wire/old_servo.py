"""Servos of Dynamixel protocol 1.0 on the same wire: they answer a ping and reads of their model number, no more.

emanual.robotis.com/docs/en/dxl/protocol1, written apart from the SDK.
"""

from sim.wire.line import Device


class WithOldServos:
    """`bus`, and servos of protocol 1.0 beside it: id -> model number. Implements `sim.wire.line.Device`."""

    def __init__(self, bus: Device, models: dict[int, int]):
        self.bus, self.models, self.busy_s = bus, models, 0.0

    def receive(self, data: bytes) -> list[bytes]:
        out = self.bus.receive(data)
        if len(data) >= 6 and data[:2] == b"\xff\xff" and data[2] in self.models and len(data) == data[3] + 4:
            servo, instruction, params = data[2], data[4], data[5:-1]
            if sum(data[2:]) & 0xFF == 0xFF and instruction in (1, 2):
                table = self.models[servo].to_bytes(2, "little") + b"\x18"
                answer = table[params[0] : params[0] + params[1]] if instruction == 2 else b""
                body = bytes([servo, len(answer) + 2, 0]) + answer
                out.append(b"\xff\xff" + body + bytes([~sum(body) & 0xFF]))
        return out

    def restarted(self) -> None:
        self.bus.restarted()
