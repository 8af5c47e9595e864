"""What a rig's YAML may say of a spectrometer: the wavelength of each pixel, and the bands that are its channels."""

from functools import cached_property
from itertools import pairwise
from typing import Annotated, Any

from pydantic import Field, model_validator

from gonio.config.loader import Section

Nanometres = Annotated[float, Field(ge=100, le=20_000)]
MOST_PIXELS = 2048


class Bands(Section):
    """Channel c is the mean of the pixels between the two wavelengths of `bands_nm[c]`.

    wavelengths_nm: one a pixel, growing; or polynomial: coefficients c0, c1, ... of the wavelength in the pixel's
    number from 0, as makers print them on a calibration sheet.
    """

    bands_nm: tuple[tuple[Nanometres, Nanometres], ...] = Field(min_length=1, max_length=256)
    wavelengths_nm: tuple[Nanometres, ...] | None = Field(None, min_length=2, max_length=MOST_PIXELS)
    polynomial: tuple[float, ...] | None = Field(None, min_length=2, max_length=6)
    pixels: int = Field(MOST_PIXELS, ge=2, le=MOST_PIXELS, description="with `polynomial`")

    @model_validator(mode="after")
    def _usable(self) -> "Bands":
        if (self.wavelengths_nm is None) == (self.polynomial is None):
            raise ValueError("wavelengths_nm, or polynomial and pixels: one of the two")
        nm = self.wavelengths
        if any(not a < b for a, b in pairwise(nm)):
            raise ValueError("wavelengths must grow from pixel to pixel")
        for low, high in self.bands_nm:
            if not low < high:
                raise ValueError(f"bands_nm: {low:g} to {high:g}: the lower wavelength comes first")
            if not any(low <= w <= high for w in nm):
                raise ValueError(f"bands_nm: no pixel lies between {low:g} and {high:g} nm ({nm[0]:g} to {nm[-1]:g})")
        return self

    @cached_property
    def wavelengths(self) -> tuple[float, ...]:
        """nm, one a pixel."""
        if self.wavelengths_nm is not None:
            return self.wavelengths_nm
        c = self.polynomial or ()
        return tuple(sum(a * n**k for k, a in enumerate(c)) for n in range(self.pixels))

    def binned(self, values: Any) -> Any:
        """values (P,) of the pixels -> (C,) means over the bands."""
        import numpy as np

        nm = np.array(self.wavelengths)
        return np.array([values[(nm >= low) & (nm <= high)].mean() for low, high in self.bands_nm])
