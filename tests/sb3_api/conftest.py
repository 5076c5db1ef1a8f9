"""The algorithm at hand, and how to make a tiny model of it."""

import pytest

from support.tiny_models import EACH_KIND, POINT, make_pendulum, tiny


@pytest.fixture(scope="module", params=EACH_KIND, ids=lambda algorithm: algorithm.__name__)
def algorithm(request):
    return request.param


@pytest.fixture(scope="module")
def make_model(algorithm):
    def make(env=POINT, policy="MlpPolicy", **kwargs):
        """A tiny model, with arguments as ``tiny`` merges them."""
        return algorithm(policy, env, **tiny(algorithm, **kwargs))

    return make


@pytest.fixture(scope="module")
def trained(make_model):
    """A model after 60 steps of Pendulum, 20 of them with updates: not to be changed."""
    return make_model(make_pendulum()).learn(60)
