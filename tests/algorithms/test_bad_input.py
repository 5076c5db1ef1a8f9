"""What an agent cannot act on or infer from is refused by name, and nothing that it holds changes."""

import re

import gymnasium as gym
import numpy as np
import pytest
import torch as th
from stable_baselines3.common.env_util import make_vec_env

from sb3_bruno import BrunoSAC, BrunoTQC, RecurrentCrossQ, RecurrentSAC, Transitions, VaribadSAC
from support.tiny_models import POINT, TRIAL, tiny

N_ENVS = 2


def make(algorithm=BrunoSAC, env=POINT, **kwargs):
    return algorithm("MlpPolicy", make_vec_env(env, N_ENVS, seed=0), **tiny(algorithm, **kwargs))


@pytest.fixture(scope="module")
def model():
    return make().learn(60)


@pytest.fixture
def seen(model):
    return make_vec_env(POINT, N_ENVS, seed=0).reset()


class Faulty(gym.Wrapper):
    """Makes one number of one step bad."""

    def __init__(self, env, at, kind, number):
        super().__init__(env)
        self.at, self.kind, self.number, self.n_steps = at, kind, number, 0

    def step(self, action):
        observation, reward, terminated, truncated, info = self.env.step(action)
        self.n_steps += 1
        if self.n_steps == self.at:
            if self.kind == "reward":
                reward = self.number
                observation["reward"][:] = self.number
            elif self.kind == "task":
                info = {**info, "task": np.full_like(info["task"], self.number)}
            else:
                observation["observation"][0] = self.number
        return observation, reward, terminated, truncated, info


@pytest.mark.filterwarnings("ignore:The tasks of")  # which come to the fault, too, before training does
@pytest.mark.parametrize("algorithm", [BrunoTQC, RecurrentCrossQ, VaribadSAC])
@pytest.mark.parametrize(("kind", "number"), [("reward", np.nan), ("observation", np.inf), ("task", np.nan)])
def test_a_bad_number_ends_training_before_it_gets_anywhere(algorithm, kind, number):
    env = make_vec_env(lambda: Faulty(gym.make(POINT), 55, kind, number), N_ENVS, seed=0)
    model = algorithm("MlpPolicy", env, **tiny(algorithm, learning_starts=90))
    with pytest.raises(ValueError, match=rf"`(next )?{kind}` is {number} in env 0.*, at step \d+ of its episode"):
        model.learn(300)
    assert model.num_timesteps == 55 * N_ENVS
    assert all(th.isfinite(tensor).all() for tensor in model.policy.state_dict().values())
    assert np.isfinite(model.replay_buffer.rewards).all() and np.isfinite(model.replay_buffer.observations).all()
    assert all(np.isfinite(array).all() for array in model._carried.pack())


@pytest.mark.parametrize("key", ["observation", "action", "reward", "episode_start"])
@pytest.mark.parametrize("number", [np.nan, np.inf, 1e30])
def test_predict_names_the_key_and_the_env_of_a_bad_number(model, seen, key, number):
    seen[key][1, 0] = number
    with pytest.raises(ValueError, match=rf"`{key}` is {re.escape(f'{number:g}')} in env 1, entry \[0\]"):
        model.predict(seen)


@pytest.mark.parametrize("key", ["observation", "action", "reward", "episode_start"])
def test_predict_names_a_key_that_is_missing_or_of_another_shape(model, seen, key):
    part = {name: array for name, array in seen.items() if name != key}
    with pytest.raises(ValueError, match=rf"The observation has no key '{key}'"):
        model.predict(part)
    with pytest.raises(ValueError, match=r"shape"):
        model.predict({**seen, key: seen[key][:, None]})
    if key != "observation":  # whose first dimension is taken for that of all
        with pytest.raises(ValueError, match=rf"The observation's '{key}' has shape \(1, \d\), expected \(2, \d\)"):
            model.predict({**seen, key: seen[key][:1]})


def test_an_episode_start_of_other_envs_is_refused(model, seen):
    with pytest.raises(ValueError, match=r"`episode_start` is of 3 envs, the observation of 2"):
        model.predict(seen, episode_start=np.ones(3, dtype=bool))


@pytest.mark.parametrize("start", ["False", {}, [np.nan, 0], [7, 0], [None, None]], ids=str)
def test_an_episode_start_that_says_neither_yes_nor_no_is_refused(model, seen, start):
    _, state = model.predict(seen)
    with pytest.raises(ValueError, match=r"`episode_start=.*says neither yes nor no: give True where the task is new"):
        model.predict(seen, state, start)


@pytest.mark.filterwarnings("ignore:`predict` was called with a `state`")
def test_the_observations_own_flag_is_understood(model, seen):
    _, state = model.predict(seen)
    step = {**seen, "episode_start": np.zeros((N_ENVS, 1), np.float32)}
    _, state = model.predict(step, state)
    for same_task in (np.full((N_ENVS, 1), 0.5, np.float32), np.zeros(N_ENVS, dtype=bool)):
        kept = model.predict({**step, "episode_start": np.full((N_ENVS, 1), 0.5, np.float32)}, state, same_task)[1]
        np.testing.assert_array_equal(kept[0], state[0])
    fresh = model.predict(seen, state, seen["episode_start"])[1]
    np.testing.assert_array_equal(fresh[0], model.predict(seen)[1][0])


BAD_STATES = {
    "None": lambda state: None,
    "empty": lambda state: (),
    "a number": lambda state: (1.0,),
    "one entry": lambda state: state[:1],
    "another batch": lambda state: tuple(array[:1] for array in state),
    "a batch of its own": lambda state: (*state[:-1], state[-1][:1]),
    "words": lambda state: tuple(np.full(array.shape, "a") for array in state),
    "the pair that predict returned": lambda state: (state[-1], state),
    "NaN": lambda state: (*state[:-1], np.full_like(state[-1], np.nan)),
    "negative counts": lambda state: (-np.abs(state[0]), *state[1:]),
}


@pytest.mark.parametrize("spoil", BAD_STATES.values(), ids=BAD_STATES)
def test_a_state_that_predict_cannot_have_returned_is_refused(model, seen, spoil):
    _, state = model.predict(seen)
    for _ in range(2):
        _, state = model.predict({**seen, "episode_start": np.zeros((N_ENVS, 1), np.float32)}, state)
    bad = spoil(state)
    if bad is not None:  # None is the prior
        with pytest.raises(ValueError, match=r"`state`"):
            model.predict(seen, bad)
    if spoil is not BAD_STATES["another batch"]:  # which is a belief, too
        with pytest.raises(ValueError, match=r"`state`"):
            model.belief(bad)


def test_a_state_kept_over_the_end_of_an_episode_is_warned_of(model):
    env = make_vec_env(POINT, N_ENVS, seed=0)  # episodes of 30 steps
    observation, state = env.reset(), None
    for _ in range(30):
        action, state = model.predict(observation, state)
        observation, *_ = env.step(action)
    with pytest.warns(UserWarning, match=r"`state` from before the env's reset.*pass `episode_start=True`"):
        model.predict(observation, state)


def test_a_state_kept_within_a_trial_is_not_warned_of(recwarn):
    model, env = make(env=TRIAL), make_vec_env(TRIAL, N_ENVS, seed=0)  # trials of three episodes of 20 steps
    observation, state = env.reset(), None
    for _ in range(60):
        action, state = model.predict(observation, state)
        observation, *_ = env.step(action)
    assert not recwarn


RIGHT = Transitions(np.zeros((5, 2)), np.zeros((5, 2)), np.zeros((5, 1)), np.zeros((5, 2)))


@pytest.mark.parametrize("name", Transitions._fields)
def test_infer_names_the_array_that_does_not_fit(model, name):
    right = getattr(RIGHT, name)
    for wrong in (right.T, right.ravel(), right[:4], right[:, :1].repeat(3, axis=1), right[None], 0.0):
        with pytest.raises(ValueError, match=rf"`{name}` has shape .*, expected \("):
            model.infer(RIGHT._replace(**{name: wrong}))


@pytest.mark.parametrize("name", Transitions._fields)
def test_infer_names_a_bad_number(model, name):
    bad = getattr(RIGHT, name).copy()
    bad[3, 0] = np.nan
    with pytest.raises(ValueError, match=rf"`{name}` is nan at index \[3, 0\]"):
        model.infer(RIGHT._replace(**{name: bad}))


@pytest.mark.parametrize("bad", [[["a"]] * 5, [[1.0], [1.0, 2.0]], th.zeros(5, 1, requires_grad=True)], ids=str)
def test_infer_names_what_is_no_array_of_numbers(model, bad):
    with pytest.raises(ValueError, match="`rewards` is no array of numbers"):
        model.infer(RIGHT._replace(rewards=bad))


@pytest.mark.parametrize("bad", [None, RIGHT[:3], RIGHT._asdict()], ids=["None", "three", "a dict"])
def test_infer_wants_transitions(model, bad):
    with pytest.raises(ValueError, match=r"`transitions` is no `Transitions\(observations, actions"):
        model.infer(bad)


def test_what_is_no_observation_of_numbers_is_refused(model, seen):
    for bad in (np.full((N_ENVS, 2), "a"), np.full((N_ENVS, 2), None), np.full((N_ENVS, 2), 1j)):
        with pytest.raises(ValueError, match=r"The observation's 'observation' is of type .*, no array of numbers"):
            model.predict({**seen, "observation": bad})
    extended = np.zeros((N_ENVS, model.policy.layout.dim), np.float32)
    extended[1, 3] = np.nan
    with pytest.raises(ValueError, match=r"`observation` is nan in env 1, entry \[3\]"):
        model.predict(extended)


def test_infer_wants_sequences(model):
    with pytest.raises(ValueError, match=r"`rewards` has shape \(1,\): give sequences"):
        model.infer(Transitions(*(column[0] for column in RIGHT)))


def test_outcomes_and_probabilities_name_what_does_not_fit(model):
    belief = model.infer(RIGHT)
    for observations, actions, named in (
        (np.zeros(3), np.zeros(2), "observations"),
        (np.zeros(2), np.zeros((4, 2)), "actions"),
        (np.zeros(2), [0.0, np.nan], "actions"),
    ):
        with pytest.raises(ValueError, match=rf"`{named}`"):
            model.predict_outcomes(belief, observations, actions)
    for arguments in ({"tasks": [[np.nan, 0.0]]}, {"tasks": [[0.0, 0.0]], "log_prior": [np.nan]}):
        with pytest.raises(ValueError, match=rf"`{list(arguments)[-1]}` is .*nan"):
            model.task_probabilities(belief, **arguments)
    tasks = np.eye(2)
    for log_prior in ([-np.inf, -np.inf], [np.inf, 0.0], ["a", "b"], [None, 0.0]):
        with pytest.raises(ValueError, match="`log_prior` is "):
            model.task_probabilities(belief, tasks, log_prior)
    assert model.task_probabilities(belief, tasks, [-np.inf, 0.0]).tolist() == [0.0, 1.0]
    for n_samples in (0, -1, 1.5, "many"):
        with pytest.raises((TypeError, ValueError), match=f"`n_samples={n_samples!r}` is "):
            model.predict_outcomes(belief, np.zeros(2), np.zeros(2), n_samples=n_samples)
    for ask in (model.predict_outcomes, model.task_probabilities):
        with pytest.raises(TypeError, match="`belief=None` is no belief: give what `infer` or `belief` returned"):
            ask(None, np.zeros(2), np.zeros(2))


@pytest.mark.parametrize(
    "wrong",
    [
        {"learning_rate": np.nan},
        {"learning_rate": -1.0},
        {"learning_rate": np.inf},
        {"gamma": np.nan},
        {"gamma": 1.5},
        {"tau": np.nan},
        {"ent_coef": np.nan},
        {"target_entropy": np.nan},
        {"encoder_learning_rate": np.nan},
        {"encoder_learning_rate": -1e-3},
        {"encoder_update_ratio": np.nan},
        {"encoder_tau": np.nan},
        {"encoder_kwargs": {"flow_kwargs": {"scale": np.nan}}},
        {"policy_kwargs": {"log_std_init": np.nan}},
    ],
    ids=str,
)
def test_a_hyperparameter_that_makes_no_sense_is_named_at_construction(wrong):
    name, value = next(iter(wrong.items()))
    while isinstance(value, dict):
        name, value = next(iter(value.items()))
    with pytest.raises(ValueError, match=rf"`?{name}.*{value}"):
        make(**wrong)


def test_a_recurrent_agent_refuses_bad_states_too():
    model, seen = make(RecurrentSAC), make_vec_env(POINT, N_ENVS, seed=0).reset()
    _, state = model.predict(seen)
    for name, spoil in BAD_STATES.items():
        if name not in ("None", "negative counts"):
            with pytest.raises(ValueError, match=r"`state`"):
                model.predict(seen, spoil(state))


@pytest.mark.parametrize(
    ("algorithm", "told"),
    [
        (VaribadSAC, "The encoder's .*`encoder_learning_rate`, or load"),
        (RecurrentSAC, "The encoder's .*`encoder_learning_rate`, or `learning_rate` of the critic that teaches it"),
    ],
)
def test_an_encoder_that_diverged_is_told_as_that(algorithm, told):
    model = make(algorithm)
    with th.no_grad():
        next(model.encoder.parameters()).fill_(th.nan)
    obs = model.get_env().reset()
    _, state = model.predict(obs)  # a prior may hold none of the parameters
    obs, *_ = model.get_env().step(np.zeros((N_ENVS, 2), dtype=np.float32))
    with pytest.raises(ValueError, match=f"{told}.*an agent from before"):
        model.predict(obs, state)
