"""Makes Meta-World's ML1 and ML10 with a hidden task; needs the extra ``metaworld``, so nothing else imports it.

Importing this module registers ``ML1Reach-v0``, ``ML1Push-v0``, ``ML1PickPlace-v0`` and ``ML10-v0``. Tasks are
Meta-World's own, applied by its ``set_task``. Of the ids that Meta-World registers, ``Meta-World/ML1-train`` gives the
test tasks too (3.1.1).

McLean et al. 2025, "Meta-World+: An Improved, Standardized, RL Benchmark".
"""

from __future__ import annotations

from typing import Any, TypeAlias

import gymnasium as gym
import numpy as np
from gymnasium.spaces import Box
from numpy.typing import NDArray

from sb3_bruno_envs.family import Family, Observe
from sb3_bruno_envs.metaworld_tasks import TaskNames, load_benchmark
from sb3_bruno_envs.tasks import Split, Task
from sb3_bruno_envs.wrappers.meta_task import Draw

Observation: TypeAlias = NDArray[np.float64]


def make_meta_world(
    name: str,
    *,
    seed: int = 1,
    split: Split = "train",
    tasks: Any = None,
    draw: Draw = "random",
    observe: Observe = "transition",
    task_space: Box | None = None,
    n_episodes: int | None = None,
    render_mode: str | None = None,
) -> gym.Env[Any, Any]:
    """Make an environment of ML1 or ML10.

    A task of ML1 is Meta-World's ``rand_vec``, ``(6,)`` or ``(3,)``: in most classes the positions of object and goal,
    in m. A task of ML10 is the training class, one-hot, and ``rand_vec``, ``(10 + 6,)``. The one-hot part of test
    classes is zeros, since nobody has trained on them. The observation shows the object and hides the goal, so
    ``check_meta_env`` reports that it holds the entries of the task that place the object. Class and places are the
    name of a task: ``"door-close (0.1, 0.9, 0.15)"``, ``"push (0.02, 0.65, 0.02) to (0.1, 0.84, 0.02)"``.

    An episode has 500 steps. ``info["is_success"]`` becomes True with the first success of an episode and stays so, as
    Meta-World counts successes. Making the tasks takes seconds, for ML10 half a minute; a process makes them once.

    Args:
        name: ``"ML10"``, or the class for ML1, such as ``"reach-v3"``.
        seed: of the tasks. ML1 has 50 for training and 50 for tests, ML10 500 and 250.
        split: as for every ``Family``, like the next four.
        tasks: a part of the benchmark's tasks; None for all.
        draw: ``"random"``, ``"cycle"`` or ``"fixed"``.
        observe: ``"transition"``, ``"task"`` or ``"plain"``.
        task_space: the Box that holds every task; None for the benchmark's own.
        n_episodes: the number of inner episodes, if an episode is a trial.
        render_mode: None, or ``"human"``, ``"rgb_array"`` or ``"depth_array"``.

    Raises:
        ValueError: if there is no such class, or an argument is invalid.

    Example:
        >>> env = make_meta_world("reach-v3", split="test", draw="cycle")
    """
    _check_render_mode(render_mode)  # before the minutes that making the tasks may take
    benchmark = load_benchmark(name, seed)
    family = Family(
        MetaWorldEnv,
        benchmark.tasks,
        n_episodes=n_episodes,
        name_task=TaskNames(name, seed),
        task_entries=benchmark.entries(),
    )
    return family(
        split=split,
        tasks=tasks,
        draw=draw,
        observe=observe,
        task_space=task_space,
        name=name,
        seed=seed,
        render_mode=render_mode,
    )


class MetaWorldEnv(gym.Env[Observation, NDArray[np.float32]]):
    """Plays any task of a benchmark, with Meta-World's reward; the goal's place in the observation holds zeros.

    A copy begins its episode anew, as copies of Gymnasium's MuJoCo environments do.

    Args:
        name: as in ``make_meta_world``.
        seed: of the tasks.
        render_mode: as in ``make_meta_world``.

    Raises:
        ValueError: if there is no such class, or an argument is invalid.
    """

    metadata = {"render_modes": ["human", "rgb_array", "depth_array"], "render_fps": 80}  # noqa: RUF012  # as there
    sets_task_at_reset = True  # Meta-World's own environments do

    def __init__(self, name: str, seed: int = 1, render_mode: str | None = None) -> None:
        _check_render_mode(render_mode)
        self.render_mode = render_mode
        self._arguments = (name, seed, render_mode)
        self._benchmark = load_benchmark(name, seed)
        self._envs: dict[str, Any] = {}  # those in use so far, by the name of their class
        self._succeeded = False  # in this episode
        self.set_task(self._benchmark.tasks.tasks()[0])
        self.observation_space = self._env.observation_space
        self.action_space = self._env.action_space

    def set_task(self, task: Task) -> None:
        """Apply one of the benchmark's tasks, from the next reset on.

        Raises:
            ValueError: if it is none of them.
        """
        self._task = np.array(task, dtype=np.float32)
        original = self._benchmark.original(self._task)
        name = original.env_name
        if name not in self._envs:
            self._envs[name] = self._benchmark.classes[name](render_mode=self.render_mode)
        self._env = self._envs[name]
        self._env.set_task(original)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        """Begin an episode; nothing is random but the task."""
        super().reset(seed=seed)
        self._succeeded = False
        observation, info = self._env.reset()
        return observation, info

    def step(self, action: NDArray[np.float32]) -> tuple[Observation, float, bool, bool, dict[str, Any]]:
        """Step the environment of the task's class."""
        observation, reward, terminated, truncated, info = self._env.step(action)
        self._succeeded |= bool(info["success"])
        return observation, float(reward), terminated, truncated, {**info, "is_success": self._succeeded}

    def render(self) -> Any:
        """Render the environment of the task's class; None without a render mode."""
        return None if self.render_mode is None else self._env.render()

    def close(self) -> None:
        """Close the environments of all classes."""
        for env in self._envs.values():
            env.close()

    def __getstate__(self) -> dict[str, Any]:
        return {"arguments": self._arguments, "task": self._task}

    def __setstate__(self, state: dict[str, Any]) -> None:
        MetaWorldEnv.__init__(self, *state["arguments"])
        self.set_task(state["task"])
        self.reset()


def _check_render_mode(render_mode: str | None) -> None:
    modes = MetaWorldEnv.metadata["render_modes"]
    if render_mode not in (None, *modes):
        raise ValueError(f"render_mode={render_mode!r} is not supported: use None or one of {modes}.")


_IDS = {"ML1Reach-v0": "reach-v3", "ML1Push-v0": "push-v3", "ML1PickPlace-v0": "pick-place-v3", "ML10-v0": "ML10"}

for _id, _name in _IDS.items():
    gym.register(_id, "sb3_bruno_envs.metaworld:make_meta_world", kwargs={"name": _name})
