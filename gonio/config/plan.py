"""How the rig plans its motion. Every saving is a switch, so that a bench can show what it is worth."""

from gonio.config.loader import Section


class PlanConfig(Section):
    """branches: take the cheapest of all equivalent poses; tour: visit a batch in the order of least travel."""

    branches: bool = True
    tour: bool = True
