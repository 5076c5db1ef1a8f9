"""Do the main job in one command: train BrunoSAC on Cheetah-Dir, test it in both directions, save the results.

    python -m sb3_bruno.quickstart            # 40,000 env steps
    python -m sb3_bruno.quickstart --full     # 100,000, the run of docs/results.md

Give the same command again to go on with an interrupted run from its checkpoint.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

import gymnasium as gym
import torch as th
from stable_baselines3.common.env_util import make_vec_env
from stable_baselines3.common.off_policy_algorithm import OffPolicyAlgorithm

from sb3_bruno import BrunoSAC
from sb3_bruno.evaluation import AdaptationResult, evaluate_adaptation
from sb3_bruno.evaluation.eval_callback import TaskEvalCallback, load_learning_curve
from sb3_bruno.files.whole import whole_file
from sb3_bruno.plotting.curves import plot_adaptation, plot_learning_curves
from sb3_bruno.resume.checkpoint import resume
from sb3_bruno.resume.interrupt import InterruptibleResumeCallback
from sb3_bruno.runs.denormals import flushed_denormals
from sb3_bruno.runs.folder import RunFolder
from sb3_bruno_envs import CHEETAH_DIR_TASKS

ENV_ID = "sb3_bruno_envs:CheetahDir-v0"
SHORT_STEPS, FULL_STEPS = 40_000, 100_000  # env steps
TEST_STEPS, TEST_EPISODES = 1_000, 10  # the paper's final test, per direction
HYPERPARAMETERS: dict[str, Any] = {
    "learning_rate": 1e-3,
    "learning_starts": 10_000,
    "gradient_steps": 5,
    "policy_kwargs": {"net_arch": [256, 256], "optimizer_kwargs": {"fused": True}},
    "replay_buffer_kwargs": {"context": "episode", "n_sequences": 16, "sequence_length": 64},
    "encoder_kwargs": {
        "modelled": "rewards",
        "flow_class": "reflected_maf",
        "extra_dims": 1,
        "process": "gaussian",
        "objective": "paper",
        "belief": "mean_var",
    },
    "encoder_learning_rate": 2e-3,
    "encoder_update_ratio": 0.4,
    "encoder_learning_starts": 1_000,
}
"""Those of ``zoo_configs/bruno_sac.yml``, adapted to a shorter run: twice the updates per step, larger batches."""
N_ENVS = 10
N_EVAL_ENVS, N_EVALUATIONS = 10, 20  # an evaluation runs N_EVAL_ENVS episodes per direction
SAVE_FREQ = 10_000  # env steps between checkpoints


def main(arguments: list[str] | None = None) -> None:
    """Parse the command line and run."""
    parser = argparse.ArgumentParser(
        prog="python -m sb3_bruno.quickstart", description="Train BrunoSAC on Cheetah-Dir and show how it adapts."
    )
    parser.add_argument("--full", action="store_true", help=f"train for {FULL_STEPS:,} env steps")
    parser.add_argument("--steps", type=int, help=f"train for this many env steps (default {SHORT_STEPS:,})")
    parser.add_argument("--seed", type=int, default=1, help="seed of all random numbers (default 1)")
    parser.add_argument("--out", type=Path, default=Path("runs"), help="folder of the results (default runs/)")
    options = parser.parse_args(arguments)
    steps = options.steps if options.steps is not None else FULL_STEPS if options.full else SHORT_STEPS
    if steps < 1:
        parser.error(f"--steps must be positive, got {steps}: give 1 or more")
    folder = options.out / f"cheetah_dir_{steps}_seed{options.seed}"
    folder.mkdir(parents=True, exist_ok=True)
    try:
        held = RunFolder(folder)
    except ValueError as error:
        parser.error(str(error))
    try:
        run(steps, options.seed, folder)
    finally:
        held.release()


def run(steps: int, seed: int, folder: Path) -> AdaptationResult:
    """Train (or go on training), test and save; print where the results are and what they show."""
    th.set_num_threads(1)  # small networks are fastest on one thread, and two runs do not slow each other down
    folder.mkdir(parents=True, exist_ok=True)
    with flushed_denormals():
        model = train(steps, seed, folder)
    with whole_file(folder / "model.zip") as part:
        model.save(part)
    result = evaluate_adaptation(
        model,
        lambda: gym.make(ENV_ID, split="test", max_episode_steps=TEST_STEPS),
        CHEETAH_DIR_TASKS.tasks("test"),
        n_episodes=TEST_EPISODES,
        config={"env": "CheetahDir-v0", "algo": "bruno_sac", "env_steps": steps, "seed": seed, **HYPERPARAMETERS},
    )
    result.save(folder / "adaptation.json")
    plot_adaptation({"BrunoSAC": result}, folder / "adaptation.png")
    plot_learning_curves({"BrunoSAC": [load_learning_curve(folder)]}, folder / "learning_curve.png")
    print(result.summary())
    print(f"Tasks are one-hot: 1_0 is backward, 0_1 is forward. Results in {folder.resolve()}:")
    print("  model.zip           the agent: BrunoSAC.load(...)")
    print("  adaptation.png      reward per env step in each direction: how fast it finds out which way to run")
    print("  learning_curve.png  test return while training; adaptation.json: the numbers")
    return result


def train(steps: int, seed: int, folder: Path) -> OffPolicyAlgorithm:
    """Train for ``steps`` environment steps in total, from the checkpoint in ``folder`` if there is one."""
    checkpoint = folder / "checkpoint.pkl"
    env = make_vec_env(ENV_ID, N_ENVS, seed=seed)
    test_env = make_vec_env(ENV_ID, N_EVAL_ENVS, seed=1_000 + seed, env_kwargs={"split": "test", "draw": "cycle"})
    evaluate = TaskEvalCallback(
        test_env,
        eval_freq=max(steps // N_EVALUATIONS // N_ENVS, 1),
        n_eval_episodes=2 * N_EVAL_ENVS,
        log_path=str(folder),
        verbose=0,
    )
    if checkpoint.exists():
        model = resume(checkpoint, env)
        evaluate.restore(model)
        print(f"Going on at {model.num_timesteps:,} env steps, from {checkpoint}")
    else:
        model = BrunoSAC("MlpPolicy", env, seed=seed, **HYPERPARAMETERS)
    save = InterruptibleResumeCallback(checkpoint, SAVE_FREQ, how_to_resume="give the same command again")
    remaining = steps - model.num_timesteps
    if remaining > 0:
        with save.listening():
            model.learn(remaining, [evaluate, save], reset_num_timesteps=False, progress_bar=True)
    return model


if __name__ == "__main__":
    main()
