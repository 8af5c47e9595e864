"""What a material's YAML may say: what is on the rig, how it is sampled, when to stop, what to make of it."""

from typing import Annotated, Any, Literal

from pydantic import Field, ValidationInfo, field_validator, model_validator

from gonio.config.loader import Section
from gonio.config.plan import PlanConfig

Share = Annotated[float, Field(ge=0, lt=1)]
Plain = Literal["pss_simple", "pss_vndf", "vmf_io", "vmf_hd", "independence"]


class Target(Section):
    """What the chain visits in proportion to. unknown: the error to be expected of the reconstruction, to a power;
    energy: p ∝ s(f)^power cos θo, mixed with a floor where f is low (METHOD 1, 6)."""

    kind: Literal["unknown", "energy"] | None = Field(
        None, description="default: unknown for proposal auto, energy for the others, which know no other"
    )
    channels: int | str | None = Field(
        None, description="default: mean of unknown (each channel over its own albedo), max of energy"
    )
    power: float | None = Field(None, gt=0, le=1, description="default: 0.7 of unknown, 1 of energy")
    floor: Share = Field(0.1, description="of energy: share of the draws that is laid evenly")
    scene: str | None = Field(
        None, description="file of `gonio scene`: measure for that picture, p is multiplied by (w + scene_floor)"
    )
    scene_floor: float = Field(0.05, ge=1e-3, le=100, description="of what the picture never sees; w has the mean 1")

    @field_validator("channels", mode="before")
    @classmethod
    def _known(cls, v: Any) -> Any:
        number = isinstance(v, int) and not isinstance(v, bool) and v >= 0
        if v is not None and not number and v not in ("luminance", "mean", "max"):
            raise ValueError("expected luminance, mean, max or a channel's number from 0")
        return v


class FlowConfig(Section):
    """The flow of proposal `flow`: what it starts from and what is learnt on the way."""

    start: Literal["code", "zoo", "fresh"] = Field(
        "code", description="code: one flow over many materials, its code fitted; zoo: by GGX roughness; fresh: nothing"
    )
    weights: str | None = Field(None, description="file of another conditional flow, as `gonio bench pretrain` writes")
    train: bool = Field(True, description="train all weights too, not only the code (needs the extra `flow`: torch)")
    epsilon: float = Field(0.02, gt=0, lt=1, description="share of draws even in the cube, whatever is learnt")
    coordinates: Literal["half", "vndf", "flat", "raw"] = Field("half", description="of a fresh flow")
    warp: Literal["quadratic", "rational"] = Field("quadratic", description="of a fresh flow; so are those below")
    encoding: Literal["plain", "one_blob", "harmonics"] = "one_blob"
    alpha: float = Field(0.1, ge=1e-4, le=1, description="roughness of the `vndf` cube")
    couplings: int = Field(4, ge=1, le=32)
    bins: int = Field(24, ge=2, le=256)
    hidden: int = Field(64, ge=4, le=1024)


POWER = {"unknown": 0.7, "energy": 1.0}
CHANNELS = {"unknown": "mean", "energy": "max"}


class SamplerConfig(Section):
    """Which proposal drives the chains, and its numbers. `sampler: thesis` is the 2024 thesis's own setting."""

    proposal: Literal["auto", "flow", "delayed", "independence", "pss_simple", "pss_vndf", "vmf_io", "vmf_hd"] = "auto"
    inner: Plain = Field("pss_simple", description="the proposal that `delayed` acceptance stands around")
    chains: int = Field(1, ge=1, le=100_000)
    sigma: float = Field(0.05, gt=0, le=1, description="local step, per coordinate of the unit cube")
    global_share: float = Field(0.1, ge=0, le=1, description="share of steps drawn afresh")
    boundary: Literal["reflect", "wrap"] = "reflect"
    kappa: float = Field(400.0, ge=1e-3, le=1e6, description="concentration of the vMF proposals")
    alpha: float = Field(0.1, ge=1e-4, le=1, description="GGX roughness of pss_vndf and independence")
    alpha_y: float | None = Field(None, ge=1e-4, le=1, description="second roughness, anisotropic samples")
    block: int = Field(64, ge=1, le=4096, description="independence proposals handed out at once")
    adapt: bool | Literal["thesis"] = Field(
        True, description="refit the proposal while sampling (auto, flow); thesis: as the thesis did, to show it (flow)"
    )
    flow: FlowConfig = FlowConfig()
    target: Target = Target()

    @field_validator("target")
    @classmethod
    def _kind_of_target(cls, v: Target, info: ValidationInfo) -> Target:
        proposal = info.data.get("proposal", "auto")
        kind = v.kind or ("unknown" if proposal == "auto" else "energy")
        if kind == "unknown" and proposal != "auto":
            raise ValueError(f"kind `unknown` is a target of proposal auto; with {proposal} use energy")
        if v.scene is not None and kind != "unknown":
            raise ValueError("scene: a target of kind `unknown` (proposal auto) takes it; leave kind and proposal out")
        channels = CHANNELS[kind] if v.channels is None else v.channels
        return v.model_copy(update={"kind": kind, "channels": channels, "power": v.power or POWER[kind]})


THESIS = {
    "proposal": "pss_simple", "sigma": 0.05, "global_share": 0.1, "boundary": "wrap",
    "target": {"channels": 0, "power": 1.0, "floor": 0.0},
}  # fmt: skip


class Budget(Section):
    """When a run has spent enough, whichever comes first."""

    measurements: int | None = Field(2000, ge=1, le=100_000_000)
    rig_hours: float | None = Field(None, gt=0)


class Stop(Section):
    """When a run is good enough, whichever comes first."""

    energy_error: float | None = Field(None, gt=0, lt=10, description="estimated share of reflected energy misplaced")
    scene_error: float | None = Field(
        None, gt=0, lt=10, description="estimated share of the light off the material that is wrong in the picture"
    )
    ess: float | None = Field(None, gt=0, description="effective samples of the chains together")
    unmeasured: int = Field(50, ge=1, description="readings in a row that fail before the run gives up")


class Reconstruct(Section):
    model: Literal["auto", "thesis", "ggx", "lobes", "abc", "flow", "flow_hd", "auto_flow"] = "auto"


class Material(Section):
    """One sample on the rig and the run to make of it."""

    name: str = Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9_.-]{0,99}$")
    symmetry: Literal["isotropic", "anisotropic"] = "isotropic"
    channels: tuple[str, ...] = Field(("R", "G", "B"), min_length=1, max_length=512)
    sample_id: str | None = Field(None, max_length=200, description="what the sample's label says")
    operator: str | None = Field(None, max_length=200, description="who measures")
    notes: str | None = Field(None, max_length=10_000, description="anything worth knowing")
    metadata: dict[str, str | int | float | bool] = Field(
        default_factory=dict, max_length=200, description="keys of your own; kept in the run and in its exports"
    )
    truth: str | None = Field(None, description="the BRDF a simulated rig shows; a real rig refuses it")
    seed: int = Field(0, ge=0, le=2**63 - 1)
    sampler: SamplerConfig = SamplerConfig()
    plan: PlanConfig = PlanConfig()
    budget: Budget = Budget()
    stop: Stop = Stop()
    reconstruct: Reconstruct = Reconstruct()

    @field_validator("sampler", mode="before")
    @classmethod
    def _presets(cls, v: Any) -> Any:
        if isinstance(v, str):
            if v != "thesis":
                raise ValueError("expected `thesis` or a section with `proposal`")
            return THESIS
        return v

    @field_validator("channels", mode="before")
    @classmethod
    def _count_of_channels(cls, v: Any) -> Any:
        if isinstance(v, int) and not isinstance(v, bool) and 1 <= v <= 512:
            return ("R", "G", "B") if v == 3 else tuple(f"c{i}" for i in range(v))
        return v

    @field_validator("metadata")
    @classmethod
    def _short(cls, v: dict[str, Any]) -> dict[str, Any]:
        for key, value in v.items():
            if not 1 <= len(key) <= 100 or len(str(value)) > 10_000:
                raise ValueError(f"{key[:20]!r}: keys have 1 to 100 characters, values 10,000 at most")
        return v

    @model_validator(mode="after")
    def _consistent(self) -> "Material":
        channel = self.sampler.target.channels
        if isinstance(channel, int) and channel >= len(self.channels):
            raise ValueError(
                f"sampler.target.channels is {channel}, but there are {len(self.channels)} channels (0 is the first)"
            )
        if self.sampler.adapt == "thesis" and self.sampler.proposal != "flow":
            raise ValueError("sampler.adapt: `thesis` is a way to train a flow; it needs sampler.proposal: flow")
        if self.sampler.adapt == "thesis" and self.symmetry == "anisotropic":
            raise ValueError("sampler.adapt: `thesis` starts from flows of isotropic lobes; use adapt: true")
        if self.sampler.flow.weights is not None and (
            self.sampler.flow.start != "code" or self.symmetry != "isotropic"
        ):
            raise ValueError("sampler.flow.weights: a conditional flow of isotropic samples; it needs start: code")
        if self.stop.scene_error is not None and self.sampler.target.scene is None:
            raise ValueError("stop.scene_error: of which picture? name a file of `gonio scene` in sampler.target.scene")
        if channel == "luminance" and len(self.channels) != 3:
            raise ValueError("sampler.target.channels: luminance needs three channels (linear RGB)")
        if (
            self.budget.measurements is None
            and self.budget.rig_hours is None
            and self.stop.energy_error is None
            and self.stop.scene_error is None
            and self.stop.ess is None
        ):
            raise ValueError(
                "nothing would end this run; set budget.measurements, budget.rig_hours or stop.energy_error"
            )
        return self
