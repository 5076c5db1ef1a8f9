"""Lists the trained agents of a log folder, and opens one in its environment."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any, NamedTuple

import gymnasium as gym
import rl_zoo3
from huggingface_sb3 import EnvironmentName

from sb3_bruno.live.robot import is_robot
from sb3_bruno.live.session import Session
from sb3_bruno.runs.folder import latest_finished
from sb3_bruno.zoo.trained import load_trained


class Agent(NamedTuple):
    """A run's agent, as the flags of the command line choose it."""

    algo: str
    env: str
    exp_id: int

    def __str__(self) -> str:
        return f"{self.algo}  {self.env}  {self.exp_id}"


def find_agents(logs: str | Path) -> list[Agent]:
    """List the agents in a log folder, by name."""
    agents = []
    for run in Path(logs).glob("*/*_*"):
        env, _, number = run.name.rpartition("_")
        if (
            run.parent.name in rl_zoo3.ALGOS
            and number.isdecimal()
            and any(path.is_file() for path in run.glob(f"{env}.*"))
        ):
            agents.append(Agent(run.parent.name, env, int(number)))
    return sorted(agents)


def choose_agent(algo: str, env: str, logs: str | Path, exp_id: int = 0) -> Agent:
    """Choose an agent, that of the latest finished run if ``exp_id`` is 0.

    Raises:
        ValueError: if all runs are unfinished and ``exp_id`` chooses none.
    """
    return Agent(algo, env, exp_id or latest_finished(Path(logs) / algo, EnvironmentName(env)))


def open_agent(
    agent: Agent, logs: str | Path, gym_packages: Sequence[str] = (), *, seed: int = 0, trust: bool = False
) -> Session:
    """Load an agent and make its environment.

    Args:
        agent: which one.
        logs: the folder that it is in.
        gym_packages: packages to import, besides those that the run remembers.
        seed: of the environment.
        trust: load pickles from any folder.

    Raises:
        ValueError: if it cannot be loaded, or is not trusted.
    """
    trained = load_trained(
        agent.algo,
        agent.env,
        logs,
        exp_id=agent.exp_id,
        gym_packages=gym_packages,
        needs_tasks=False,
        trust=trust,
    )
    env = make_shown(trained.make_env)
    return Session(trained.model, env, vec_normalize=trained.vec_normalize, seed=seed)


def make_shown(make_env: Callable[..., gym.Env[Any, Any]]) -> gym.Env[Any, Any]:
    """Make an environment so that it can be looked at: a robot without a time limit, any other with pictures.

    Other environments keep their time limit: what they paint has a border. One that paints nothing is left as it is.
    """
    env = make_env()
    if is_robot(env):
        env.close()
        return make_env(max_episode_steps=-1)
    if "rgb_array" in env.metadata.get("render_modes", []):
        with suppress(TypeError, ValueError):  # its maker takes no render mode
            painting = make_env(render_mode="rgb_array")
            env.close()
            return painting
    return env
