"""The same seed gives the same run, in parts too; callbacks, stops and TensorBoard are SB3's."""

import warnings
from contextlib import nullcontext
from copy import deepcopy

import gymnasium as gym
import numpy as np
import pytest
import torch as th
from stable_baselines3.common.callbacks import (
    CheckpointCallback,
    ConvertCallback,
    EvalCallback,
    StopTrainingOnMaxEpisodes,
    StopTrainingOnNoModelImprovement,
    StopTrainingOnRewardThreshold,
)
from stable_baselines3.common.env_util import make_vec_env
from stable_baselines3.common.evaluation import evaluate_policy
from stable_baselines3.common.logger import configure
from stable_baselines3.common.monitor import Monitor
from stable_baselines3.common.vec_env import DummyVecEnv, VecNormalize
from tensorboard.backend.event_processing import event_accumulator

from support.tiny_models import (
    ALGORITHMS,
    LEARNED,
    LSTM,
    POINT,
    assert_carries,
    assert_same,
    for_each,
    for_each_in_turn,
    for_each_that_takes,
    make_pendulum,
    make_point,
    normalized,
    rollout,
)


@for_each_that_takes({}, {"train_freq": 3, "use_sde": True, "ent_coef": 0.1}, {**LSTM, "encoder_tau": 0.1})
def test_the_same_seed_gives_the_same_run(make_model, options):
    def run(seed):
        model = make_model(make_vec_env(POINT, 2), seed=seed, **options).learn(60)
        return model.get_parameters()["policy"], rollout(model, model.get_env(), 20, deterministic=False)

    first = run(seed=3)
    assert_same(first, run(seed=3))
    assert not np.array_equal(first[1][-1][2], run(seed=4)[1][-1][2])


def test_learning_in_two_parts_equals_learning_at_once(make_model):
    at_once = make_model().learn(100)
    in_parts = make_model().learn(45).learn(55, reset_num_timesteps=False)  # the cut is inside an episode
    assert in_parts.num_timesteps == 100
    assert_same(at_once.get_parameters(), in_parts.get_parameters())


@for_each(ALGORITHMS)
def test_learning_warns_of_nothing(make_model):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        model = make_model().learn(60)
        evaluate_policy(model, model.get_env(), n_eval_episodes=2)


@pytest.mark.filterwarnings("ignore:rich is experimental")  # of the progress bar
def test_callbacks_evaluate_and_save(algorithm, make_model, tmp_path):
    env, eval_env = normalized(make_point), normalized(make_point, training=False)
    evaluate = EvalCallback(
        eval_env,
        callback_on_new_best=StopTrainingOnRewardThreshold(reward_threshold=1e6),
        callback_after_eval=StopTrainingOnNoModelImprovement(max_no_improvement_evals=100),
        best_model_save_path=str(tmp_path),
        log_path=str(tmp_path),
        eval_freq=30,
        n_eval_episodes=2,
        verbose=0,
    )
    keep = CheckpointCallback(50, str(tmp_path), save_replay_buffer=True, save_vecnormalize=True)
    make_model(env).learn(60, [evaluate, keep], progress_bar=True)

    assert evaluate.evaluations_timesteps == [30, 60]
    assert np.shape(evaluate.evaluations_results) == (2, 2)
    algorithm.load(tmp_path / "best_model").predict(eval_env.reset())
    path = tmp_path / "rl_model_vecnormalize_50_steps.pkl"
    renewed = VecNormalize.load(path, DummyVecEnv([make_point]))
    model = algorithm.load(tmp_path / "rl_model_50_steps", env=renewed)
    model.load_replay_buffer(tmp_path / "rl_model_replay_buffer_50_steps.pkl")
    model.learn(20, reset_num_timesteps=False)
    assert model.num_timesteps == 70


@for_each_that_takes({}, {"encoder_learning_starts": 0, "encoder_update_ratio": 1})
def test_a_callback_stops_at_the_first_step(make_model, options):
    model = make_model(**options)
    model.learn(50, callback=lambda *_: False)
    assert (model.num_timesteps, model.replay_buffer.size()) == (1, 0)
    model.learn(50)
    assert model.replay_buffer.size() == 50


def test_a_callback_stops_after_two_episodes(make_model):
    assert make_model().learn(1_000, StopTrainingOnMaxEpisodes(2)).num_timesteps == 60


@for_each_in_turn("error", [None, KeyboardInterrupt])
def test_to_learn_on_after_a_stop_in_mid_episode_begins_new_episodes(make_model, error):
    """Where training stops in a rollout, SB3's env is a step ahead of its buffer, in the next episode perhaps."""

    def stop(step, _):
        if step["self"].num_timesteps < 30:  # the last step of the first episode
            return True
        if error is not None:
            raise error
        return False

    model = make_model(learning_starts=1_000)
    with nullcontext() if error is None else pytest.raises(error):
        model.learn(100, stop)
    model.learn(45, reset_num_timesteps=False)
    assert (model.num_timesteps, model.replay_buffer.size()) == (75, 74)
    slots, lengths = model.replay_buffer.episodes.holding(np.array([28, 29, 59]))
    assert lengths.tolist() == [29, 30, 15] and slots[:, 0].tolist() == [0, 29, 59]
    assert_carries(model, [15])


def test_tensorboard_shows_encoder_and_belief(algorithm, make_model, tmp_path):
    model = make_model(tensorboard_log=str(tmp_path)).learn(70, log_interval=1)
    model.learn(70, log_interval=1, reset_num_timesteps=False)
    model.learn(40, tb_log_name="other")
    assert {folder.name for folder in tmp_path.iterdir()} == {f"{algorithm.__name__}_1", "other_1"}
    events = event_accumulator.EventAccumulator(str(tmp_path / f"{algorithm.__name__}_1"))
    events.Reload()
    shown = set(events.Tags()["scalars"])
    assert {"rollout/ep_rew_mean", "train/actor_loss", "train/critic_loss"} <= shown
    assert {"encoder/learning_rate", "belief/mean_abs"} <= shown
    what_it_learns = LEARNED[algorithm.default_encoder]
    assert what_it_learns <= shown
    assert all(np.isfinite(event.value) for name in what_it_learns for event in events.Scalars(name))


def test_train_alone_trains_the_encoder_on_a_buffer_that_was_loaded(make_model, trained, tmp_path):
    trained.save_replay_buffer(tmp_path / "buffer.pkl")
    model = make_model(make_pendulum())
    model.load_replay_buffer(tmp_path / "buffer.pkl")
    model.set_logger(configure(None, []))
    before = deepcopy(model.policy.state_dict())
    model.train(gradient_steps=4, batch_size=16)
    assert model.num_timesteps == 0 and model._n_encoder_updates > 0
    changed = [name for name, value in model.policy.state_dict().items() if not th.equal(value, before[name])]
    assert {name.split(".")[0] for name in changed} >= {"actor", "critic", "encoder"}


@for_each_in_turn("goes_on", [True, False])
def test_a_monitor_that_forbids_early_resets_is_named_before_anything_is_reset(make_model, goes_on):
    env = Monitor(gym.make(POINT), allow_early_resets=False)
    model = make_model(env).learn(30)  # a whole episode
    model.learn(10, reset_num_timesteps=False)
    if goes_on:
        model.learn(10, ConvertCallback(lambda *_: False), reset_num_timesteps=False)  # stops in mid-rollout
    with pytest.raises(ValueError, match=r"`allow_early_resets=False` .*allow_early_resets=True.*set_env"):
        model.learn(10, reset_num_timesteps=not goes_on)
    model.set_env(make_point())
    model.learn(10, reset_num_timesteps=not goes_on)
