"""Is it a lamp: off when it is opened, on and off and at a level as told, from any thread?"""

from gonio.testing.common import Do, Make, check_class, check_closing, check_doctor, check_fault, in_thread, require


def check_light(make: Make, *, lit: "Do | None" = None, fault: Do | None = None, mend: Do | None = None) -> None:
    """lit(): whether light comes out of it, where somebody can tell. Raises Nonconformity."""
    shines = lit or (lambda: None)
    device = make()
    check_class(device)
    try:
        device.connect()
        require(not shines(), "connect: the lamp is on")
        device.off()
        device.level(0.5)
        device.on()
        require(shines() in (True, None), "on: the lamp is dark")
        device.on()
        require(shines() in (True, None), "on, twice: the lamp is dark")
        for wrong in (-0.1, 1.1, float("nan")):
            try:
                device.level(wrong)
            except ValueError:
                continue
            require(False, f"level({wrong}): is taken")
        device.level(0)
        device.level(1)
        in_thread(device.off, "off")
        require(not shines(), "off, from another thread: the lamp is on")
    finally:
        device.close()
    device = make()
    try:
        device.connect()
        device.on()
        device.close()
        device = make()
        device.connect()
        require(not shines(), "connect to a lamp that was left on: it stays on")
    finally:
        device.close()
    check_closing(make)
    check_doctor(make)
    check_fault(make, lambda d: d.on(), fault, mend)
