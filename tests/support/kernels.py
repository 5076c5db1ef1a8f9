"""Observations of a process with a kernel, and an independent slow truth in float64 about them."""

from typing import NamedTuple

import numpy as np
import torch as th

from sb3_bruno.maths.kernel_statistics import Features


class Observations(NamedTuple):
    """Observations with their features, ``(*batch_shape, ...)``."""

    features: Features
    z: th.Tensor

    def at(self, *index) -> "Observations":
        mean, weights, noise_var = (part[index] for part in self.features)
        return Observations(Features(mean, weights, noise_var), self.z[index])

    def to(self, dtype: th.dtype) -> "Observations":
        mean, weights, noise_var = (part.to(dtype) for part in self.features)
        return Observations(Features(mean, weights, noise_var), self.z.to(dtype))


def draw_observations(seed, *batch_shape, n_weights, n_values=1, log_noise=(-2.0, 2.0), spread=1.0) -> Observations:
    """Draw sets of observations from the process, all of a set, ``batch_shape[-1]``, with the same weights w.

    Args:
        log_noise: the noise variances lie between e to these powers.
        spread: how much the columns of Phi differ from each other.
    """
    rng = np.random.default_rng(seed)
    shape = (*batch_shape, n_values)
    phi = rng.normal(size=(*shape, 1)) * (spread < 1) + spread * rng.normal(size=(*shape, n_weights))
    mean, noise_var = rng.normal(size=shape), np.exp(rng.uniform(*log_noise, size=shape))
    w = rng.normal(size=(*batch_shape[:-1], 1, n_weights, 1))
    z = mean + (phi @ w)[..., 0] + np.sqrt(noise_var) * rng.normal(size=shape)
    return Observations(Features(*map(th.as_tensor, (mean, phi, noise_var))), th.as_tensor(z))


class Dense(NamedTuple):
    """The joint normal distribution of all values of one set and, before them, of w: as large as it is.

    Attributes:
        error: z - b, ``(n m,)``.
        cov: of z, ``(n m, n m)``.
        phi: the covariance of z with w, ``(n m, K)``.
    """

    error: np.ndarray
    cov: np.ndarray
    phi: np.ndarray

    @classmethod
    def of(cls, observations: Observations) -> "Dense":
        mean, phi, noise_var = (part.double().detach().numpy() for part in observations.features)
        phi = phi.reshape(-1, phi.shape[-1])
        error = (observations.z.double().numpy() - mean).ravel()
        return cls(error, phi @ phi.T + np.diag(noise_var.ravel()), phi)

    @property
    def distance(self) -> float:
        return float(self.error @ np.linalg.solve(self.cov, self.error)) if len(self.error) else 0.0

    def posterior(self) -> tuple[np.ndarray, np.ndarray]:
        """Return mean and covariance of w | z."""
        gain = np.linalg.solve(self.cov, self.phi).T
        return gain @ self.error, np.eye(self.phi.shape[1]) - gain @ self.phi

    def predictive(self, further: "Dense") -> tuple[np.ndarray, np.ndarray]:
        """Return mean and covariance of further values less their b."""
        gain = np.linalg.solve(self.cov, self.phi @ further.phi.T).T
        return gain @ self.error, further.cov - gain @ self.phi @ further.phi.T


def least_squares(observations: Observations) -> tuple[np.ndarray, np.ndarray]:
    """Return mean and variances of w | z by QR: exact where the dense posterior's difference cancels."""
    mean, phi, noise_var = (part.double().numpy() for part in observations.features)
    std, n_weights = np.sqrt(noise_var).ravel(), phi.shape[-1]
    rows = np.vstack([np.eye(n_weights), phi.reshape(-1, n_weights) / std[:, None]])
    error = (observations.z.double().numpy() - mean).ravel() / std
    q, r = np.linalg.qr(rows)
    inverse = np.linalg.inv(r)
    return inverse @ (q.T @ np.append(np.zeros(n_weights), error)), np.square(inverse).sum(axis=1)
