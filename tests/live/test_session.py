"""A session acts as the agent does anywhere, and does at once what it is told, without a browser."""

import gymnasium as gym
import numpy as np
import pytest
import torch as th
from stable_baselines3 import SAC
from stable_baselines3.common.vec_env import DummyVecEnv, VecNormalize

from sb3_bruno import BrunoSAC, RecurrentSAC
from sb3_bruno.encoders import Transitions
from sb3_bruno.live.session import NATS, Session
from sb3_bruno_envs import MetaTask, PointDirEnv, TransitionObservation
from support.tiny_models import POINT, TRIAL, normalized, tiny

RIGHT, LEFT = [1.0, 0.0], [-1.0, 0.0]


@pytest.fixture(scope="module")
def model():
    return BrunoSAC("MlpPolicy", POINT, **tiny(BrunoSAC))


def opened(model, env_id=POINT, **kwargs):
    return Session(model, gym.make(env_id), **kwargs)


def steps(session, n):
    return [session.step() for _ in range(n)]


def test_it_acts_as_the_agent_does_anywhere(model):
    session = opened(model, seed=3)
    session.forget_threshold = None
    env = gym.make(POINT)
    seen, _ = env.reset(seed=3)
    state, rewards = None, []
    for _ in range(30):
        action, state = model.predict(seen, state, deterministic=True)
        seen, reward, *_ = env.step(action)
        rewards.append(reward)
    moments = steps(session, 30)
    np.testing.assert_array_equal([moment.reward for moment in moments], rewards)
    assert [moment.step for moment in moments] == list(range(1, 31))
    assert moments[-1].episode_return == pytest.approx(sum(rewards))


def test_the_next_episode_has_the_same_task_and_begins_from_the_prior(model):
    session = opened(model)
    session.set_task(LEFT)
    last = steps(session, 30)[-1]
    first = session.step()
    assert (last.step, first.step, session.n_episodes) == (30, 1, 2)
    assert first.task.tolist() == LEFT and first.task_name == "left"
    assert first.surprise is None and first.episode_return == first.reward


def test_an_episode_begins_with_the_prior_before_its_first_step(model):
    session = opened(model)
    prior = session.estimate
    steps(session, 5)
    assert session.estimate is not prior is not None
    session.reset()
    assert session.estimate is prior


def test_the_task_changes_at_the_next_step_and_nothing_else_does(model):
    session = opened(model)
    session.set_task(RIGHT)
    before = steps(session, 5)[-1]
    place = session.env.unwrapped.position()
    session.set_task(LEFT)
    assert (session.task.tolist(), session.task_name) == (LEFT, "left")
    np.testing.assert_array_equal(session.env.unwrapped.position(), place)
    after = session.step()
    velocity = (session.env.unwrapped.position() - place) / 0.1
    assert after.step == before.step + 1 and after.task_name == "left"
    assert after.reward == pytest.approx(-velocity[0] - 0.05 * velocity @ velocity, rel=1e-4)


def test_a_reset_begins_an_episode_of_the_same_task(model):
    session = opened(model)
    session.set_task(LEFT)
    steps(session, 7)
    session.reset()
    assert session.n_episodes == 2 and session.task.tolist() == LEFT
    assert session.step().step == 1


@pytest.mark.parametrize("task", [[3.0, 0.0], [1.0], "left", [np.nan, 0.0]])
def test_a_task_that_is_refused_changes_nothing(model, task):
    session = opened(model)
    session.set_task(LEFT)
    steps(session, 3)
    with pytest.raises(ValueError, match="task"):
        session.set_task(task)
    assert session.task.tolist() == LEFT
    assert session.step().step == 4


def test_a_drawn_task_is_a_test_task(model):
    session = opened(model)
    found = set()
    for _ in range(10):
        session.draw_task()
        found.add(tuple(session.task))
    assert found == {tuple(RIGHT), tuple(LEFT)}


def test_the_surprise_is_the_log_bayes_factor_and_adds_up_to_the_evidence(model):
    """Of transitions that are known, against an encoder that is asked for each of them."""
    session = opened(model, seed=1)
    session.forget_threshold = 1e9
    places, moments, actions = [], [], []
    for _ in range(12):
        places.append(session.env.unwrapped.position())
        moments.append(session.step())
        actions.append((session.env.unwrapped.position() - places[-1]) / 0.1)
    encoder, memory, evidence = model.policy.encoder, model.policy.encoder.empty((1,)), 0.0
    assert moments[0].surprise is None and moments[0].evidence == 0.0
    with th.no_grad():
        for here, action, moment, there, after in zip(places, actions, moments, places[1:], moments[1:], strict=False):
            parts = (here, action, [moment.reward], there)
            transition = Transitions(*(th.as_tensor(np.array(part)[None], dtype=th.float32) for part in parts))
            expected = encoder.log_bayes_factor(memory, transition).item()
            memory = encoder.absorb(memory, transition)
            evidence = max(evidence + expected, 0.0)
            assert after.surprise == pytest.approx(expected, abs=2e-3)
            assert after.evidence == pytest.approx(evidence, abs=1e-2)


def test_it_forgets_unless_it_is_told_not_to(model):
    model.policy.forget_threshold = None
    session = opened(model)
    assert session.can_forget and session.forget_threshold == NATS
    session.forget_threshold = None
    assert steps(session, 2)[-1].evidence is None
    session.forget_threshold = 3.0
    assert model.policy.forget_threshold == 3.0 and session.step().evidence is not None
    with pytest.raises(ValueError, match="positive"):
        session.forget_threshold = -1.0
    assert opened(model).forget_threshold == 3.0  # its own is kept


def test_an_agent_that_cannot_notice_a_switch_acts_all_the_same():
    session = opened(RecurrentSAC("MlpPolicy", POINT, **tiny(RecurrentSAC)))
    moment = steps(session, 3)[-1]
    assert not session.can_forget and (moment.surprise, moment.evidence) == (None, None)


def test_actions_may_be_drawn_and_the_seed_draws_the_same_ones(model):
    def rewards(deterministic):
        session = opened(model, seed=5)
        session.deterministic = deterministic
        return [moment.reward for moment in steps(session, 5)]

    assert rewards(False) == rewards(False) != rewards(True)


def test_sb3s_own_agents_act_and_say_that_they_believe_nothing():
    env = gym.make(POINT, observe="task")
    session = Session(SAC("MlpPolicy", env, learning_starts=10, buffer_size=100), env)
    session.set_task(LEFT)
    assert steps(session, 3)[-1].task_name == "left"
    assert session.no_readout == "SAC does not infer its task, so there is no read-out." and not session.can_forget
    with pytest.raises(ValueError, match="infers"):
        session.forget_threshold = 3.0


def test_observations_are_normalised_as_in_training():
    def make():
        return TransitionObservation(MetaTask(PointDirEnv(), PointDirEnv.set_task, [RIGHT, LEFT]))

    venv = VecNormalize(DummyVecEnv([make]), norm_obs_keys=["observation", "reward"])
    model = BrunoSAC("MlpPolicy", venv, **tiny(BrunoSAC))
    venv.obs_rms["observation"].mean += 1.0
    venv.training = False
    session = Session(model, make(), vec_normalize=venv, seed=2)
    plain = Session(model, make(), seed=2)
    seen, _ = make().reset(seed=2)
    action, _ = model.predict(venv.normalize_obs(seen), deterministic=True)
    session.step()
    np.testing.assert_allclose(session.env.unwrapped.trail[1] - session.env.unwrapped.trail[0], 0.1 * action, rtol=1e-5)
    plain.step()
    assert not np.allclose(plain.env.unwrapped.trail[1], session.env.unwrapped.trail[1])
    assert session.step().surprise is not None


def test_a_trial_goes_on_over_its_inner_episodes(model):
    session = Session(BrunoSAC("MlpPolicy", TRIAL, **tiny(BrunoSAC)), gym.make(TRIAL))
    moments = steps(session, 61)
    assert [moment.step for moment in moments] == [*range(1, 61), 1]
    missing = [moment.step for moment in moments if moment.surprise is None]
    assert missing == [1, 21, 41, 1]  # no transition led to where an inner episode begins


class AtReset(PointDirEnv):
    """Its task counts from a reset on, as Meta-World's."""

    sets_task_at_reset = True


def test_an_env_that_takes_its_task_at_a_reset_begins_an_episode(model):
    env = TransitionObservation(MetaTask(AtReset(), AtReset.set_task, [RIGHT, LEFT]))
    session = Session(model, env)
    prior = session.estimate
    steps(session, 4)
    session.set_task(LEFT)
    assert session.estimate is prior
    assert session.n_episodes == 2 and session.step()[:1] == (1,) and session.task.tolist() == LEFT


def test_an_env_without_tasks_has_none_to_set():
    env = TransitionObservation(gym.make("Pendulum-v1"))
    session = Session(BrunoSAC("MlpPolicy", normalized(), **tiny(BrunoSAC)), env)
    moment = session.step()
    assert (moment.task, moment.task_name) == (None, "")
    with pytest.raises(ValueError, match="no hidden task"):
        session.set_task([0.0])
    with pytest.raises(ValueError, match="no task_distribution"):
        session.draw_task()


class Slow(PointDirEnv):
    """Says how long a step lasts, as Gymnasium's MuJoCo environments do."""

    dt = 0.25


class NoRate(PointDirEnv):
    """Tells no rate, and paints nothing."""

    metadata = {"render_modes": []}  # noqa: RUF012  # as Gymnasium has it


@pytest.mark.parametrize(("env_class", "seconds"), [(PointDirEnv, 0.1), (Slow, 0.25), (NoRate, 1 / 30)])
def test_a_step_lasts_as_long_as_the_env_says(model, env_class, seconds):
    session = Session(model, TransitionObservation(MetaTask(env_class(), env_class.set_task, [RIGHT, LEFT])))
    assert session.seconds_per_step == pytest.approx(seconds)
    session.speed = 0.5
    assert session.seconds_per_step == pytest.approx(2 * seconds)
    for speed in (0.0, -1.0, np.inf, np.nan):
        with pytest.raises(ValueError, match="speed"):
            session.speed = speed
    assert session.speed == 0.5
