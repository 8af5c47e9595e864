"""What can go wrong at the rig. Each error names the part, the cause and the remedy, in one line."""


class RigError(Exception):
    """Base of everything a rig raises on purpose; `exit_code` is what the command line answers with."""

    exit_code = 3


class DeviceFault(RigError):
    """A device failed: `axis` (joint or device by name), `cause`, `remedy`."""

    def __init__(self, axis: str, cause: str, remedy: str):
        super().__init__(f"{axis}: {cause}; {remedy}")
        self.axis, self.cause, self.remedy = axis, cause, remedy


class SafetyStop(RigError):
    """The rig was stopped to protect somebody or something, or a motion was refused as unsafe."""

    exit_code = 4


class CalibrationMissing(RigError):
    """A calibration that this measurement needs does not exist or is too old."""

    exit_code = 5
