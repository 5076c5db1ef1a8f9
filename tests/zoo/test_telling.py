"""An agent that tells counts the transitions that it has absorbed."""

import re

import numpy as np
import pytest
from stable_baselines3 import SAC
from stable_baselines3.common.env_util import make_vec_env

from sb3_bruno import BrunoSAC
from sb3_bruno.zoo.telling import telling
from support.tiny_models import POINT, TRIAL, tiny

EPISODE = {POINT: 30, TRIAL: 20}


@pytest.mark.parametrize("env_id", [POINT, TRIAL])
def test_it_counts_what_it_has_absorbed(env_id, capsys):
    model = telling(BrunoSAC)("MlpPolicy", env_id, **tiny(BrunoSAC))
    env = make_vec_env(env_id, 1, seed=0)
    observation, state, start = env.reset(), None, np.ones(1, bool)
    for _ in range(2 * EPISODE[env_id] + 1):
        action, state = model.predict(observation, state, start, deterministic=True)
        observation, _, start, _ = env.step(action)
    counted = [int(number) for number in re.findall(r"after (\d+) transitions:", capsys.readouterr().out)]
    inner = [0, 1, 2, 5, 10, 20]  # the second episode of a trial goes on with the first; without one it starts anew
    assert counted == (inner + inner + [0] if env_id == POINT else inner)


def test_an_agent_that_infers_nothing_is_left_as_it_is():
    assert telling(SAC) is SAC
