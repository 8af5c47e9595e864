"""What people said of a sample, for files that can hold text.

A writer of `gonio.run.products` that has a parameter `about` is handed `about(material)`.
"""

from collections.abc import Mapping

from gonio.config.material import Material

About = Mapping[str, str | int | float | bool]


def about(material: Material) -> dict[str, str | int | float | bool]:
    """name, and what is given of sample_id, operator, notes; the keys of `metadata` with `metadata.` before them."""
    said = {key: getattr(material, key) for key in ("sample_id", "operator", "notes")}
    mine = {f"metadata.{key}": value for key, value in material.metadata.items()}
    return {"name": material.name, **{k: v for k, v in said.items() if v is not None}, **mine}


def lines(said: About) -> list[str]:
    """`key: value`, one line each, whatever line breaks a value has."""
    return [f"{' '.join(key.split())}: {' '.join(str(value).split())}" for key, value in said.items()]
