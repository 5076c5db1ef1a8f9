"""Diagnostics of a world that is the encoder's own model, of one that is not, and of what an agent did."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
import torch as th
import zuko
from gymnasium.spaces import Box
from numpy.typing import NDArray
from stable_baselines3.common.env_util import make_vec_env
from stable_baselines3.common.vec_env import VecNormalize

from sb3_bruno import BrunoEncoder, BrunoSAC, Transitions
from sb3_bruno.diagnostics.diagnose import diagnose
from sb3_bruno.evaluation.episodes import play_episodes
from sb3_bruno_envs import POINT_DIR_TASKS, MetaTask, TransitionObservation

SMALL = {"n_weights": 2, "net_arch": (16,), "modelled": "rewards"}
TINY = {
    "flow_class": zuko.flows.MAF,
    "flow_kwargs": {"transforms": 1, "hidden_features": (8,)},
    "net_arch": (8,),
    "modelled": "rewards",
}
# On the CPU, where this file asks the encoder for what `diagnose` found.
SETTINGS: dict[str, Any] = {"policy_kwargs": {"net_arch": [16]}, "buffer_size": 1_000, "seed": 0, "device": "cpu"}
POINT_DIR = "sb3_bruno_envs:PointDir-v0"
MakeEnv = Callable[[], gym.Env[Any, Any]]
Row = NDArray[np.float32]


class ModelWorld(gym.Env[Row, Row]):
    """Draws what it shows from an encoder's predictive, which makes the encoder's model the truth.

    The task is the scale by which all is multiplied that is drawn, 1 for that truth, and the number of steps.
    """

    observation_space = Box(-np.inf, np.inf, (2,))
    action_space = Box(-1.0, 1.0, (1,))

    def __init__(self, encoder_of: dict[str, BrunoEncoder]) -> None:
        self.encoder_of = encoder_of

    def set_task(self, task: Row) -> None:
        self.scale, self.length = float(task[0]), int(task[1])

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Row, dict[str, Any]]:
        super().reset(seed=seed)
        self.seen, self.steps, self.statistics = self._fresh(), 0, None
        return self.seen, {}

    def step(self, action: Row) -> tuple[Row, float, bool, bool, dict[str, Any]]:
        encoder = self.encoder_of["world"]
        statistics = encoder.empty((1,)) if self.statistics is None else self.statistics
        here, taken, there = (th.as_tensor(array)[None] for array in (self.seen, action, self._fresh()))
        with th.no_grad():
            led = None if encoder.model.variables.change_dim else there
            drawn = encoder.outcomes(statistics, here, taken, led, 1)
            reward = th.zeros(1, 1) if drawn.rewards is None else drawn.rewards[0]
            there = there if drawn.next_observations is None else drawn.next_observations[0]
            self.statistics = encoder.absorb(statistics, Transitions(here, taken, reward, there))
        self.steps += 1
        self.seen = there[0].numpy() * np.float32(self.scale if drawn.next_observations is not None else 1.0)
        return self.seen, self.scale * reward.item(), self.steps >= self.length, False, {}

    def _fresh(self) -> Row:
        return self.np_random.normal(size=2).astype(np.float32)


def world_of(**encoder_kwargs: Any) -> tuple[BrunoSAC, MakeEnv]:
    """An agent, and the world of its encoder's model."""
    encoder_of: dict[str, BrunoEncoder] = {}
    space = Box(0.0, 100.0, (2,))

    def make_env() -> gym.Env[Any, Any]:
        world = MetaTask(ModelWorld(encoder_of), ModelWorld.set_task, [[1.0, 30.0]], task_space=space)
        return TransitionObservation(world)

    model = BrunoSAC("MlpPolicy", make_env(), encoder_kwargs={**TINY, **encoder_kwargs}, **SETTINGS)
    assert isinstance(model.encoder, BrunoEncoder)
    encoder_of["world"] = model.encoder
    with th.no_grad():
        variables = model.encoder.model.variables
        for standardize in (variables.rewards, variables.changes):
            standardize.var.fill_(0.01)  # small steps: where they grow as they lead on, all ends in NaN
    th.manual_seed(17)  # of what the world draws, which must not be what the samples are drawn with
    return model, make_env


def point_dir(**kwargs: Any) -> BrunoSAC:
    return BrunoSAC("MlpPolicy", make_vec_env(POINT_DIR, 2), encoder_kwargs={**SMALL, **kwargs}, **SETTINGS)


def make_point_dir() -> gym.Env[Any, Any]:
    return gym.make(POINT_DIR)


@pytest.mark.parametrize(
    ("modelled", "process", "quantities"),
    [
        ("rewards", "gaussian", ["reward"]),
        ("rewards", "kernel", ["reward"]),
        ("next_observations", "kernel", ["change of observation 0", "change of observation 1"]),
        ("both", "kernel_student_t", ["reward", "change of observation 0", "change of observation 1"]),
    ],
)
def test_a_model_that_is_the_truth_is_calibrated(modelled: str, process: str, quantities: list[str]) -> None:
    model, make_env = world_of(modelled=modelled, process=process)
    found = diagnose(model, make_env, [[1.0, 20.0]], n_episodes=40)
    assert found.quantities.tolist() == quantities
    assert found.pit.shape == (1, 40, 20, len(quantities))
    assert found.pit_ks().max() < 0.07  # 800 values: 1.95 / sqrt(800) = 0.069 is exceeded once in a thousand
    assert found.distance_ks().max() < 0.31  # 40 values: likewise
    np.testing.assert_allclose(found.coverage(0.5), 0.5, atol=0.06)
    np.testing.assert_allclose(found.coverage(0.9), 0.9, atol=0.04)
    assert found.distance_levels.shape[-1] == 1


def test_the_same_tasks_raise_no_alarm() -> None:
    tasks = POINT_DIR_TASKS.tasks("test")
    assert 0.3 < diagnose(point_dir(), make_point_dir, tasks, n_episodes=20, outside_tasks=tasks).auroc() < 0.7


@pytest.mark.parametrize(("scale", "within_half"), [(0.2, (0.8, 1.0)), (5.0, (0.0, 0.3))])
def test_a_wrong_scale_shows_everywhere(scale: float, within_half: tuple[float, float]) -> None:
    model, make_env = world_of(process="gaussian")  # a Student-t would learn the scale
    found = diagnose(model, make_env, [[scale, 20.0]], n_episodes=20, outside_tasks=[[20.0, 20.0]])
    assert found.pit_ks().min() > 0.15
    assert found.distance_ks().min() > 0.5
    assert within_half[0] <= found.coverage(0.5).item() <= within_half[1]
    assert found.auroc() > 0.99


def test_episodes_that_end_early_leave_nan_and_bias_nothing() -> None:
    model, make_env = world_of()
    found = diagnose(model, make_env, [[1.0, 4.0], [1.0, 7.0]], n_episodes=3, outside_tasks=[[1.0, 2.0]])
    for task, length in enumerate((4, 7)):
        for array, known in ((found.pit, length), (found.log_scores, length), (found.beliefs, length + 1)):
            assert np.isfinite(array[task, :, :known]).all() and np.isnan(array[task, :, known:]).all()
        for row in (found.real[task], *found.predicted[:, task]):
            assert np.isfinite(row[:length]).all() and np.isnan(row[length:]).all()
    assert found.outside_log_scores is not None and found.outside_log_scores.shape == (1, 3, 2)
    assert np.isfinite(list(found.numbers().values())).all()


@pytest.mark.parametrize("normalize", [False, True])
def test_what_is_found_is_what_the_agent_believed(normalize: bool) -> None:
    model = point_dir()
    normalizer = VecNormalize(make_vec_env(POINT_DIR, 1), training=False) if normalize else None
    if normalizer is not None:
        normalizer.obs_rms["observation"].mean[:] = 0.3
        normalizer.obs_rms["reward"].var[:] = 4.0
    tasks = POINT_DIR_TASKS.tasks("test")
    found = diagnose(model, make_point_dir, tasks, n_episodes=2, seed=5, vec_normalize=normalizer)
    recorded = play_episodes(model, make_point_dir, tasks, n_episodes=2, seed=5, vec_normalize=normalizer)
    model._vec_normalize_env = normalizer
    for of_task, points, real in zip(recorded, found.beliefs, found.real, strict=True):
        np.testing.assert_array_equal(real, of_task[0].rewards)
        for episode, path in zip(of_task, points, strict=True):
            columns = (episode.observations, episode.actions, episode.rewards[:, None], episode.next_observations)
            prefixes = [model.infer(Transitions(*(column[:t] for column in columns))).mean for t in range(31)]
            # Two weights: on their principal axes all distances stay as they are.
            np.testing.assert_allclose(
                np.linalg.norm(path - path[0], axis=1), np.linalg.norm(np.stack(prefixes), axis=1), rtol=1e-3, atol=1e-5
            )
    assert found.explained.sum() == pytest.approx(1.0)
    first = recorded[-1][0]
    columns = (first.observations, first.actions, first.rewards[:, None], first.next_observations)
    belief = model.infer(Transitions(*(column[:12] for column in columns)))
    estimate = model.infer_task(Transitions(*(column[:12] for column in columns)))
    assert found.readout_misses is not None and estimate.tasks is not None and estimate.probabilities is not None
    true = (estimate.tasks == tasks[-1]).all(axis=-1)
    assert found.readout_misses[-1, 0, 12, 0] == pytest.approx(1 - estimate.probabilities[true].item(), abs=1e-5)
    samples = model.predict_outcomes(belief, *(columns[i][12] for i in (0, 1, 3)), n_samples=4_000).rewards
    assert samples is not None
    truth = [samples.mean(), samples.quantile(0.05), samples.quantile(0.95)]
    some_errors = 0.7 * samples.std().item()  # 99 samples know the mean to 0.1 standard deviations, quantiles to 0.25
    np.testing.assert_allclose(found.predicted[:, -1, 12], [number.item() for number in truth], atol=some_errors)


def test_beliefs_of_a_trial_leave_out_what_the_agent_was_not_shown() -> None:
    env_id = "sb3_bruno_envs:SparsePointGoal-v0"
    model = BrunoSAC("MlpPolicy", make_vec_env(env_id, 1), encoder_kwargs={**SMALL, "n_weights": 1}, **SETTINGS)
    task = np.array([[0.0, 1.0]], dtype=np.float32)
    found = diagnose(model, lambda: gym.make(env_id, n_episodes=2), task, n_episodes=1)
    means: list[NDArray[Any]] = []

    class Noting:
        """Notes what the agent believes where it acts."""

        def predict(self, observation: Any, state: Any = None, *args: Any, **kwargs: Any) -> Any:
            actions, state = model.predict(observation, state, *args, **kwargs)
            assert state is not None
            means.append(model.belief(state).mean[0])
            return actions, state

    ((episode,),) = play_episodes(Noting(), lambda: gym.make(env_id, n_episodes=2), task, n_episodes=1)
    assert np.flatnonzero(episode.inner_ends).tolist() == [19]
    carried = np.abs(np.concatenate(means))  # one weight, whose prior mean is 0
    assert carried[20] == carried[19] != carried[18]
    np.testing.assert_allclose(np.abs(found.beliefs[0, 0, :-1, 0] - found.beliefs[0, 0, 0, 0]), carried, atol=1e-5)


def test_log_scores_are_the_encoders_own_in_the_order_of_the_episode() -> None:
    model = point_dir(n_weights=1)
    tasks = POINT_DIR_TASKS.tasks("test")
    found = diagnose(model, make_point_dir, tasks, n_episodes=2, outside_tasks=tasks[:1])
    outside = play_episodes(model, make_point_dir, tasks[:1], n_episodes=2, seed=1)
    inside = play_episodes(model, make_point_dir, tasks, n_episodes=2, seed=0)
    for recorded, log_scores in ((inside, found.log_scores), (outside, found.outside_log_scores)):
        assert log_scores is not None
        for episodes, rows in zip(recorded, log_scores, strict=True):
            for episode, row in zip(episodes, rows, strict=True):
                rewards = episode.rewards[:, None]
                columns = (episode.observations, episode.actions, rewards, episode.next_observations)
                transitions = Transitions(*map(th.as_tensor, columns))
                with th.no_grad():
                    np.testing.assert_allclose(row, model.encoder.one_step_scores(transitions), rtol=1e-4, atol=1e-5)
    np.testing.assert_allclose(found.explained, [1, 0])  # one weight
    np.testing.assert_allclose(found.beliefs[..., 1], 0)


def test_the_seed_decides_and_torchs_state_stays() -> None:
    model = point_dir()
    tasks = POINT_DIR_TASKS.tasks("test")

    def pit(seed: int) -> NDArray[Any]:
        return np.asarray(diagnose(model, make_point_dir, tasks, n_episodes=1, seed=seed).pit)

    before = th.random.get_rng_state()
    first = pit(3)
    th.testing.assert_close(th.random.get_rng_state(), before, rtol=0, atol=0)
    th.manual_seed(17)
    np.testing.assert_array_equal(pit(3), first)
    assert (pit(4) != first).any()


def test_long_episodes_are_scored_at_fifty_steps() -> None:
    model = point_dir()
    found = diagnose(
        model, lambda: gym.make(POINT_DIR, max_episode_steps=120), POINT_DIR_TASKS.tasks("test"), n_episodes=1
    )
    assert found.pit.shape[2] == 50 and found.log_scores.shape[2] == 120
    assert np.isfinite(found.pit).all()


def test_errors_name_the_argument_and_the_remedy() -> None:
    model = point_dir()
    with pytest.raises(ValueError, match=r"tasks have shape \(2,\): give at least one"):
        diagnose(model, make_point_dir, [1.0, 0.0])
    with pytest.raises(ValueError, match="n_episodes=0 is not positive"):
        diagnose(model, make_point_dir, [[1.0, 0.0]], n_episodes=0)
    model.policy.encoder = th.nn.Identity()  # type: ignore[assignment]  # some other encoder
    with pytest.raises(ValueError, match=r"ability `HasPosterior`, and `Identity` has no `posterior`: add it"):
        diagnose(model, make_point_dir, [[1.0, 0.0]])


def test_an_encoder_that_measures_no_distance_is_diagnosed_without() -> None:
    model, whole = point_dir(), point_dir()
    model.encoder.__class__ = type("Shy", (type(model.encoder),), {"distance": None})
    found = diagnose(model, make_point_dir, [[1.0, 0.0]], n_episodes=2)
    expected = diagnose(whole, make_point_dir, [[1.0, 0.0]], n_episodes=2)
    assert found.distance_levels is None and expected.distance_levels is not None
    np.testing.assert_array_equal(found.pit, expected.pit)


class WithConstants(gym.ObservationWrapper[Row, Row, Row]):
    """Appends two entries that never change to the observation of Pendulum."""

    def __init__(self) -> None:
        super().__init__(gym.make("Pendulum-v1", max_episode_steps=20))
        self.observation_space = Box(-10.0, 10.0, (5,), dtype=np.float32)

    def observation(self, observation: Row) -> Row:
        return np.append(observation, np.float32([0.0, 3.5]))


def test_entries_of_the_observation_that_never_change_are_left_out() -> None:
    def set_gravity(pendulum: Any, task: Row) -> None:
        pendulum.g = float(task[0])

    def make() -> gym.Env[Any, Any]:
        return TransitionObservation(MetaTask(WithConstants(), set_gravity, [[8.0], [12.0]]))

    model = BrunoSAC("MlpPolicy", make(), encoder_kwargs={**SMALL, "modelled": "both"}, **SETTINGS)
    found = diagnose(model, make, [[8.0], [12.0]], n_episodes=1)
    assert found.quantities.tolist() == ["reward", *(f"change of observation {i}" for i in range(3))]
    assert found.pit.shape[-1] == len(found.coverage(0.5)) == 4
