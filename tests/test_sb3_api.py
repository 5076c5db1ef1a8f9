"""Every algorithm keeps SB3's promises: every option runs, what is saved comes back, the same seed gives the same run.

Three envs: PointDir, several tasks in NumPy alone; SparsePointGoal, trials of several episodes; and Pendulum with its
one constant task, whose actions are not in [-1, 1]. Networks are tiny, so nothing here is learned.
"""

import inspect
import re
import warnings
from copy import deepcopy

import gymnasium as gym
import numpy as np
import pytest
import torch as th
import zuko
from gymnasium import spaces
from stable_baselines3 import SAC
from stable_baselines3.common.callbacks import (
    BaseCallback,
    CheckpointCallback,
    EvalCallback,
    StopTrainingOnMaxEpisodes,
    StopTrainingOnNoModelImprovement,
    StopTrainingOnRewardThreshold,
)
from stable_baselines3.common.env_util import make_vec_env
from stable_baselines3.common.evaluation import evaluate_policy
from stable_baselines3.common.monitor import Monitor
from stable_baselines3.common.noise import NormalActionNoise, OrnsteinUhlenbeckActionNoise
from stable_baselines3.common.utils import LinearSchedule
from stable_baselines3.common.vec_env import DummyVecEnv, SubprocVecEnv, VecNormalize
from tensorboard.backend.event_processing import event_accumulator

from sb3_bruno import BrunoCrossQ, BrunoEncoder, BrunoSAC, BrunoTD3, BrunoTQC, Transitions
from sb3_bruno.buffers import _RING as RING
from sb3_bruno_envs import MetaTask, TransitionObservation

ALGORITHMS = [BrunoSAC, BrunoTQC, BrunoCrossQ, BrunoTD3]
POINT = "sb3_bruno_envs:PointDir-v0"  # episodes of 30 steps
TRIAL = "sb3_bruno_envs:SparsePointGoal-v0"  # trials of three episodes of 20 steps
TINY_FLOW = {"flow_class": zuko.flows.MAF, "flow_kwargs": {"transforms": 2, "hidden_features": (16,)}}
TINY = {
    "policy_kwargs": {"net_arch": [16]},
    "encoder_kwargs": TINY_FLOW,
    "encoder_batch_size": 4,
    "replay_buffer_kwargs": {"n_sequences": 4, "sequence_length": 8},
    "buffer_size": 1_000,
    "batch_size": 16,
    "learning_starts": 40,
    "seed": 0,
    "device": "cpu",
}


def name_of(options):
    """A test's name, the same in every process: without the addresses of functions."""
    return re.sub(r" at 0x[0-9a-f]+", "", str(options))


def make_pendulum():
    return Monitor(TransitionObservation(MetaTask(gym.make("Pendulum-v1", max_episode_steps=25))))


def make_point():
    return Monitor(gym.make(POINT))


@pytest.fixture(scope="module", params=ALGORITHMS, ids=lambda one: one.__name__)
def algorithm(request):
    return request.param


@pytest.fixture(scope="module")
def make_model(algorithm):
    def make(env=POINT, policy="MlpPolicy", **kwargs):
        """A tiny model; dicts are merged into those of ``TINY``."""
        merged = {key: {**TINY[key], **value} if isinstance(value, dict) else value for key, value in kwargs.items()}
        return algorithm(policy, env, **{**TINY, **merged})

    return make


def for_each_that_takes(*options):
    """Run a test for every algorithm with each of the options that it has an argument for."""
    pairs = [(one, option) for one in ALGORITHMS for option in options if option.keys() <= arguments_of(one)]
    names = [f"{one.__name__}-{name_of(option)}" for one, option in pairs]
    return pytest.mark.parametrize(("algorithm", "options"), pairs, indirect=["algorithm"], ids=names, scope="module")


def arguments_of(algorithm):
    """The names of an algorithm's arguments: the mixin's and SB3's."""
    return {name for base in algorithm.__bases__ for name in inspect.signature(base).parameters}


def normalized(env_fn=make_pendulum, **kwargs):
    return VecNormalize(DummyVecEnv([env_fn]), **kwargs)


@pytest.fixture(scope="module")
def trained(make_model):
    """A model after 60 steps of Pendulum, 20 of them with updates: not to be changed."""
    return make_model(make_pendulum()).learn(60)


def rollout(model, env, n_steps, deterministic=True):
    """Observations, states and actions of one agent in a vec env that has been seeded."""
    observation, state, start = env.reset(), None, np.ones(env.num_envs, dtype=bool)
    steps = []
    for _ in range(n_steps):
        action, state = model.predict(observation, state, start, deterministic)
        steps.append((observation, state, action))
        observation, _, start, _ = env.step(action)
    return steps


def assert_same(one, other):
    """Two nests of dicts, lists, tensors and numbers are equal, bit for bit."""
    if isinstance(one, dict):
        assert one.keys() == other.keys()
        one, other = list(one.values()), list(other.values())
    if isinstance(one, list | tuple):
        assert len(one) == len(other)
        for a, b in zip(one, other, strict=True):
            assert_same(a, b)
    else:
        np.testing.assert_array_equal(one, other)


# -- every option runs -----------------------------------------------------------------------------------------------

NOISE = {"mean": np.zeros(2), "sigma": 0.1 * np.ones(2)}
OPTIONS = [
    {"ent_coef": "auto_0.1"},
    {"ent_coef": 0.01},
    {"train_freq": 4},
    {"train_freq": (4, "step"), "gradient_steps": 2},
    {"train_freq": (1, "episode"), "gradient_steps": -1},
    {"action_noise": NormalActionNoise(**NOISE)},
    {"action_noise": OrnsteinUhlenbeckActionNoise(**NOISE)},
    {"use_sde": True, "sde_sample_freq": 4},
    {"use_sde": True, "use_sde_at_warmup": True, "policy_kwargs": {"use_expln": True}},
    {"tau": 1.0, "target_update_interval": 4},
    {"learning_rate": LinearSchedule(1e-3, 1e-4, 0.5), "encoder_learning_rate": LinearSchedule(1e-3, 1e-4, 0.5)},
    {"learning_rate": lambda left: left * 1e-3, "encoder_learning_rate": lambda left: left * 1e-3},
    {"learning_starts": 0, "encoder_learning_starts": 0},
    {"encoder_learning_starts": 10},
    {"encoder_learning_starts": 60},
    {"encoder_update_ratio": 0.25},
    {"encoder_update_ratio": 2},
    {"buffer_size": 20},  # shorter than an episode
    {"buffer_size": 1, "batch_size": 2},
    {"batch_size": 3},  # fewer than sequences
    {"policy_kwargs": {"n_critics": 1}},
    {"policy_kwargs": {"n_critics": 3, "net_arch": {"pi": [8], "qf": [8, 8]}}},
    {"policy_kwargs": {"optimizer_class": th.optim.AdamW, "optimizer_kwargs": {"weight_decay": 0.1}}},
    {"policy_kwargs": {"net_arch": []}},
    {"replay_buffer_kwargs": {"context": "recent", "n_recent": 10}},
    {"replay_buffer_kwargs": {"context": "episode"}},
    {"replay_buffer_kwargs": {"handle_timeout_termination": False}},
    {"critic_input": "belief"},
    {"critic_input": "both"},
    {"encoder_kwargs": {"modelled": "next_observations"}},
    {"encoder_kwargs": {"modelled": "both", "extra_dims": 1}},
    {"encoder_kwargs": {"belief": "mean"}},
]


@for_each_that_takes(*OPTIONS)
def test_every_option_learns(make_model, options):
    model = make_model(**options)
    before = deepcopy(model.get_parameters()["policy"])
    model.learn(70)
    after = model.get_parameters()["policy"]
    assert model.num_timesteps >= 70
    assert all(value.isfinite().all() for value in after.values())
    for part in ("actor.", "critic.", "critic_target.", "encoder."):
        of_it = [name for name in before if name.startswith(part)]  # CrossQ has no targets
        assert not of_it or any(not th.equal(before[name], after[name]) for name in of_it)


@pytest.mark.parametrize("train_freq", ["4", ("1", "episode"), (1, "close")])
def test_a_train_freq_that_sb3_refuses_is_refused(make_model, train_freq):
    with pytest.raises(ValueError, match=r"train_freq|train frequency|invalid literal|integer"):
        make_model(train_freq=train_freq).learn(1)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"policy": "CnnPolicy"}, "CnnPolicy"),
        ({"n_steps": 3}, "n_steps=3"),
        ({"optimize_memory_usage": True}, "optimize_memory_usage"),
        ({"policy_kwargs": {"features_extractor_kwargs": {"features_dim": 3}}}, "features_extractor_kwargs"),
        ({"replay_buffer_kwargs": {"context": "future"}}, "'future'"),
        ({"encoder_batch_size": 0}, "encoder_batch_size"),
        ({"encoder_update_ratio": -1.0}, "encoder_update_ratio"),
        ({"critic_input": "reward"}, "critic_input"),
        ({"policy_kwargs": {"critic_input": "both"}}, r"critic_input.*policy_kwargs"),
        ({"env": "Pendulum-v1"}, "TransitionObservation"),
    ],
    ids=str,
)
def test_what_cannot_work_is_refused_by_name(make_model, options, message):
    with pytest.raises(ValueError, match=message):
        make_model(**options)


def test_both_names_and_the_class_mean_the_same_policy(make_model):
    model = make_model(policy="MlpPolicy")
    for policy in ("MultiInputPolicy", type(model.policy)):
        assert_same(model.get_parameters(), make_model(policy=policy).get_parameters())


@pytest.mark.parametrize("n_envs", [1, 3])
def test_gradient_steps_count_the_transitions_of_all_envs(make_model, n_envs):
    env = make_vec_env(POINT, n_envs, seed=0)
    noise = NormalActionNoise(**NOISE)  # SB3 makes it one noise per env
    model = make_model(env, learning_starts=0, train_freq=5, gradient_steps=-1, action_noise=noise)
    model.learn(15 * n_envs)
    assert model._n_updates == 15 * n_envs
    assert model.replay_buffer.size() == 15


def test_envs_in_subprocesses(make_model):
    env = make_vec_env(POINT, 2, seed=0, vec_env_cls=SubprocVecEnv, vec_env_kwargs={"start_method": "fork"})
    try:
        model = make_model(env).learn(80)
        evaluate_policy(model, env, n_eval_episodes=2)
    finally:
        env.close()


class MatrixEnv(gym.Env):
    """Observations (2, 3) and actions (2, 2), both float64; the actions' bounds are lopsided."""

    observation_space = spaces.Box(-1.0, 1.0, (2, 3), np.float64)
    action_space = spaces.Box(-1.0, 3.0, (2, 2), np.float64)

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        return self.np_random.uniform(-1.0, 1.0, (2, 3)), {}

    def step(self, action):
        assert self.action_space.contains(action)
        return self.np_random.uniform(-1.0, 1.0, (2, 3)), float(action.sum()), False, False, {}


@for_each_that_takes({}, {"use_sde": True})
def test_matrices_of_float64(make_model, options):
    env = TransitionObservation(MetaTask(gym.wrappers.TimeLimit(MatrixEnv(), 20)))
    model = make_model(env, **options).learn(60)
    action, _ = model.predict(env.reset(seed=0)[0])
    assert env.action_space.contains(action)


# -- saving and loading ----------------------------------------------------------------------------------------------


@pytest.mark.parametrize("with_env", [True, False])
@for_each_that_takes({}, {"ent_coef": 0.01, "use_sde": True, "critic_input": "both"})
def test_a_loaded_model_has_the_same_parameters_actions_and_beliefs(algorithm, make_model, tmp_path, options, with_env):
    env = make_vec_env(make_pendulum, 2)
    model = make_model(env, **options).learn(70)
    model.save(tmp_path / "model")
    loaded = algorithm.load(tmp_path / "model", env=env if with_env else None, device="cpu")
    assert_same(model.get_parameters(), loaded.get_parameters())
    for observation, state, action in rollout(model, env, 10):
        assert_same(
            loaded.predict(observation, state, deterministic=True),
            model.predict(observation, state, deterministic=True),
        )
        assert_same(model.belief(state).mean, loaded.belief(state).mean)
        assert env.action_space.contains(action[0])
    if with_env:
        loaded.learn(50, reset_num_timesteps=False)
        assert loaded.num_timesteps == 120


def test_a_model_keeps_its_encoder_options_when_loaded(algorithm, make_model, tmp_path):
    options = {"encoder_learning_rate": 3e-4, "encoder_batch_size": 5, "encoder_update_ratio": 0.3}
    make_model(critic_input="both", encoder_learning_starts=7, **options).save(tmp_path / "model")
    loaded = algorithm.load(tmp_path / "model", encoder_batch_size=6, custom_objects={"encoder_update_ratio": 0.4})
    assert (loaded.encoder_learning_rate, loaded.encoder_learning_starts) == (3e-4, 7)
    assert (loaded.encoder_batch_size, loaded.encoder_update_ratio) == (6, 0.4)
    assert loaded.policy.critic_input == "both"
    assert loaded.encoder_optimizer.param_groups[0]["lr"] == 3e-4


def test_attributes_are_excluded_and_included_by_name(algorithm, make_model, tmp_path):
    make_model(verbose=2).save(tmp_path / "model", exclude=["verbose"])
    assert algorithm.load(tmp_path / "model").verbose == 0
    make_model(verbose=2).save(tmp_path / "model", exclude=["verbose"], include=["verbose"])
    assert algorithm.load(tmp_path / "model").verbose == 2


def test_policy_and_actor_are_saved_alone(tmp_path, trained):
    observation = make_pendulum().reset(seed=1)[0]
    extended, _ = trained.policy.extend(observation)
    trained.policy.save(tmp_path / "policy")
    trained.actor.save(tmp_path / "actor")
    policy = type(trained.policy).load(tmp_path / "policy", device="cpu")
    actor = type(trained.actor).load(tmp_path / "actor", device="cpu")
    assert_same(policy.state_dict(), trained.policy.state_dict())
    expected, state = trained.predict(observation, deterministic=True)
    assert_same(policy.predict(observation, deterministic=True), (expected, state))
    assert_same(actor.predict(extended.numpy(), deterministic=True)[0], expected)


def test_parameters_move_from_model_to_model(make_model):
    source, target = make_model(seed=1).learn(60), make_model(seed=2)
    target.set_parameters(source.get_parameters())
    assert_same(target.get_parameters(), source.get_parameters())

    parameters = source.get_parameters()
    assert {"policy", "encoder_optimizer", "actor.optimizer"} <= parameters.keys()
    with pytest.raises(ValueError, match="unknown"):
        target.set_parameters({**parameters, "unknown": {}}, exact_match=False)
    del parameters["encoder_optimizer"]
    with pytest.raises(ValueError, match="encoder_optimizer"):
        target.set_parameters(parameters)
    target.set_parameters(parameters, exact_match=False)


def test_a_replay_buffer_comes_back_and_is_learned_from(make_model, tmp_path):
    model = make_model().learn(50)
    model.save_replay_buffer(tmp_path / "buffer")
    other = make_model(seed=1, learning_starts=0)
    other.load_replay_buffer(tmp_path / "buffer")
    for name in RING:
        assert_same(getattr(model.replay_buffer, name), getattr(other.replay_buffer, name))
    assert len(model.replay_buffer.tasks) == len(other.replay_buffer.tasks)
    other.learn(30)
    assert (other.replay_buffer.size(), other._n_updates) == (80, 30)


def test_a_copied_model_learns(make_model):
    model = make_model().learn(50)
    twin = deepcopy(model)
    assert_same(twin.get_parameters(), model.get_parameters())
    twin.learn(20, reset_num_timesteps=False)
    assert (twin._n_updates, model._n_updates) == (30, 10)


def test_a_buffer_of_another_algorithm_is_refused(make_model, tmp_path):
    SAC("MultiInputPolicy", POINT, buffer_size=10).save_replay_buffer(tmp_path / "buffer")
    with pytest.raises(ValueError, match="TaskReplayBuffer"):
        make_model().load_replay_buffer(tmp_path / "buffer")


# -- envs ------------------------------------------------------------------------------------------------------------


def test_envs_are_exchanged_for_their_like_only(make_model):
    model = make_model().learn(50)
    model.set_env(make_vec_env(POINT, 1, env_kwargs={"split": "test"}))
    assert model._last_obs is None
    model.learn(50, reset_num_timesteps=False)
    assert model.num_timesteps == 100
    model.set_env(model.get_env(), force_reset=False)
    assert model._last_obs is not None
    with pytest.raises(ValueError, match="task_space"):
        model.set_env(make_pendulum())
    with pytest.raises(ValueError, match="task_space"):
        model.set_env(gym.make("Pendulum-v1"))
    with pytest.raises(AssertionError):
        model.set_env(make_vec_env(POINT, 2))


def test_a_loaded_model_takes_another_number_of_envs(algorithm, make_model, tmp_path):
    make_model().learn(50).save(tmp_path / "model")
    model = algorithm.load(tmp_path / "model", env=make_vec_env(POINT, 2))
    model.learn(100)
    assert model.replay_buffer.actions.shape[1] == 2


def test_a_loaded_model_goes_on_in_the_middle_of_an_episode(algorithm, make_model, tmp_path):
    model = make_model().learn(50)
    model.save(tmp_path / "model")
    loaded = algorithm.load(tmp_path / "model", env=model.get_env(), force_reset=False)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        loaded.learn(50, reset_num_timesteps=False)
    assert loaded.num_timesteps == 100


def test_a_model_is_not_loaded_on_another_family(algorithm, make_model, tmp_path):
    make_model().save(tmp_path / "model")
    with pytest.raises(ValueError, match="Observation spaces do not match"):
        algorithm.load(tmp_path / "model", env=make_pendulum())


KEYS = [["observation"], ["observation", "reward"], None]  # None: SB3's default, all of them


@pytest.mark.parametrize("keys", KEYS, ids=str)
def test_vec_normalize_is_saved_and_synchronised(algorithm, make_model, tmp_path, keys):
    env, eval_env = normalized(norm_obs_keys=keys), normalized(norm_obs_keys=keys, training=False)
    model = make_model(env)
    assert model.get_vec_normalize_env() is env
    model.learn(80, EvalCallback(eval_env, eval_freq=40, n_eval_episodes=1, verbose=0))
    assert_same(env.obs_rms["observation"].mean, eval_env.obs_rms["observation"].mean)
    model.save(tmp_path / "model")
    env.save(tmp_path / "normalize")
    renewed = VecNormalize.load(tmp_path / "normalize", DummyVecEnv([make_pendulum]))
    algorithm.load(tmp_path / "model", env=renewed).learn(50)
    model.set_env(eval_env)
    assert model.get_vec_normalize_env() is eval_env


@pytest.mark.parametrize("options", [*({"norm_obs_keys": keys} for keys in KEYS), {"norm_obs": False}], ids=str)
def test_a_belief_carried_through_predict_is_that_of_the_transitions(make_model, options):
    env = normalized(**options)
    model = make_model(env, encoder_kwargs={"extra_dims": 0}).learn(60)
    env.training = False
    rows, observation, state, start = [], env.reset(), None, np.ones(1)
    for _ in range(10):
        before = env.get_original_obs()["observation"]
        action, state = model.predict(observation, state, start)
        observation, _, start, _ = env.step(action)
        rows.append((before, action, env.get_original_reward()[:, None], env.get_original_obs()["observation"]))
    _, state = model.predict(observation, state, start)
    transitions = Transitions(*(np.stack(part, axis=1) for part in zip(*rows, strict=True)))
    carried, inferred = model.belief(state), model.infer(transitions)
    np.testing.assert_allclose(carried.mean, inferred.mean, atol=1e-4)
    np.testing.assert_allclose(carried.var, inferred.var, atol=1e-4)
    assert np.abs(carried.mean).max() > 0.01  # it is not the prior


class Watch(BaseCallback):
    """Keeps, of every step, whether it began an episode, what the agent saw, and the state in which it acted."""

    def __init__(self):
        super().__init__()
        self.steps = []

    def _on_step(self):
        model = self.model
        self.steps.append(deepcopy((model._last_episode_starts, model._last_obs, model._next_belief_state)))
        return True


@pytest.mark.parametrize("env_id", [POINT, TRIAL])
def test_beliefs_in_the_buffer_are_those_of_the_rollout_at_every_step(make_model, env_id):
    options = {"replay_buffer_kwargs": {"context": "episode"}, "learning_starts": 1_000}
    watch, model = Watch(), make_model(make_vec_env(env_id, 2, seed=0), **options)
    model.learn(2 * 130, watch)  # every env has finished two trials, and is in the first episode of its third
    layout, encoder = model.policy.layout, model.encoder
    begins, shown, states = zip(*watch.steps, strict=True)
    with th.no_grad():
        beliefs = [encoder.belief(tuple(map(th.as_tensor, state[:-1]))).numpy() for state in states]
    step_of = {seen["observation"][env].tobytes(): (step, env) for step, seen in enumerate(shown) for env in (0, 1)}
    met, inner_ends = set(), 0
    for _ in range(60):
        samples = model.replay_buffer.sample(64)
        for here, there in zip(samples.observations.numpy(), samples.next_observations.numpy(), strict=True):
            step, env = step_of[here[layout.observation].tobytes()]
            met.add((step, env))
            np.testing.assert_allclose(here[layout.belief], beliefs[step][env], rtol=1e-4, atol=1e-5)
            if step == 129 or begins[step + 1][env]:
                continue
            np.testing.assert_allclose(there[layout.belief], beliefs[step + 1][env], rtol=1e-4, atol=1e-5)
            inner_end = bool(shown[step + 1]["episode_start"][env])
            inner_ends += inner_end
            arrived = np.array_equal(there[layout.observation], shown[step + 1]["observation"][env])
            assert arrived != inner_end
    assert len(met) > 200
    assert (inner_ends > 0) == (env_id == TRIAL)


@pytest.mark.parametrize("n_steps", [20, 21, 47])  # an inner episode ends with the last transition, before it, long ago
def test_the_running_trial_is_encoded_again_as_the_agent_would_see_it(make_model, n_steps):
    watch, model = Watch(), make_model(make_vec_env(TRIAL, 2, seed=0), learning_starts=10, encoder_update_ratio=1)
    model.learn(2 * n_steps, watch)
    assert model._n_encoder_updates > 0
    state = None
    for begins, seen, _ in watch.steps:
        _, state = model.policy.extend(seen, state, begins)
    absorbed = n_steps - 1 - (n_steps - 1) // 20
    assert state[0][:, 0].tolist() == [absorbed] * 2
    for carried, expected in zip(model._belief_state, state, strict=True):
        np.testing.assert_allclose(carried, expected, rtol=1e-4, atol=1e-5)


def test_no_transitions_give_the_prior(trained):
    nothing = Transitions(*(np.zeros((2, 0, dim)) for dim in (3, 1, 1, 3)))
    prior = trained.infer(nothing)
    assert prior.mean.shape == (2, 5)  # reward and four noise dimensions
    np.testing.assert_array_equal(prior.mean, 0)
    _, state = trained.predict(make_pendulum().reset(seed=0)[0])
    assert_same(trained.belief(state).var, prior.var[:1])


# -- acting ----------------------------------------------------------------------------------------------------------


def test_predict_takes_one_observation_or_many(trained):
    env = make_pendulum()
    observation = env.reset(seed=0)[0]
    action, _ = trained.predict(observation, deterministic=True)
    assert action.shape == (1,)
    many = {key: np.stack([value] * 4) for key, value in observation.items()}
    actions, states = trained.predict(many, deterministic=True)
    assert actions.shape == (4, 1)
    np.testing.assert_allclose(actions, np.stack([action] * 4), atol=1e-6)
    assert all(len(part) == 4 for part in states)
    with pytest.raises(ValueError, match="mixing Gym API"):
        trained.predict(env.reset())


class DropoutEncoder(BrunoEncoder):
    """Forgets half of what it sees, in training."""

    def latents(self, transitions, noise):
        return th.nn.functional.dropout(super().latents(transitions, noise), training=self.training)


@pytest.mark.parametrize("encoder_class", [BrunoEncoder, DropoutEncoder])
def test_predict_changes_nothing_and_repeats_itself(make_model, encoder_class):
    model = make_model(make_pendulum(), encoder_class=encoder_class).learn(60)
    env = make_vec_env(make_pendulum, 2, seed=0)
    model.policy.set_training_mode(True)  # as ``train`` leaves it
    parameters = deepcopy(model.get_parameters())
    for observation, state, _ in rollout(model, env, 5)[1:]:
        held = deepcopy((observation, state))
        model.policy.set_training_mode(True)
        first = model.predict(observation, state, deterministic=True)
        assert_same(first, model.predict(observation, state, deterministic=True))
        assert_same(held, (observation, state))
    assert_same(parameters, model.get_parameters())


def test_evaluate_policy_equals_a_loop_written_by_hand(trained):
    env = make_vec_env(make_pendulum, 2)
    env.seed(3)
    returns, lengths = evaluate_policy(trained, env, n_eval_episodes=4, return_episode_rewards=True)
    env.seed(3)
    observation, state, start = env.reset(), None, np.ones(2, dtype=bool)
    by_hand, running = [], np.zeros(2)
    for _ in range(50):
        action, state = trained.predict(observation, state, start, deterministic=True)
        observation, reward, start, _ = env.step(action)
        running += reward
        if start.all():
            by_hand.extend(running)
            running = np.zeros(2)
    np.testing.assert_allclose(returns, by_hand, rtol=1e-5)
    assert lengths == [25] * 4
    env.seed(3)
    assert evaluate_policy(trained.policy, env, 4, return_episode_rewards=True)[0] == returns


def test_acting_without_the_state_is_warned_about(trained):
    env = make_pendulum()
    env.reset(seed=0)
    observation, *_ = env.step(env.action_space.sample())
    with pytest.warns(UserWarning, match="pass back the state"):
        trained.predict(observation)


# -- learning --------------------------------------------------------------------------------------------------------


@for_each_that_takes({}, {"train_freq": 3, "use_sde": True, "ent_coef": 0.1})
def test_the_same_seed_gives_the_same_run(make_model, options):
    def run(seed):
        model = make_model(make_vec_env(POINT, 2), seed=seed, **options).learn(70)
        return model.get_parameters()["policy"], rollout(model, model.get_env(), 20, deterministic=False)

    first = run(seed=3)
    assert_same(first, run(seed=3))
    assert not np.array_equal(first[1][-1][2], run(seed=4)[1][-1][2])


def test_learning_in_two_parts_equals_learning_at_once(make_model):
    at_once = make_model().learn(100)
    in_parts = make_model().learn(45).learn(55, reset_num_timesteps=False)  # the cut is inside an episode
    assert in_parts.num_timesteps == 100
    assert_same(at_once.get_parameters(), in_parts.get_parameters())


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


@pytest.mark.parametrize("encoder_learning_starts", [None, 0])
def test_a_callback_stops_at_the_first_step(make_model, encoder_learning_starts):
    model = make_model(encoder_learning_starts=encoder_learning_starts, encoder_update_ratio=1)
    model.learn(50, callback=lambda *_: False)
    assert (model.num_timesteps, model.replay_buffer.size()) == (1, 0)
    model.learn(50)
    assert model.replay_buffer.size() == 50


def test_a_callback_stops_after_two_episodes(make_model):
    assert make_model().learn(1_000, StopTrainingOnMaxEpisodes(2)).num_timesteps == 60


def test_tensorboard_shows_encoder_and_belief(algorithm, make_model, tmp_path):
    model = make_model(tensorboard_log=str(tmp_path)).learn(70, log_interval=1)
    model.learn(70, log_interval=1, reset_num_timesteps=False)
    model.learn(40, tb_log_name="other")
    assert {folder.name for folder in tmp_path.iterdir()} == {f"{algorithm.__name__}_1", "other_1"}
    events = event_accumulator.EventAccumulator(str(tmp_path / f"{algorithm.__name__}_1"))
    events.Reload()
    shown = set(events.Tags()["scalars"])
    assert {"rollout/ep_rew_mean", "train/actor_loss", "train/critic_loss"} <= shown
    assert {"encoder/bound_nats", "encoder/learning_rate", "belief/mean_abs", "belief/var"} <= shown
    assert all(np.isfinite(event.value) for event in events.Scalars("encoder/bound_nats"))
