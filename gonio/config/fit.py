"""Whether a material's config and a rig's fit together."""

from gonio.config.loader import ConfigError
from gonio.config.material import Material
from gonio.config.rig import RigConfig


def refuse_misfit(material: Material, rig: RigConfig) -> None:
    """Raises ConfigError where the rig's detector has another number of channels than the material names."""
    if rig.channels not in (None, len(material.channels)):
        given = (
            f"{material.name} has {len(material.channels)}, the {rig.detector_kind} of rig {rig.name} {rig.channels}"
        )
        remedy = "name its planes in camera.channels" if rig.detector == "camera" else "name as many in the material"
        raise ConfigError(f"channels: {given}; {remedy}")
