"""``sb3-bruno evaluate`` and ``sb3-bruno plot``: how a trained agent adapts, as numbers and as figures."""

from __future__ import annotations

import json
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import pandas as pd
import rl_zoo3
import torch as th
import yaml
from huggingface_sb3 import EnvironmentName
from numpy.typing import NDArray
from rl_zoo3.utils import get_model_path, get_saved_hyperparams
from stable_baselines3.common.vec_env import DummyVecEnv, VecNormalize

from sb3_bruno.eval_callback import load_learning_curve
from sb3_bruno.evaluation import evaluate_adaptation
from sb3_bruno.plotting import plot_adaptation, plot_learning_curves
from sb3_bruno.task_inference import TaskInference
from sb3_bruno.video import MAX_TASKS, record_tasks
from sb3_bruno.zoo.mistake import Mistake
from sb3_bruno.zoo.parser import command_parser


def evaluate(arguments: list[str]) -> None:
    """Test a trained agent on every test task and print, save and plot how it adapts.

    example: sb3-bruno evaluate --algo bruno_sac --env CheetahDir-v0 -f logs --steps 1000
    """
    parser = command_parser("evaluate", evaluate)
    parser.add_argument("--algo", default="bruno_sac", choices=sorted(rl_zoo3.ALGOS), help="(default: bruno_sac)")
    parser.add_argument("--env", type=EnvironmentName, default="CheetahDir-v0", help="(default: CheetahDir-v0)")
    parser.add_argument("-f", "--folder", default="logs", help="log folder (default: logs)")
    parser.add_argument("--exp-id", type=int, default=0, help="run number, 0: the latest (default)")
    parser.add_argument("--load-best", action="store_true", help="the best model instead of the last")
    parser.add_argument("--episodes", type=int, default=10, help="per task (default: 10)")
    parser.add_argument("--steps", type=int, help="of each episode (default: the environment's own)")
    parser.add_argument("--split", choices=["train", "test"], default="test", help="which tasks (default: test)")
    parser.add_argument("--seed", type=int, default=0, help="of the environments (default: 0)")
    parser.add_argument("--video", action="store_true", help="also record up to four tasks, belief drawn under each")
    parser.add_argument("--out", type=Path, help="where adaptation.json and .png go (default: the run's folder)")
    options = parser.parse_args(arguments)
    th.set_num_threads(1)
    env_name = EnvironmentName(options.env)
    try:
        _, model_path, log_path = get_model_path(
            options.exp_id, options.folder, options.algo, env_name, options.load_best
        )
    except (AssertionError, ValueError) as error:
        raise Mistake(str(error)) from error
    env_kwargs = _env_kwargs(Path(log_path) / env_name) | {"split": options.split}
    if options.steps is not None:
        env_kwargs["max_episode_steps"] = options.steps
    make_env = partial(gym.make, env_name.gym_id, **env_kwargs)
    model = rl_zoo3.ALGOS[options.algo].load(model_path, device="cpu")
    if options.video and not isinstance(model, TaskInference):
        raise Mistake(f"--video draws the belief, and {options.algo} has none: use record-video")
    tasks, inside, n_inner = _tasks(make_env, options.split)
    vec_normalize = _vec_normalize(Path(log_path) / env_name, make_env)
    result = evaluate_adaptation(
        model,
        make_env,
        tasks,
        n_episodes=options.episodes,
        seed=options.seed,
        vec_normalize=vec_normalize,
        config={
            "algo": options.algo,
            **_given(Path(log_path) / env_name),
            "env": env_name.gym_id,
            "env_steps": model.num_timesteps,
            "seed": model.seed,
            "wall_seconds": training_seconds(Path(log_path)),
            "inside_train_box": inside,
            "n_inner_episodes": n_inner,
        },
    )
    out = options.out or Path(log_path)
    out.mkdir(parents=True, exist_ok=True)
    result.save(out / "adaptation.json")
    plot_adaptation({options.algo: result}, out / "adaptation.png")
    print(result.summary())
    if n_inner > 1:
        means = result.returns_per_episode(n_inner).mean(axis=(0, 1))
        print(f"mean return of each episode of a trial: {', '.join(f'{mean:.2f}' for mean in means)}")
    print(f"Saved {out / 'adaptation.json'} and {out / 'adaptation.png'}")
    if options.video:
        assert isinstance(model, TaskInference)  # checked before the test
        chosen = tasks[np.linspace(0, len(tasks) - 1, min(len(tasks), MAX_TASKS)).astype(int)]
        shown = partial(make_env, render_mode="rgb_array")
        record_tasks(model, shown, chosen, out / "adaptation.mp4", seed=options.seed, vec_normalize=vec_normalize)
        print(f"Saved {out / 'adaptation.mp4'}")


def plot(arguments: list[str]) -> None:
    """Plot the test return of each task while training, over all runs of an algorithm on an environment.

    example: sb3-bruno plot -a bruno_sac -e CheetahDir-v0 -f logs --out curves.png
    """
    parser = command_parser("plot", plot)
    parser.add_argument("-a", "--algo", nargs="+", default=["bruno_sac"], help="(default: bruno_sac)")
    parser.add_argument("-e", "--env", default="CheetahDir-v0", help="(default: CheetahDir-v0)")
    parser.add_argument("-f", "--exp-folder", type=Path, default=Path("logs"), help="log folder (default: logs)")
    parser.add_argument("--out", type=Path, default=Path("curves.png"), help="the figure (default: curves.png)")
    options = parser.parse_args(arguments)
    curves = {}
    for algo in options.algo:
        runs = sorted((options.exp_folder / algo).glob(f"{options.env}_*"))
        curves[algo] = [load_learning_curve(run) for run in runs if (run / "evaluation_tasks.npz").is_file()]
        if not curves[algo]:
            raise Mistake(f"{options.exp_folder / algo} has no evaluated run of {options.env}: train with --eval-freq")
    plot_learning_curves(curves, options.out)
    for algo, of_algo in curves.items():
        last = [float(np.mean(curve.returns[-1])) for curve in of_algo]
        print(f"{algo}: {len(last)} runs, last evaluation {np.mean(last):.1f} on average")
    print(f"Saved {options.out}")


def _tasks(make_env: Callable[[], gym.Env[Any, Any]], split: str) -> tuple[NDArray[np.float32], list[bool], int]:
    """All tasks of a split, (n_tasks, task_dim), which of them lie between training tasks, episodes per trial.

    :raises Mistake: if the environment has no list of them
    """
    try:
        env = make_env()
        distribution = env.get_wrapper_attr("task_distribution")
        tasks: NDArray[np.float32] = distribution.tasks(split)
    except (TypeError, AttributeError) as error:
        raise Mistake(f"the environment has no list of {split} tasks to test on: {error}") from error
    n_inner = env.get_wrapper_attr("n_episodes") if env.has_wrapper_attr("n_episodes") else 1
    env.close()
    return tasks, distribution.inside_train_box(tasks).tolist(), n_inner


def _env_kwargs(params: Path) -> dict[str, Any]:
    """What the run's environment was made with, by config and command line."""
    return {**_hyperparams(params).get("env_kwargs", {}), **(_arguments(params)["env_kwargs"] or {})}


def _given(params: Path) -> dict[str, Any]:
    """What tells the run from others: the config that it chose, what went over it, and all hyperparameters."""
    arguments = _arguments(params)
    chosen = {
        "conf": arguments["conf_file"],
        "params": dict(arguments["hyperparams"] or {}),
        "hyperparameters": dict(_hyperparams(params)),
    }
    as_json: dict[str, Any] = json.loads(json.dumps(chosen, default=str))
    return as_json


def _hyperparams(params: Path) -> dict[str, Any]:
    hyperparams: dict[str, Any] = get_saved_hyperparams(str(params))[0]
    return hyperparams


def _arguments(params: Path) -> dict[str, Any]:
    with open(params / "args.yml", encoding="utf-8") as file:
        arguments: dict[str, Any] = yaml.unsafe_load(file)  # rl_zoo3 wrote an OrderedDict
    return arguments


def training_seconds(run: Path) -> float | None:
    """How long a run has trained, by the clock of its monitor file; None without one.

    Where a run was resumed the clock starts again: what lay between is not counted.
    """
    if not (run / "0.monitor.csv").is_file():
        return None
    seconds = pd.read_csv(run / "0.monitor.csv", comment="#")["t"].to_numpy(dtype=np.float64)
    ends = np.append(seconds[1:] < seconds[:-1], True)  # the last episode of each part
    return float(seconds[ends].sum())


def _vec_normalize(params: Path, make_env: Any) -> VecNormalize | None:
    path = params / "vecnormalize.pkl"
    return VecNormalize.load(str(path), DummyVecEnv([make_env])) if path.is_file() else None
