"""Arrays and bounds in; a truncated Gaussian mixture out."""

from harness.model.mixture.conditional import Conditional
from harness.model.mixture.distribution import TruncatedGaussianMixture
from harness.model.mixture.fitting import FitResult, fit_mixture

__all__ = ["Conditional", "FitResult", "TruncatedGaussianMixture", "fit_mixture"]
