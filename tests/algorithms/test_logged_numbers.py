"""What an update logs are plain numbers, for whoever reads, records or keeps them."""

import numbers

import pytest
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.logger import KVWriter, Logger

from sb3_bruno import BrunoSAC, RecurrentSAC
from support.tiny_models import make_point, tiny

ALGORITHMS = pytest.mark.parametrize("algorithm", [BrunoSAC, RecurrentSAC])


class Reader(KVWriter):
    """A user's output, which meets the values as they were recorded."""

    def __init__(self):
        self.found = {}

    def write(self, key_values, key_excluded, step=0):
        self.found |= key_values

    def close(self):
        pass


class Keeping(Logger):
    """Clears nothing."""

    def dump(self, step=0):
        for output in self.output_formats:
            output.write(self.name_to_value, self.name_to_excluded, step)


class Meddling(BaseCallback):
    """Records under our names, and reads what is there."""

    def __init__(self):
        super().__init__()
        self.found = {}

    def _on_step(self):
        self.found |= self.logger.name_to_value
        for name in ("encoder/n_updates", "encoder/learning_rate", "belief/mean_abs", "encoder/total"):
            self.logger.record_mean(name, 1.0)
            self.logger.record_mean(name, 2.0)
        if self.n_calls % 3 == 0:
            self.logger.dump(self.num_timesteps)
        return True


@ALGORITHMS
@pytest.mark.parametrize("kind", [Logger, Keeping])
def test_writers_and_callbacks_meet_numbers_whatever_they_do_with_our_names(algorithm, kind):
    reader, meddling = Reader(), Meddling()
    model = algorithm("MlpPolicy", make_point(), **tiny(algorithm))
    model.set_logger(kind(None, [reader]))
    model.learn(60, meddling, log_interval=1)
    for found in (reader.found, meddling.found):
        assert "belief/mean_abs" in found and any(name.startswith("encoder/") for name in found)
        assert all(isinstance(value, numbers.Real) for value in found.values())
    assert model.logger.output_formats == [reader], "no output of ours is among theirs"
