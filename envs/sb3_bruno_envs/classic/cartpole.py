"""Simulates a pole on a cart, which should be swung up; the cart's mass and the pole's length are hidden."""

from __future__ import annotations

import math
from itertools import product
from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium.spaces import Box
from numpy.typing import ArrayLike, NDArray

from sb3_bruno_envs.classic.painting import BLUE, GREEN, GREY, blank_image, paint
from sb3_bruno_envs.family import Family
from sb3_bruno_envs.read_task import read_numbers
from sb3_bruno_envs.tasks import TaskSet

_DT = 0.01  # s
_GRAVITY = 9.82  # m/s^2, Deisenroth's value
_POLE_MASS = 0.5  # kg
_FRICTION = 0.1  # N s/m, between cart and track
_MAX_FORCE = 10.0  # N
_MAX_X = 2.4  # m; beyond it the cart has left the track
_START_STD = 0.2  # of each entry of the state, in its own unit
_PIXELS_PER_METRE = 25.0  # shows 2.56 m to either side


class CartpoleSwingUpEnv(gym.Env[NDArray[np.float32], NDArray[np.float32]]):
    """Rewards an upright pole in the middle of the track: ``(cos th + 1) / 2 * cos(pi x / 4.8)`` after the step.

    The pole is a uniform rod of mass m = 0.5 kg and length l, turning without friction on a cart of mass M. The cart
    is at x (m); the pole's angle is th (rad), 0 upright and pi hanging, positive counterclockwise, so that the
    pole's centre is at ``(x - l/2 sin th, l/2 cos th)``. A force F moves the cart, against friction b x'. With

        T = (M + m) x'^2 / 2 - m l cos th x' th' / 2 + m l^2 th'^2 / 6,    V = m g l cos th / 2

    Lagrange's equations give

        x'' = [4 (F - b x') - 2 m l sin th th'^2 + 3 m g sin th cos th] / [4 (M + m) - 3 m cos^2 th]
        th'' = 3 / (2 l) (g sin th + cos th x'')

    This is the cart-pole of Deisenroth, *Efficient Reinforcement Learning using Gaussian Processes* (2010),
    appendix C, who counts the angle from hanging. Explicit Euler steps of 0.01 s integrate the equations and feed
    energy to fast swings: without a force, a swing of 0.1 rad grows within 200 steps to 1.5 rad at M = 0.1 kg,
    l = 0.1 m, and to 0.24 rad at 0.5 kg, 0.25 m.

    The observation is ``(x, x', cos th, sin th, th')``, ``(5,)``. The action ``(1,)``, clipped to [-1, 1], is the force
    in units of 10 N. An episode starts with x, x', th - pi and th' from N(0, 0.2^2), and terminates when
    ``|x|`` exceeds 2.4 m.

    Args:
        render_mode: None, or ``"rgb_array"`` for images ``(128, 128, 3)`` of the track (grey), the cart (blue) and
            the pole (green), drawn without a graphics library.

    Raises:
        ValueError: if ``render_mode`` is neither.
    """

    metadata = {"render_modes": ["rgb_array"], "render_fps": 100}  # noqa: RUF012  # as Gymnasium has it
    mass = 0.5  # kg, of the cart
    length = 0.5  # m, of the pole

    def __init__(self, render_mode: str | None = None) -> None:
        if render_mode not in (None, *self.metadata["render_modes"]):
            raise ValueError(f"render_mode={render_mode!r} is not supported: use None or 'rgb_array'.")
        self.render_mode = render_mode
        self.observation_space = Box(-np.inf, np.inf, (5,))
        self.action_space = Box(-1.0, 1.0, (1,))
        self.state = (0.0, 0.0, math.pi, 0.0)  # x (m), x' (m/s), th (rad), th' (rad/s)

    def read_task(self, task: ArrayLike) -> NDArray[np.float64]:
        """Return the cart's mass and the pole's length of a task ``(2,)``, in kg and m.

        Raises:
            ValueError: if mass or length is not finite or not above 0, or there are not two numbers.
        """
        return read_numbers(task, 2, "the cart's mass in kg and the pole's length in m", n_positive=2)

    def set_task(self, task: ArrayLike) -> None:
        """Set the cart's mass and the pole's length from a task (see ``read_task``)."""
        self.mass, self.length = self.read_task(task).tolist()

    task_entries = (("cart", "kg"), ("pole", "m"))

    @staticmethod
    def name_task(task: ArrayLike) -> str:
        """Return the cart's mass and the pole's length."""
        mass, length = np.asarray(task, dtype=np.float64).tolist()
        return f"cart {mass:.4g} kg, pole {length:.4g} m"

    def accelerations(self, force: float) -> tuple[float, float]:
        """Return the accelerations of cart (m/s^2) and pole (rad/s^2) under ``force`` (N)."""
        _, velocity, angle, spin = self.state
        sin, cos = math.sin(angle), math.cos(angle)
        pull = -2.0 * self.length * sin * spin**2 + 3.0 * _GRAVITY * sin * cos  # of the pole, m/s^2
        push = 4.0 * (force - _FRICTION * velocity)  # N
        cart = (push + _POLE_MASS * pull) / (4.0 * (self.mass + _POLE_MASS) - 3.0 * _POLE_MASS * cos**2)
        return cart, 1.5 / self.length * (_GRAVITY * sin + cos * cart)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[NDArray[np.float32], dict[str, Any]]:
        """Start near rest, with the pole hanging; there are no options."""
        super().reset(seed=seed)
        x, velocity, angle, spin = (_START_STD * self.np_random.standard_normal(4)).tolist()
        self.state = (x, velocity, math.pi + angle, spin)
        return self._observation(), {}

    def step(self, action: NDArray[np.float32]) -> tuple[NDArray[np.float32], float, bool, bool, dict[str, Any]]:
        """Push for 0.01 s."""
        force = _MAX_FORCE * min(max(float(action[0]), -1.0), 1.0)
        cart, pole = self.accelerations(force)
        x, velocity, angle, spin = self.state
        self.state = (x + _DT * velocity, velocity + _DT * cart, angle + _DT * spin, spin + _DT * pole)
        x, _, angle, _ = self.state
        reward = (math.cos(angle) + 1.0) / 2.0 * math.cos(math.pi / 2.0 * x / _MAX_X)
        return self._observation(), reward, abs(x) > _MAX_X, False, {}

    def render(self) -> NDArray[np.uint8] | None:
        """Return the image, ``(128, 128, 3)``, or None without a render mode."""
        if self.render_mode is None:
            return None
        image, (x, _, angle, _) = blank_image(), self.state
        track = np.linspace([-_MAX_X, 0.0], [_MAX_X, 0.0], 130)  # (n, 2)
        tip = [x - self.length * math.sin(angle), self.length * math.cos(angle)]
        paint(image, track, GREY, pixels_per_unit=_PIXELS_PER_METRE)
        paint(image, np.array([[x, 0.0]]), BLUE, pixels_per_unit=_PIXELS_PER_METRE, radius=4)
        paint(image, np.linspace([x, 0.0], tip, 50), GREEN, pixels_per_unit=_PIXELS_PER_METRE, radius=1)
        return image

    def _observation(self) -> NDArray[np.float32]:
        x, velocity, angle, spin = self.state
        return np.array([x, velocity, math.cos(angle), math.sin(angle), spin], dtype=np.float32)


_MASSES, _LENGTHS = [0.5, 1.0, 1.5, 2.0, 2.5], [0.25, 0.5, 0.75]  # kg, m
_TEST_MASSES, _TEST_LENGTHS = [0.1, 0.25, 0.75, 1.75, 2.25, 3.0], [0.1, 0.2, 0.4, 0.6, 0.9, 0.98]  # kg, m

CARTPOLE_TASKS = TaskSet(list(product(_MASSES, _LENGTHS)), list(product(_TEST_MASSES, _TEST_LENGTHS)))
"""The cart's mass in kg and the pole's length in m: 15 to train, 36 to test, of which 6 lie inside the train box."""

CARTPOLE_SWING_UP = Family(
    CartpoleSwingUpEnv, CARTPOLE_TASKS, task_sets={"beyond": CARTPOLE_TASKS.beyond()}, max_episode_steps=200
)
