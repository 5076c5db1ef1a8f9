"""``sb3-bruno evaluate``, ``diagnose`` and ``plot``: show how a trained agent adapts, as numbers and figures."""

from __future__ import annotations

import argparse
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from sb3_bruno.cli.mistake import Mistake, check_installed, told_as_mistake
from sb3_bruno.cli.parser import add_arguments, command_parser
from sb3_bruno.cli.values import writable_file, writable_folder

if TYPE_CHECKING:
    from sb3_bruno.zoo.trained import TrainedAgent


def evaluate(arguments: list[str]) -> None:
    """Test a trained agent on every test task; print, save and plot how it adapts.

    Tests that differ in --steps, --split, --stochastic or --load-best have files of their own in the run's folder.

    example: sb3-bruno evaluate --algo bruno_sac --env CheetahDir-v0 -f logs --steps 1000
    """
    parser = command_parser("evaluate", evaluate)
    add_arguments(parser)
    parser.add_argument("--stochastic", action="store_true", help="draw actions, for an agent that has to search")
    parser.add_argument("--video", action="store_true", help="also film an episode in which the task switches once")
    parser.add_argument(
        "--out", type=writable_folder, help="where adaptation.json and .png go (default: the run's folder)"
    )
    options = parser.parse_args(arguments)
    check_installed("matplotlib", *(["imageio_ffmpeg"] if options.video else []))

    from stable_baselines3.common.utils import set_random_seed

    from sb3_bruno.algorithms.task_inference import TaskInference
    from sb3_bruno.evaluation.adaptation import evaluate_adaptation
    from sb3_bruno.plotting.curves import plot_adaptation
    from sb3_bruno.plotting.names import method_name
    from sb3_bruno.plotting.reading import check_readable

    agent = load_agent(options)
    if options.video:
        if not isinstance(agent.model, TaskInference):
            raise Mistake(f"--video draws the belief, and {options.algo} has none: use record-video")
        with told_as_mistake():
            check_readable(agent.model)
    set_random_seed(options.seed)  # for actions that are drawn
    with told_as_mistake():
        result = evaluate_adaptation(
            agent.model,
            agent.make_env,
            agent.test.tasks,
            n_episodes=options.episodes,
            deterministic=not options.stochastic,
            seed=options.seed,
            vec_normalize=agent.vec_normalize,
            config={**agent.config, "deterministic": not options.stochastic},
            progress_bar=True,
        )
    kept = _file_of(options, agent, "adaptation")
    result.save(kept.with_suffix(".json"))
    plot_adaptation({method_name(agent.config): result}, kept.with_suffix(".png"))
    print(result.summary())
    if agent.test.n_inner > 1:
        means = result.returns_per_episode(agent.test.n_inner).mean(axis=(0, 1))
        print(f"mean return of each episode of a trial: {', '.join(f'{mean:.2f}' for mean in means)}")
    print(f"Saved {kept.with_suffix('.json')} and {kept.with_suffix('.png')}")
    if options.video:
        _film(agent, kept, options.seed)


def _film(agent: TrainedAgent, kept: Path, seed: int) -> None:
    """Film the agent on the two test tasks that differ most, one after the other."""
    from sb3_bruno.algorithms.task_inference import TaskInference
    from sb3_bruno.plotting.video import farthest_pair, film_adaptation

    assert isinstance(agent.model, TaskInference)  # checked before the test
    make_env, tasks = partial(agent.make_env, render_mode="rgb_array"), farthest_pair(agent.test.tasks)
    files, statistics = [kept.with_suffix(".mp4"), kept.with_suffix(".gif")], agent.vec_normalize
    with told_as_mistake():
        film_adaptation(agent.model, make_env, tasks, *files, seed=seed, vec_normalize=statistics, progress_bar=True)
    print(f"Saved {files[0]} and {files[1]}")


def diagnose(arguments: list[str]) -> None:
    """Measure how far a trained agent's belief can be trusted: calibration, bound, predictions, alarm.

    Tasks outside the range of the training tasks, if the environment has any, should raise the alarm. If all test tasks
    are outside, the others are the training tasks.

    example: sb3-bruno diagnose --algo bruno_sac --env CartpoleSwingUp-v0 -f logs
    """
    parser = command_parser("diagnose", diagnose)
    add_arguments(parser)
    parser.add_argument(
        "--out", type=writable_folder, help="where diagnostics.npz, .txt and .png go (default: the run's folder)"
    )
    options = parser.parse_args(arguments)
    check_installed("matplotlib", "scipy")

    from sb3_bruno.algorithms.task_inference import TaskInference
    from sb3_bruno.diagnostics.diagnose import diagnose as measure
    from sb3_bruno.diagnostics.figure import plot_diagnostics
    from sb3_bruno.files.whole import whole_file

    agent = load_agent(options)
    if not isinstance(agent.model, TaskInference):
        raise Mistake(f"{options.algo} has no belief to diagnose")
    inside, outside = agent.test.tasks[agent.test.inside], agent.test.tasks[~agent.test.inside]
    if len(inside) == 0:
        print(f"All {len(outside)} test tasks are outside the range of the training tasks: these are measured too")
        inside = agent.test.train
    with told_as_mistake():
        found = measure(
            agent.model,
            agent.make_env,
            inside,
            n_episodes=options.episodes,
            seed=options.seed,
            vec_normalize=agent.vec_normalize,
            outside_tasks=outside if len(outside) else None,
            progress_bar=True,
        )
    kept = _file_of(options, agent, "diagnostics")
    found.save(kept.with_suffix(".npz"))
    with whole_file(kept.with_suffix(".txt")) as part:
        part.write_text(found.summary() + "\n", encoding="utf-8")
    plot_diagnostics(found, kept.with_suffix(".png"))
    print(found.summary())
    print(f"Saved {kept.with_suffix('.npz')}, .txt and .png")


def load_agent(options: argparse.Namespace) -> TrainedAgent:
    """Load the agent that the flags choose, to run on one torch thread.

    Raises:
        Mistake: if it cannot be loaded or tested.
    """
    import torch as th

    from sb3_bruno.zoo.registry import register
    from sb3_bruno.zoo.trained import load_trained

    th.set_num_threads(1)
    register()
    with told_as_mistake():
        return load_trained(
            options.algo,
            options.env,
            options.folder,
            exp_id=options.exp_id,
            load_best=options.load_best,
            split=options.split,
            tasks=options.tasks,
            steps=options.steps,
            gym_packages=options.gym_packages,
            trust=options.trust,
        )


def _file_of(options: argparse.Namespace, agent: TrainedAgent, name: str) -> Path:
    """Name the files to write, without suffix: in ``--out``, or in the run's folder by how the test was made.

    So a test in the run's folder replaces no other one: adaptation.json is of whole episodes of the test tasks,
    adaptation_30_steps.json of 30 steps.
    """
    if options.out is not None:
        folder: Path = options.out
        folder.mkdir(parents=True, exist_ok=True)
        return folder / name
    chosen = {
        f"{options.steps}_steps": options.steps is not None,
        f"{options.tasks}_set": options.tasks is not None,
        f"{options.split}_tasks": options.split != "test",
        "stochastic": vars(options).get("stochastic", False),
        "best": options.load_best,
    }
    return agent.folder / "_".join([name, *(choice for choice, is_made in chosen.items() if is_made)])


def plot(arguments: list[str]) -> None:
    """Plot the test return of each task against training steps, over all runs of an algorithm on an environment.

    example: sb3-bruno plot -a bruno_sac -e CheetahDir-v0 -f logs --out curves.png
    """
    parser = command_parser("plot", plot)
    parser.add_argument("-a", "--algo", nargs="+", default=["bruno_sac"], help="(default: bruno_sac)")
    parser.add_argument("-e", "--env", default="CheetahDir-v0", help="(default: CheetahDir-v0)")
    parser.add_argument("-f", "--exp-folder", type=Path, default=Path("logs"), help="log folder (default: logs)")
    parser.add_argument(
        "--out", type=writable_file, default=Path("curves.png"), help="the figure (default: curves.png)"
    )
    options = parser.parse_args(arguments)
    check_installed("matplotlib")

    from huggingface_sb3 import EnvironmentName

    from sb3_bruno.evaluation.eval_callback import load_learning_curve
    from sb3_bruno.plotting.curves import plot_learning_curves
    from sb3_bruno.plotting.names import method_name

    curves = {}
    _, _, env = options.env.rpartition(":")  # as in my_package:My-v0
    for algo in options.algo:
        runs = sorted((options.exp_folder / algo).glob(f"{EnvironmentName(env)}_*"))
        with told_as_mistake():
            curves[algo] = [load_learning_curve(run) for run in runs if (run / "evaluation_tasks.npz").is_file()]
        if not curves[algo]:
            raise Mistake(f"{options.exp_folder / algo} has no evaluated run of {options.env}: train with --eval-freq")
    options.out.parent.mkdir(parents=True, exist_ok=True)
    with told_as_mistake():
        plot_learning_curves({method_name({"algo": algo}): runs for algo, runs in curves.items()}, options.out)
    for algo, of_algo in curves.items():
        last = [float(np.mean(curve.returns[-1])) for curve in of_algo]
        print(f"{algo}: {len(last)} runs, last evaluation {np.mean(last):.1f} on average")
    print(f"Saved {options.out}")
