"""Random features: a control that nothing trains."""

import pytest
import torch as th

from sb3_bruno import TaskSAC
from sb3_bruno.encoders import RandomFeatures
from support.small_encoder import transitions_of
from support.tiny_models import POINT, TINY


def test_the_belief_is_the_mean_of_the_features_and_how_many_they_are():
    encoder, transitions = RandomFeatures(3, 2, n_features=8).double(), transitions_of(6)
    features = encoder.features(th.cat(transitions, dim=-1))
    belief = encoder.belief(encoder.prefixes(transitions))
    th.testing.assert_close(belief[-1], th.cat([features.mean(dim=0), th.tensor([7.0]).log().double()]))
    assert not belief[0].any()


@pytest.mark.parametrize("critic_input", ["belief", "task"])
def test_an_agent_learns_on_them_and_leaves_them_as_they_are(critic_input):
    settings = {**TINY, "critic_input": critic_input, "encoder_tau": 0.1}
    model = TaskSAC("MlpPolicy", POINT, encoder_class="random_features", **settings)
    model.replay_buffer.sample_sequences = None  # which nobody asks for what nobody learns from
    before = [parameter.clone() for parameter in model.encoder.parameters()]
    model.learn(60)
    assert (model._n_updates, model._n_encoder_updates) == (20, 0)
    for parameter, old in zip(model.encoder.parameters(), before, strict=True):
        assert th.equal(parameter, old)
