"""A truncated Gaussian mixture: arrays and bounds only."""

from harness.mixture.conditional import Conditional
from harness.mixture.distribution import TruncatedGaussianMixture

__all__ = ["Conditional", "TruncatedGaussianMixture"]
