"""Measure how fast everything is on one thread, each beside what it should be compared with, in the same run.

    python benchmarks/speed.py --out docs/performance

Every comparison runs its contestants in turn, for many rounds of a fixed amount of work, and takes the ratio within a
round: a machine that is slow for a while is slow for both. Time is the processor time of this process, so what other
processes use does not count. Prints the median over the rounds and the quartiles in brackets; ``speed.json`` has all
rounds. Leave the machine alone meanwhile.
"""

from __future__ import annotations

import argparse
import json
import platform
import resource
import time
import tracemalloc
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import gymnasium as gym
import numpy as np
import torch as th
import yaml
from stable_baselines3 import SAC
from stable_baselines3.common.env_util import make_vec_env
from zuko.flows import MAF

from sb3_bruno import BrunoEncoder, BrunoSAC, TaskReplayBuffer, Transitions
from sb3_bruno.buffers.extended_obs import ExtendedObs
from sb3_bruno.evaluation import library_versions
from sb3_bruno.maths.flow import ConditionalFlow

ENV_ID = "sb3_bruno_envs:CheetahDir-v0"
NETS = {"2 x 256": [256, 256], "2 x 128": [128, 128], "the paper's": {"pi": [128, 128], "qf": [128]}}
OBSERVATION_DIM, ACTION_DIM = 17, 6
CONFIGS = yaml.safe_load((Path(__file__).parents[1] / "zoo_configs" / "bruno_sac.yml").read_text(encoding="utf-8"))
PAPER_CONFIGS = Path(__file__).parents[1] / "zoo_configs" / "paper" / "bruno_sac.yml"
PAPERS = yaml.safe_load(PAPER_CONFIGS.read_text(encoding="utf-8"))["CheetahDir-v0"]
CHEETAH = {key: CONFIGS["CheetahDir-v0"][key] for key in ("encoder_kwargs", "encoder_update_ratio")}
Seconds = dict[str, list[float]]


class Row(NamedTuple):
    """A line of the table: how often ``what`` is done, and its seconds as a multiple of those of ``beside``."""

    what: str
    per_second: float
    beside: str
    ratio: float
    low: float
    high: float
    target: str


def race(contestants: dict[str, Callable[[], Any]], rounds: int, calls: int) -> Seconds:
    """Time the contestants: seconds per call of each, an entry per round of ``calls`` calls."""
    for call in contestants.values():
        call()
    seconds: Seconds = {name: [] for name in contestants}
    for _ in range(rounds):
        for name, call in contestants.items():
            start = time.process_time()
            for _ in range(calls):
                call()
            seconds[name].append((time.process_time() - start) / calls)
    return seconds


def row(what: str, seconds: Seconds, name: str, beside: str, target: str = "", units: int = 1) -> Row:
    """Compare ``name`` with ``beside``, the ratio taken round by round; a call does ``units`` of work."""
    ratio = np.divide(seconds[name], seconds[beside])
    low, middle, high = np.quantile(ratio, (0.25, 0.5, 0.75)).tolist()
    return Row(what, units / float(np.median(seconds[name])), beside, middle, low, high, target)


def trained(n_envs: int = 10, **kwargs: Any) -> BrunoSAC:
    """Make a BrunoSAC with 4,000 random transitions to learn from."""
    env = make_vec_env(ENV_ID, n_envs, seed=0)
    return BrunoSAC("MlpPolicy", env, seed=0, learning_starts=10**9, **kwargs).learn(4_000)


def plain(n_envs: int = 10, **kwargs: Any) -> SAC:
    """Make SB3's SAC with as many."""
    env = make_vec_env(ENV_ID, n_envs, seed=0, env_kwargs={"observe": "plain"})
    return SAC("MlpPolicy", env, seed=0, learning_starts=10**9, **kwargs).learn(4_000)


def encoder_updates(rounds: int) -> tuple[list[Row], Seconds]:
    """Time an encoder update on 10 x 100 transitions, sampling and optimiser included, beside zuko's flow alone."""
    kwargs: dict[str, Any] = {"encoder_batch_size": 10, "replay_buffer_kwargs": {"sequence_length": 100}}
    papers = trained(encoder_kwargs=PAPERS["encoder_kwargs"], **kwargs)
    ours = trained(**kwargs)
    y, x = th.randn(10, 100, 5), th.randn(10, 100, OBSERVATION_DIM + ACTION_DIM)
    zukos = ConditionalFlow(5, OBSERVATION_DIM + ACTION_DIM, MAF, {"transforms": 6, "hidden_features": (128,)})

    def bare() -> None:
        z, log_det = zukos(y, x)
        (z.square().mean() - log_det.mean()).backward()

    flow_alone = "bare zuko forward and backward"
    work = {"the paper's": papers._update_encoder, "the default": ours._update_encoder, flow_alone: bare}
    seconds = race(work, rounds, 10)
    target = "<= 1.25; the paper's code: 31 per second"
    rows = [row(f"encoder update, 10 x 100, {who}", seconds, who, flow_alone, target) for who in [*work][:2]]
    return rows, seconds


def actor_critic_updates(rounds: int) -> tuple[list[Row], Seconds]:
    """Time a gradient step with its beliefs but no encoder update, beside SAC's own."""
    rows, everything = [], {}
    for net, net_arch in NETS.items():
        kwargs: dict[str, Any] = {"policy_kwargs": {"net_arch": net_arch}}
        bruno, sac = trained(encoder_update_ratio=0, **kwargs), plain(**kwargs)
        for batch in (256, 1_000):
            for steps in (1, 5):
                work = {"bruno": partial(bruno.train, steps, batch), "SAC": partial(sac.train, steps, batch)}
                seconds = race(work, rounds, 10 // steps)
                target = {("2 x 256", 256): "<= 1.3", ("2 x 128", 256): "<= 1.5"}.get((net, batch), "")
                if (net, batch) == ("the paper's", 1_000):
                    target = "the paper's code: 28 per second"
                what = f"actor-critic update, {net}, batch {batch}, {steps} per call"
                rows.append(row(what, seconds, "bruno", "SAC", target, steps))
                everything |= {f"{what}: {name}": times for name, times in seconds.items()}
    return rows, everything


def whole_training(rounds: int) -> tuple[list[Row], Seconds]:
    """Time ``train()`` with encoder updates: the defaults, and CheetahDir's encoder with its own ratio."""
    sac = plain()
    models = {"defaults": trained(), "CheetahDir": trained(**CHEETAH)}
    rows, everything = [], {}
    for name, bruno in models.items():
        bruno.encoder_learning_starts = 0
        seconds = race({"bruno": partial(bruno.train, 10, 256), "SAC": partial(sac.train, 10, 256)}, rounds, 1)
        what = f"train(10), encoder included, {name}"
        rows.append(row(what, seconds, "bruno", "SAC", "<= 2.0", 10))
        everything |= {f"{what}: {who}": times for who, times in seconds.items()}
    return rows, everything


def many_steps(physics: gym.Env[Any, Any], steps: int) -> None:
    """Step an environment that has no wrappers."""
    action = np.zeros(ACTION_DIM)
    for _ in range(steps):
        physics.step(action)


def rollouts(rounds: int) -> tuple[list[Row], Seconds]:
    """Time environment steps with policy and belief, beside SAC's rollout and MuJoCo alone."""
    physics = gym.make(ENV_ID).unwrapped
    physics.reset(seed=0)
    rows, everything = [], {}
    for n_envs, encoder_name, kwargs in (
        (1, "", {}),
        (10, "", {}),
        (10, ", CheetahDir's encoder", CHEETAH),
        (20, "", {}),
    ):
        bruno, sac = trained(n_envs, gradient_steps=0, **kwargs), plain(n_envs, gradient_steps=0)
        bruno.learning_starts = sac.learning_starts = 0
        steps = 100 * n_envs
        work = {
            "bruno": partial(bruno.learn, steps, reset_num_timesteps=False),
            "SAC": partial(sac.learn, steps, reset_num_timesteps=False),
            "physics": partial(many_steps, physics, steps),
        }
        seconds = race(work, rounds, 1)
        what = f"env steps of a rollout, {n_envs} envs{encoder_name}"
        target = "<= 1.82 (0.55 x SAC's speed); the paper's code: 1,440 per second" if n_envs == 10 else ""
        rows.append(row(what, seconds, "bruno", "SAC", target, steps))
        rows.append(row(what, seconds, "bruno", "physics", "", steps))
        everything |= {f"{what}: {who}": times for who, times in seconds.items()}
    return rows, everything


def filled(n_tasks: int, n_transitions: int = 200_000, n_envs: int = 100) -> TaskReplayBuffer:
    """A buffer of so many tasks, with an encoder bound."""
    space = gym.make(ENV_ID).observation_space
    buffer = TaskReplayBuffer(n_transitions, space, gym.spaces.Box(-1, 1, (ACTION_DIM,)), "cpu", n_envs)
    tasks = np.arange(n_tasks, dtype=np.float32)[:, None]
    observation = {"observation": np.zeros((n_envs, OBSERVATION_DIM), dtype=np.float32)}
    zeros, dones = np.zeros(n_envs), np.zeros(n_envs, dtype=bool)
    actions = np.zeros((n_envs, ACTION_DIM), dtype=np.float32)
    for step in range(n_transitions // n_envs):
        infos = [{"task": tasks[(step * n_envs + env) % n_tasks]} for env in range(n_envs)]
        buffer.add(observation, observation, actions, zeros, dones, infos)
    encoder = BrunoEncoder(OBSERVATION_DIM, ACTION_DIM).eval()
    buffer.set_encoder(encoder, ExtendedObs(OBSERVATION_DIM, encoder.belief_dim, 1))
    return buffer


def sampling(rounds: int) -> tuple[list[Row], Seconds]:
    """Time samples of 256 with their beliefs, for few and many tasks."""
    buffers = {f"{n:,} tasks": filled(n) for n in (2, 1_000, 100_000)}

    def sample(buffer: TaskReplayBuffer) -> None:
        buffer.forget_beliefs()
        buffer.sample(256)

    seconds = race({name: partial(sample, buffer) for name, buffer in buffers.items()}, rounds, 10)
    return [row(f"sample of 256, {name}", seconds, name, "2 tasks", "flat") for name in buffers], seconds


def random_history(time: int) -> Transitions:
    """Draw one sequence of standard normal transitions."""
    dims = (OBSERVATION_DIM, ACTION_DIM, 1, OBSERVATION_DIM)
    return Transitions(*(th.randn(1, time, dim) for dim in dims))


def growth(rounds: int) -> tuple[list[Row], Seconds]:
    """Time all beliefs of a history by its length, and an encoder update by the number of weights."""
    encoder = BrunoEncoder(OBSERVATION_DIM, ACTION_DIM).eval()

    def prefixes(history: Transitions) -> None:
        with th.no_grad():
            encoder.belief(encoder.prefixes(history))

    histories = {f"{time:,} steps": random_history(time) for time in (100, 1_000, 10_000)}
    lengths = race({name: partial(prefixes, history) for name, history in histories.items()}, rounds, 20)
    rows = [row(f"all beliefs of {name}", lengths, name, "100 steps", "linear") for name in lengths]
    models = {f"{n} weights": trained(encoder_kwargs={"n_weights": n}) for n in (4, 8, 16, 32)}
    dims = race({name: model._update_encoder for name, model in models.items()}, rounds, 5)
    return rows + [row(f"encoder update, {name}", dims, name, "8 weights") for name in dims], lengths | dims


def memory() -> Row:
    """Count the bytes of a full buffer of 200,000 cheetah transitions beside those of the transitions themselves."""
    tracemalloc.start()
    buffer = filled(100)
    used, _ = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    ring = (
        buffer.observations,
        buffer.next_observations,
        buffer.actions,
        buffer.rewards,
        buffer.dones,
        buffer.timeouts,
    )
    ratio = used / sum(array.nbytes for array in ring)
    return Row("bytes of 200,000 transitions", 0, "their own", ratio, ratio, ratio, "<= 1.2")


def table(rows: list[Row]) -> str:
    """Write the rows as a markdown table."""
    lines = ["| work | per second | beside | time, as a multiple (quartiles) | target |", "|---|---|---|---|---|"]
    for entry in rows:
        speed = f"{entry.per_second:,.0f}" if entry.per_second else ""
        ratio = f"{entry.ratio:.2f} ({entry.low:.2f} to {entry.high:.2f})"
        lines.append(f"| {entry.what} | {speed} | {entry.beside} | {ratio} | {entry.target} |")
    return "\n".join(lines) + "\n"


def main() -> None:
    """Parse the command line, measure, write."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("--rounds", type=int, default=20, help="rounds of each comparison (default 20)")
    parser.add_argument(
        "--only", nargs="+", help="sections to run: " + ", ".join(section.__name__ for section in SECTIONS)
    )
    parser.add_argument("--out", type=Path, help="folder for speed.md and speed.json")
    options = parser.parse_args()
    th.set_num_threads(1)
    rows, seconds = [], {}
    for section in SECTIONS:
        if options.only is None or section.__name__ in options.only:
            new, measured = section(options.rounds)
            print(table(new), flush=True)
            rows += new
            seconds[section.__name__] = measured
    rows.append(memory())
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024  # MiB: Linux counts in KiB
    about = {"versions": library_versions(), "machine": platform.machine(), "torch_threads": 1, "peak_mib": peak}
    about |= {"command": f"python benchmarks/speed.py --rounds {options.rounds}"}
    print(table(rows[-1:]), f"peak memory of this process: {peak:,.0f} MiB")
    if options.out is not None:
        options.out.mkdir(parents=True, exist_ok=True)
        made_by = f"Made by `{about['command']}`, one thread, {about['versions']}; peak memory {peak:,.0f} MiB.\n\n"
        (options.out / "speed.md").write_text(made_by + table(rows), encoding="utf-8")
        text = json.dumps({**about, "rows": [entry._asdict() for entry in rows], "seconds": seconds}, indent=1)
        (options.out / "speed.json").write_text(text + "\n", encoding="utf-8")


SECTIONS = (encoder_updates, actor_critic_updates, whole_training, rollouts, sampling, growth)

if __name__ == "__main__":
    main()
