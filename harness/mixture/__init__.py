"""A truncated Gaussian mixture: arrays and bounds only."""

from harness.mixture.conditional import Conditional
from harness.mixture.distribution import TruncatedGaussianMixture
from harness.mixture.fitting import FitResult, fit_mixture

__all__ = ["Conditional", "FitResult", "TruncatedGaussianMixture", "fit_mixture"]
