"""Encoders by name, so that a configuration file can choose one."""

from __future__ import annotations

from sb3_bruno.encoders.base import TaskEncoder
from sb3_bruno.encoders.bruno import BrunoEncoder
from sb3_bruno.encoders.causal_transformer import CausalTransformer
from sb3_bruno.encoders.mean_embedding import MeanEmbedding
from sb3_bruno.encoders.product_of_gaussians import ProductOfGaussians
from sb3_bruno.encoders.random_features import RandomFeatures
from sb3_bruno.encoders.recurrent import RecurrentEncoder
from sb3_bruno.encoders.recurrent_vae import RecurrentVae
from sb3_bruno.encoders.split_aggregator import SplitAggregator
from sb3_bruno.encoders.supervised_belief import SupervisedBelief

ENCODERS: dict[str, type[TaskEncoder]] = {
    "bruno": BrunoEncoder,
    "causal_transformer": CausalTransformer,
    "mean_embedding": MeanEmbedding,
    "product_of_gaussians": ProductOfGaussians,
    "random_features": RandomFeatures,
    "recurrent": RecurrentEncoder,
    "recurrent_vae": RecurrentVae,
    "split_aggregator": SplitAggregator,
    "supervised_belief": SupervisedBelief,
}
"""What ``encoder_class`` may name. An encoder of your own can be added."""


def find_encoder(encoder_class: str | type[TaskEncoder]) -> type[TaskEncoder]:
    """Find the class of an encoder, given itself or its name.

    Raises:
        ValueError: if the name is unknown, or the class is no ``TaskEncoder``.
    """
    if isinstance(encoder_class, str):
        if encoder_class not in ENCODERS:
            raise ValueError(
                f"`encoder_class={encoder_class!r}` is unknown: use one of {sorted(ENCODERS)}, or a class of your own."
            )
        return ENCODERS[encoder_class]
    if not (isinstance(encoder_class, type) and issubclass(encoder_class, TaskEncoder)):
        raise ValueError(
            f"`encoder_class={encoder_class!r}` is no `TaskEncoder`: subclass it, or use a name of {sorted(ENCODERS)}."
        )
    return encoder_class
