"""Exact resume: the resumed run equals the uninterrupted one, bit for bit, whenever the process dies."""

import gymnasium as gym
import numpy as np
import pytest
import torch as th
from stable_baselines3 import PPO, SAC, HerReplayBuffer
from stable_baselines3.common.env_util import make_vec_env
from stable_baselines3.common.envs import BitFlippingEnv
from stable_baselines3.common.monitor import Monitor, load_results
from stable_baselines3.common.vec_env import (
    DummyVecEnv,
    VecFrameStack,
    VecMonitor,
    VecNormalize,
)

from sb3_bruno import BeliefSAC, BrunoSAC, PearlSAC, RecurrentCrossQ, RecurrentSAC, TaskSAC, VaribadSAC
from sb3_bruno.resume import ResumeCallback, resume
from support.resumed_runs import COMMON, SETTINGS, Die, fingerprint, point, scramble_random_states, tensors_of

STEPS = 240
GRU = {"hidden_size": 8}
LSTM = {"hidden_size": 8, "cell": "lstm"}
PROTOCOL = {"net_arch": (8,), "belief": "sample", "exploration_episodes": 2}
TRANSFORMER = {"hidden_size": 8, "n_heads": 2, "window": 4}
TAUGHT = {**COMMON, "encoder_kwargs": GRU, "replay_buffer_kwargs": {"n_sequences": 4}}


def trials():
    return make_vec_env("sb3_bruno_envs:SparsePointGoal-v0", 3, seed=0)


def normalized():
    return VecNormalize(point(), gamma=0.9)


def watched():
    return VecMonitor(VecNormalize(DummyVecEnv([lambda: gym.make("sb3_bruno_envs:PointDir-v0")] * 3)))


@pytest.mark.parametrize(
    ("make_env", "died_at"), [(point, 75), (point, 170), (trials, 170), (normalized, 75), (watched, 170)]
)
def test_a_resumed_run_equals_the_uninterrupted_one(tmp_path, make_env, died_at):
    check_resumed_run(tmp_path / "checkpoint.pkl", BrunoSAC, make_env, SETTINGS, died_at)


@pytest.mark.parametrize("algorithm", [BrunoSAC, RecurrentSAC])
def test_so_does_one_in_one_env(tmp_path, algorithm):
    settings = SETTINGS if algorithm is BrunoSAC else TAUGHT
    check_resumed_run(tmp_path / "checkpoint.pkl", algorithm, lambda: point(1), settings, died_at=75, steps=110)


TAUGHT_RUNS = {
    "gru": (RecurrentSAC, point, {}),
    "lstm in trials": (RecurrentSAC, trials, {"encoder_kwargs": LSTM}),
    "target, VecNormalize": (RecurrentSAC, normalized, {"encoder_tau": 0.1}),
    "by the actor, in trials": (RecurrentSAC, trials, {"encoder_kwargs": {**GRU, "learns_from": "actor"}}),
    "CrossQ": (RecurrentCrossQ, point, {"encoder_tau": 0.1}),
    "VariBAD, in trials": (VaribadSAC, trials, {}),
    "Belief, VecNormalize": (BeliefSAC, normalized, {"encoder_kwargs": {**GRU, "bottleneck": 0.01}}),
    "buffer shorter than an episode": (RecurrentSAC, point, {"buffer_size": 60, "train_freq": 2}),
    "PEARL": (PearlSAC, point, {"encoder_kwargs": {"net_arch": (8,), "belief": "sample"}, "encoder_tau": 0.1}),
    "PEARL's protocol, in trials": (PearlSAC, trials, {"encoder_kwargs": PROTOCOL}),
    "split": (TaskSAC, point, {"encoder_class": "split_aggregator"}),
    "transformer": (TaskSAC, trials, {"encoder_class": "causal_transformer", "encoder_kwargs": TRANSFORMER}),
}


@pytest.mark.parametrize("run", TAUGHT_RUNS)
def test_a_resumed_run_whose_encoder_is_taught_equals_the_uninterrupted_one(tmp_path, run):
    algorithm, make_env, settings = TAUGHT_RUNS[run]
    check_resumed_run(tmp_path / "checkpoint.pkl", algorithm, make_env, {**TAUGHT, **settings}, died_at=170)


def check_resumed_run(path, algorithm, make_env, settings, died_at, steps=STEPS):
    whole = algorithm("MlpPolicy", make_env(), **settings).learn(steps)
    with pytest.raises(KeyboardInterrupt):
        algorithm("MlpPolicy", make_env(), **settings).learn(steps, [ResumeCallback(path, 30), Die(died_at)])
    scramble_random_states()
    resumed = resume(path, make_env())
    assert 0 < resumed.num_timesteps <= died_at
    resumed.learn(steps - resumed.num_timesteps, reset_num_timesteps=False)
    assert resumed.num_timesteps == whole.num_timesteps and resumed._n_encoder_updates == whole._n_encoder_updates > 0
    for tensor, expected in zip(fingerprint(resumed), fingerprint(whole), strict=True):
        assert th.equal(tensor, expected)
    assert resumed.ep_info_buffer[-1]["r"] == whole.ep_info_buffer[-1]["r"]


def test_sb3s_own_algorithms_are_resumed_alike(tmp_path):
    def make_env():
        return point(env_kwargs={"observe": "task"})

    settings = {key: value for key, value in SETTINGS.items() if not key.startswith(("encoder", "replay"))}
    whole = SAC("MlpPolicy", make_env(), **settings).learn(STEPS)
    path = tmp_path / "checkpoint.pkl"
    with pytest.raises(KeyboardInterrupt):
        SAC("MlpPolicy", make_env(), **settings).learn(STEPS, [ResumeCallback(path, 30), Die(170)])
    scramble_random_states()
    resumed = resume(path, make_env())
    resumed.learn(STEPS - resumed.num_timesteps, reset_num_timesteps=False)
    for tensor, expected in zip(tensors_of(resumed.get_parameters()), tensors_of(whole.get_parameters()), strict=True):
        assert th.equal(tensor, expected)


def test_frames_are_stacked_on(tmp_path):
    def make_env():
        return VecFrameStack(point(env_kwargs={"observe": "plain"}), 3)

    settings = {key: value for key, value in SETTINGS.items() if not key.startswith(("encoder", "replay"))}
    whole = SAC("MlpPolicy", make_env(), **settings).learn(STEPS)
    SAC("MlpPolicy", make_env(), **settings).learn(170, ResumeCallback(tmp_path / "checkpoint.pkl", 160))
    resumed = resume(tmp_path / "checkpoint.pkl", make_env())
    resumed.learn(STEPS - resumed.num_timesteps, reset_num_timesteps=False)
    np.testing.assert_array_equal(whole.replay_buffer.observations, resumed.replay_buffer.observations)


@pytest.mark.parametrize("make_env", [normalized, point])
def test_a_vec_normalize_may_be_left_out_and_nothing_else(tmp_path, make_env):
    path = tmp_path / "checkpoint.pkl"
    model = BrunoSAC("MlpPolicy", normalized(), **SETTINGS).learn(90, ResumeCallback(path, 60))
    resumed = resume(path, make_env())
    assert resumed.get_vec_normalize_env().gamma == 0.9
    resumed.learn(model.num_timesteps - resumed.num_timesteps, reset_num_timesteps=False)
    np.testing.assert_array_equal(resumed.env.returns, model.env.returns)
    for wrong in (VecMonitor(point()), VecMonitor(normalized())):
        with pytest.raises(ValueError, match=r"wrapped in \['VecMonitor'.*, the checkpoint's in \['VecNormalize'\]"):
            resume(path, wrong)


def test_hindsight_goes_on(tmp_path):
    def make_env():
        return DummyVecEnv([lambda: Monitor(BitFlippingEnv(n_bits=2, continuous=True))])

    kwargs = {"learning_starts": 10, "batch_size": 8, "replay_buffer_class": HerReplayBuffer}
    kwargs |= {"policy_kwargs": {"net_arch": [8]}, "buffer_size": 200}
    SAC("MultiInputPolicy", make_env(), **kwargs).learn(60, ResumeCallback(tmp_path / "checkpoint.pkl", 40))
    resumed = resume(tmp_path / "checkpoint.pkl", make_env())
    assert resumed.learn(20, reset_num_timesteps=False).num_timesteps >= 60


def test_monitor_files_go_on_where_the_checkpoint_was_taken(tmp_path):
    def make_env(folder, **kwargs):
        return point(monitor_dir=str(tmp_path / folder), monitor_kwargs={"info_keywords": ("task_index",), **kwargs})

    def rows(folder):
        return [
            (row.r, row.l, row.task_index) for row in load_results(str(tmp_path / folder)).sort_values("r").itertuples()
        ]

    BrunoSAC("MlpPolicy", make_env("whole"), **SETTINGS).learn(STEPS)
    path = tmp_path / "checkpoint.pkl"
    with pytest.raises(KeyboardInterrupt):
        BrunoSAC("MlpPolicy", make_env("parts"), **SETTINGS).learn(STEPS, [ResumeCallback(path, 100), Die(195)])
    resumed = resume(path, make_env("parts", override_existing=False))
    assert resumed.num_timesteps < 180  # and two episodes of each env have been written since
    resumed.learn(STEPS - resumed.num_timesteps, reset_num_timesteps=False)
    assert rows("parts") == rows("whole")


@pytest.mark.mujoco
def test_the_cheetahs_physics_goes_on_where_it_was(tmp_path):
    def make_env():
        return make_vec_env("sb3_bruno_envs:CheetahDir-v0", 2, seed=0)

    whole = BrunoSAC("MlpPolicy", make_env(), **SETTINGS).learn(100)
    path = tmp_path / "checkpoint.pkl"
    with pytest.raises(KeyboardInterrupt):
        BrunoSAC("MlpPolicy", make_env(), **SETTINGS).learn(100, [ResumeCallback(path, 30), Die(80)])
    scramble_random_states()
    resumed = resume(path, make_env())
    resumed.learn(100 - resumed.num_timesteps, reset_num_timesteps=False)
    for tensor, expected in zip(fingerprint(resumed), fingerprint(whole), strict=True):
        assert th.equal(tensor, expected)


def test_mistakes_are_named(tmp_path):
    with pytest.raises(ValueError, match="off-policy"):
        PPO("MlpPolicy", point(env_kwargs={"observe": "plain"})).learn(1, ResumeCallback(tmp_path / "checkpoint.pkl"))
    for save_freq in (0, float("nan")):
        with pytest.raises(ValueError, match=f"save_freq={save_freq} is not positive"):
            ResumeCallback(tmp_path / "checkpoint.pkl", save_freq)
    with pytest.raises(FileNotFoundError):
        resume(tmp_path / "none.pkl", point())
    BrunoSAC("MlpPolicy", point(), **SETTINGS).learn(90, ResumeCallback(tmp_path / "checkpoint.pkl", 40))
    with pytest.raises(ValueError, match="2 envs, the checkpoint 3"):
        resume(tmp_path / "checkpoint.pkl", point(2))
    unmonitored = DummyVecEnv([lambda: gym.make("sb3_bruno_envs:PointDir-v0")] * 3)
    with pytest.raises(ValueError, match="0 Monitors, the checkpoint 3"):
        resume(tmp_path / "checkpoint.pkl", unmonitored)
    BrunoSAC("MlpPolicy", unmonitored, **SETTINGS).learn(90, ResumeCallback(tmp_path / "unmonitored.pkl", 40))
    with pytest.raises(ValueError, match="3 Monitors, the checkpoint 0"):
        resume(tmp_path / "unmonitored.pkl", point())
