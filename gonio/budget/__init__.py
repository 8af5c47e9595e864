"""How uncertain what leaves the program is, and why: after the GUM (JCGM 100:2008), correlations kept.

    f = (S - D - stray) / (t k g cos theta_i)

Random parts differ from reading to reading: they are the sigma that a run stores. Common parts are the same for all of
a run: each is a column a_k(wi, wo) of relative errors at one standard deviation, so that the covariance between any two
pairs is a . a', and that of an integral the square of the integral of a f cos.
"""

from gonio.budget.budget import Budget, Reflectance
from gonio.budget.common import Common
from gonio.budget.of_run import budget_of, write_budget

__all__ = ["Budget", "Common", "Reflectance", "budget_of", "write_budget"]
