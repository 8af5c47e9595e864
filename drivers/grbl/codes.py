"""Grbl's alarms and errors by number: what they mean for a stage, and what to do.

Grbl v1.1, doc/csv/alarm_codes_en_US.csv and error_codes_en_US.csv (github.com/gnea/grbl); FluidNC and grblHAL keep
these numbers and add some.
"""

# number -> what happened, what to do, whether the position is lost
ALARMS = {
    1: (
        "a limit switch was hit: the position is lost",
        "free the arm with the power off, then `gonio home`",
        True,
    ),
    2: ("a move beyond its travel was refused", "check $130-$132 and the limits in the rig's YAML", False),
    3: ("was reset in a move: the position is lost", "`gonio home`", True),
    6: ("homing was interrupted", "`gonio home` again", True),
    7: ("the safety door was opened while homing", "close it, then `gonio home`", True),
    8: (
        "homing does not get off a limit switch",
        "check the switch, its wiring and $27, then `gonio home`",
        True,
    ),
    9: ("homing does not find a limit switch", "check the switch and $130-$132, then `gonio home`", True),
    10: ("emergency stop", "release it, then `gonio home`", True),
}
ERRORS = {
    1: ("did not understand a line", "check its firmware: Grbl 1.1 or later is needed"),
    2: ("did not understand a number", "check its firmware: Grbl 1.1 or later is needed"),
    3: ("does not know a $ command", "check its firmware: Grbl 1.1 or later is needed"),
    5: ("homing is not enabled", "enable it ($22=1) and fit switches, or say `homing: false` in devices.stage"),
    7: ("could not read its settings and took the defaults", "write them again, see `gonio doctor`"),
    8: ("is busy", "wait until it stands, then `gonio home`"),
    9: ("is locked after an alarm", "`gonio home`"),
    11: ("was sent a line that is too long", "check its firmware"),
    13: ("its safety door is open", "close it, then `gonio resume`"),
    15: ("a move beyond its travel was refused", "check $130-$132 and the limits in the rig's YAML"),
    20: ("does not know a G-code word", "check its firmware: has it as many axes as devices.stage names?"),
    22: ("has no feed rate", "check its firmware"),
    33: ("a target is not valid", "check the limits in the rig's YAML"),
    79: ("homing is required first", "`gonio home`"),
}


def alarm(number: int) -> tuple[str, str, bool]:
    """Cause, remedy, and whether the position is lost: of an alarm that nobody knows, it is."""
    unknown = f"alarm {number}", "see its firmware's list of alarms, then `gonio home`", True
    return ALARMS.get(number, unknown)


def error(number: int) -> tuple[str, str]:
    """Cause and remedy."""
    return ERRORS.get(number, (f"refused a line with error {number}", "see its firmware's list of errors"))
