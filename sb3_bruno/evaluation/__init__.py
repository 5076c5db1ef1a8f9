"""How well a model does on given tasks: episodes, rewards, learning curves. Knows no algorithm."""

from sb3_bruno.evaluation.adaptation import evaluate_adaptation
from sb3_bruno.evaluation.adaptation_result import AdaptationResult
from sb3_bruno.evaluation.eval_callback import LearningCurve, TaskEvalCallback, load_learning_curve
from sb3_bruno.evaluation.versions import library_versions

__all__ = [
    "AdaptationResult",
    "LearningCurve",
    "TaskEvalCallback",
    "evaluate_adaptation",
    "library_versions",
    "load_learning_curve",
]
