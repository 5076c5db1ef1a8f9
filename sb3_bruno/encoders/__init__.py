"""Task encoders: from transitions to a belief over the hidden task."""

from sb3_bruno.encoders.abilities import (
    HasPosterior,
    InfersTask,
    MeasuresDistance,
    Moments,
    Outcomes,
    Predicts,
    PredictsMoments,
)
from sb3_bruno.encoders.base import Loss, TaskEncoder, TaskSequences, Transitions
from sb3_bruno.encoders.bruno import BrunoEncoder
from sb3_bruno.encoders.causal_transformer import CausalTransformer
from sb3_bruno.encoders.checker import check_encoder
from sb3_bruno.encoders.mean_embedding import MeanEmbedding
from sb3_bruno.encoders.product_of_gaussians import ProductOfGaussians
from sb3_bruno.encoders.random_features import RandomFeatures
from sb3_bruno.encoders.recurrent import RecurrentEncoder
from sb3_bruno.encoders.recurrent_vae import RecurrentVae
from sb3_bruno.encoders.registry import ENCODERS, find_encoder
from sb3_bruno.encoders.split_aggregator import SplitAggregator
from sb3_bruno.encoders.supervised_belief import SupervisedBelief

__all__ = [
    "ENCODERS",
    "BrunoEncoder",
    "CausalTransformer",
    "HasPosterior",
    "InfersTask",
    "Loss",
    "MeanEmbedding",
    "MeasuresDistance",
    "Moments",
    "Outcomes",
    "Predicts",
    "PredictsMoments",
    "ProductOfGaussians",
    "RandomFeatures",
    "RecurrentEncoder",
    "RecurrentVae",
    "SplitAggregator",
    "SupervisedBelief",
    "TaskEncoder",
    "TaskSequences",
    "Transitions",
    "check_encoder",
    "find_encoder",
]
