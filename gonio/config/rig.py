"""What a rig's YAML may say: its depth of simulation, geometry, axes, detector, faults, and where its calibration lies.

Angles are in degrees here and nowhere below; every key that has a unit names it.
"""

from typing import Annotated, Any, Literal

from pydantic import Field, SerializeAsAny, model_validator

from gonio.config.detectors import CameraConfig, Footprint, PhotodiodeConfig
from gonio.config.devices import DevicesConfig, ServoBusConfig
from gonio.config.loader import Section
from gonio.config.plugins import DetectorSection
from gonio.config.world import World

Degrees = Annotated[float, Field(ge=-3600, le=3600)]
Vector = tuple[float, float, float]


class AxisConfig(Section):
    """One joint. counts_per_turn 0 = continuous. offset_deg is what the encoder shows at the joint's zero."""

    lower_deg: Degrees
    upper_deg: Degrees
    velocity_deg_s: float = Field(60.0, gt=0, le=3600)
    acceleration_deg_s2: float = Field(120.0, gt=0, le=36000)
    counts_per_turn: int = Field(4096, ge=0, le=2**31 - 1)
    backlash_deg: float = Field(0.0, ge=0, le=10)
    offset_deg: Degrees = 0.0

    @model_validator(mode="after")
    def _ordered(self) -> "AxisConfig":
        if self.upper_deg - self.lower_deg < 1:
            raise ValueError(
                f"upper_deg ({self.upper_deg:g}) must lie at least 1 degree above lower_deg ({self.lower_deg:g})"
            )
        return self


class Gantry(Section):
    """Light arm over a turntable, detector arm on its own azimuth. Axes light, turntable, detector, azimuth."""

    kind: Literal["gantry"] = "gantry"


class Gimbal(Section):
    """Fixed light, sample in a gimbal, detector on a swing arm. Axes yaw, tilt, roll, detector."""

    kind: Literal["gimbal"] = "gimbal"


class JointConfig(Section):
    """A revolute joint of a chain: the axis it turns about, in the frame of the joint before it."""

    axis: Vector
    name: str = Field(min_length=1)

    @model_validator(mode="after")
    def _has_length(self) -> "JointConfig":
        if not sum(a * a for a in self.axis) > 1e-12:
            raise ValueError("axis must not be the zero vector")
        return self


class Chain(Section):
    """Any rig of revolute joints whose axes meet at the sample; solved from `nearest`, the closed form most like it.

    Each list runs from the base to the part. A part's rest direction is where it points with every joint at 0.
    """

    kind: Literal["chain"] = "chain"
    nearest: Literal["gantry", "gimbal"] = "gantry"
    light: tuple[JointConfig, ...] = ()
    detector: tuple[JointConfig, ...] = ()
    sample: tuple[JointConfig, ...] = ()
    light_rest: Vector = (0.0, 0.0, 1.0)
    detector_rest: Vector = (0.0, 0.0, 1.0)
    normal_rest: Vector = (0.0, 0.0, 1.0)
    mark_rest: Vector = Field((1.0, 0.0, 0.0), description="where the sample's 0-degree mark points at rest")

    @model_validator(mode="after")
    def _square(self) -> "Chain":
        (a, b, c), (x, y, z) = self.normal_rest, self.mark_rest
        cross = (b * z - c * y) ** 2 + (c * x - a * z) ** 2 + (a * y - b * x) ** 2
        if not cross > 1e-6 * (a * a + b * b + c * c) * (x * x + y * y + z * z):
            raise ValueError("mark_rest must not lie along normal_rest")
        return self


GANTRY_AXES = ("light", "turntable", "detector", "azimuth")
GIMBAL_AXES = ("yaw", "tilt", "roll", "detector")


class Acceptance(Section):
    """Half-angles of the cones that light fills and the detector sees, as the sample sees them; 0 = a point."""

    light_half_angle_deg: float = Field(0.0, ge=0, le=20)
    detector_half_angle_deg: float = Field(0.0, ge=0, le=20)


class LightConfig(Section):
    """The lamp. warm_up_s is waited for once after it is switched on."""

    warm_up_s: float = Field(0.0, ge=0)
    drift_per_h: float = Field(0.0, ge=-1, le=1, description="simulated: relative change of the lamp in an hour")


class FaultsConfig(Section):
    """Simulated rigs only: share of events that go wrong, each by its own cause."""

    stuck_axis: float = Field(0.0, ge=0, le=1, description="a move in which one axis stays where it is")
    droop_deg: float = Field(0.0, ge=0, le=5, description="how far a servo stops short, at most")
    silent_detector: float = Field(0.0, ge=0, le=1, description="a reading that never comes")
    spike: float = Field(0.0, ge=0, le=1, description="a reading far above the truth")


class CalibrationFiles(Section):
    """Files written by `gonio calibrate`, relative to the working directory; none = nominal geometry, nominal gain."""

    camera: str | None = Field(None, description="pinhole, distortion, and where the camera sits on its arm")
    frames: str | None = Field(None, description="the camera's dark and flat frames and bad pixels")
    geometry: str | None = None
    radiometry: str | None = None
    max_age_days: float | None = Field(None, gt=0)
    temperature_c: float | None = Field(None, ge=-50, le=100, description="of the room now")
    max_change_k: float = Field(5.0, gt=0, description="of the room since a calibration that says its temperature")
    allow_stale: bool = Field(False, description="measure all the same; the run says so")


class RigConfig(Section):
    """One rig."""

    name: str = Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9_.-]{0,99}$")
    depth: Literal["ideal", "devices", "wire", "real"]
    kinematics: Gantry | Gimbal | Chain = Field(Gantry(), discriminator="kind")
    axes: dict[str, AxisConfig]
    park_deg: dict[str, Degrees] = Field(default_factory=dict, description="pose of rest; axes not named rest at 0")
    settle_s: float = Field(0.10, ge=0, le=60)
    exposure_s: float = Field(0.020, gt=0, le=600)
    stay_out_deg: float = Field(8.0, ge=0, le=45, description="around retro-reflection, where one arm shades the other")
    use_achieved: bool = Field(
        True, description="a reading counts where a servo stopped short; else the chain sees NaN"
    )
    clock_scale: float = Field(1.0, ge=1, le=1e6, description="wire emulators only: how much faster than life they run")
    acceptance: Acceptance = Acceptance()
    detector: Literal["photodiode", "camera"] | SerializeAsAny[DetectorSection] = Field(
        "photodiode", description="or {driver: NAME, ...}, or {kind: text, instrument: NAME, port: ...}"
    )
    photodiode: PhotodiodeConfig = PhotodiodeConfig()
    camera: CameraConfig = CameraConfig()
    light: LightConfig = LightConfig()
    faults: FaultsConfig = FaultsConfig()
    devices: DevicesConfig = DevicesConfig()
    calibration: CalibrationFiles = CalibrationFiles()
    world: World | None = Field(None, description="simulated rigs only: what is wrong with it and nobody is told")

    @property
    def axis_names(self) -> tuple[str, ...]:
        """Names of the axes in the order of a pose."""
        k = self.kinematics
        if isinstance(k, Chain):
            return tuple(dict.fromkeys(j.name for j in (*k.light, *k.sample, *k.detector)))
        return GANTRY_AXES if isinstance(k, Gantry) else GIMBAL_AXES

    @property
    def channels(self) -> int | None:
        """How many the detector has, None = as many as what it looks at."""
        if isinstance(self.detector, DetectorSection):
            return self.detector.channels
        return len(self.camera.channels) if self.detector == "camera" else None

    @property
    def detector_kind(self) -> str:
        """photodiode, camera, or the name of another driver."""
        return self.detector.driver if isinstance(self.detector, DetectorSection) else self.detector

    @property
    def full_scales(self) -> tuple[float, ...]:
        """Of the detector's ranges, in units of the signal, lowest first; one of infinity where it says none."""
        p = self.photodiode
        if isinstance(self.detector, DetectorSection):
            return self.detector.full_scales or (float("inf"),)
        return tuple(p.full_scale * p.range_factor**k for k in range(p.ranges))

    @property
    def accuracy(self) -> float | None:
        """Of the detector's ranges and linearity, relative, before any calibration; None = nobody says."""
        return self.detector.accuracy if isinstance(self.detector, DetectorSection) else None

    @property
    def steps(self) -> float:
        """Of the detector's converter in a full scale; infinity where it says none."""
        if isinstance(self.detector, DetectorSection):
            return self.detector.steps or float("inf")
        return float(2**self.photodiode.bits)

    @property
    def footprint(self) -> Footprint:
        """A camera looks at a part of what is lit: its region lies in the light."""
        return "overfilled" if self.detector == "camera" else self.photodiode.footprint

    @property
    def reading_s(self) -> float:
        """About how long one reading takes."""
        return self.camera.reading_s if self.detector == "camera" else self.exposure_s

    @model_validator(mode="before")
    @classmethod
    def _parts_of_their_own(cls, data: Any) -> Any:
        """A photodiode or a camera that is named as other drivers are: its port has a place of its own."""
        named = data.get("detector") if isinstance(data, dict) else None
        if not (isinstance(named, dict) and named.get("driver") in ("photodiode", "camera")):
            return data
        where = {k: v for k, v in named.items() if k != "driver"}
        devices = {**(data.get("devices") or {}), **({named["driver"]: where} if where else {})}
        return {**data, "detector": named["driver"], "devices": devices}

    @model_validator(mode="after")
    def _consistent(self) -> "RigConfig":
        names = self.axis_names
        if set(self.axes) != set(names):
            raise ValueError(
                f"axes: a {self.kinematics.kind} has {', '.join(names)}; found {', '.join(self.axes) or 'none'}"
            )
        if isinstance(self.kinematics, Gantry):
            for name in ("light", "detector"):
                if self.axes[name].lower_deg < -90 or self.axes[name].upper_deg > 90:
                    raise ValueError(f"axes.{name}: beyond 90 degrees the arm would go into the table")
        swing = self.axes["detector"] if isinstance(self.kinematics, Gimbal) else None
        if (
            swing
            and self.stay_out_deg > 0
            and swing.lower_deg < self.stay_out_deg
            and swing.upper_deg > -self.stay_out_deg
        ):
            raise ValueError("axes.detector: it would swing through the light; keep to one side of the stay-out cone")
        for name, angle in self.park_deg.items():
            if name not in names:
                raise ValueError(f"park_deg.{name}: no such axis; they are {', '.join(names)}")
            if not self.axes[name].lower_deg <= angle <= self.axes[name].upper_deg:
                raise ValueError(f"park_deg.{name}: {angle:g} lies outside the axis's limits")
        if self.depth == "real":
            named = isinstance(self.detector, DetectorSection) or getattr(self.devices, self.detector) is not None
            if self.devices.stage is None or not named:
                raise ValueError(
                    f"devices: a real rig needs a stage and the {self.detector_kind} that `detector` names"
                )
            if self.faults != FaultsConfig():
                raise ValueError("faults: a real rig has its own; leave this section out")
        if self.world is not None:
            self._check_world(self.world)
        if isinstance(self.detector, DetectorSection) and self.depth in ("ideal", "devices"):
            raise ValueError(f"detector: a rig of depth {self.depth} has no wire to one; take depth wire or real")
        if self.detector == "camera" and self.depth == "ideal":
            raise ValueError("detector: a rig of depth ideal has none; leave it out, or take depth devices")
        if self.detector != "photodiode" and self.faults.spike > 0:
            raise ValueError("faults.spike: only a photodiode has them; leave it out")
        if self.detector == "camera" and self.camera.region_mm > self.camera.lit_mm:
            raise ValueError("camera.region_mm: the region reaches beyond the lit patch (camera.lit_mm)")
        joints = self.devices.stage.joints if self.devices.stage is not None else None
        if joints is not None and set(joints) != set(names):
            key, what = ("ids", "servo") if isinstance(self.devices.stage, ServoBusConfig) else ("axes", "motor")
            raise ValueError(f"devices.stage.{key}: one {what} for each of {', '.join(names)}")
        return self

    def _check_world(self, world: World) -> None:
        if self.depth not in ("devices", "wire"):
            raise ValueError(f"world: a rig of depth {self.depth} cannot have one; leave this section out")
        if self.detector != "photodiode":
            raise ValueError("world: rigs with a photodiode only; leave this section out")
        for key, names in (
            *((k, self.axis_names) for k in ("offsets_deg", "tilts_deg", "backlash_deg", "eccentricity_deg")),
            *((k, ("light", "detector")) for k in ("axes_miss_mm", "beam_deg")),
        ):
            for name in getattr(world, key) or {}:
                if name not in names:
                    raise ValueError(f"world.{key}.{name}: no such part; they are {', '.join(names)}")
        ratios = world.range_ratios
        if ratios is not None and len(ratios) != self.photodiode.ranges - 1:
            raise ValueError(f"world.range_ratios: {self.photodiode.ranges - 1} wanted, one a range above the lowest")
