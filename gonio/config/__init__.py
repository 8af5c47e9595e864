"""What a YAML file may say. Unknown keys are errors that name the line and the nearest known key."""

from gonio.config.loader import ConfigError, load_config
from gonio.config.material import Material

__all__ = ["ConfigError", "Material", "load_config"]
