"""Training runs of a second, as arguments of the command line."""

TINY = [
    "policy_kwargs:dict(net_arch=[8])",
    "learning_starts:96",
    "buffer_size:2000",
    "batch_size:32",
    "gradient_steps:1",
]
TINY_ENCODER = ["encoder_learning_starts:48", "encoder_batch_size:2", "encoder_update_ratio:0.1"]


def tiny(*arguments, algo="bruno_sac", env="PointDir-v0", steps=480):
    """Arguments of a training run of a second."""
    parameters = TINY + (TINY_ENCODER if algo.startswith("bruno") else [])
    flags = ["--algo", algo, "--env", env, "-n", steps, "--seed", 1, "--eval-freq", 240, "--eval-episodes", 2]
    return ["train", *flags, *arguments, "-params", *parameters]
