"""What cannot be exported is refused before a file is written, with the encoder, the operation and the remedy."""

import gymnasium as gym
import pytest
import torch as th
from stable_baselines3.common.vec_env import DummyVecEnv, VecNormalize

from sb3_bruno.algorithms.sac import TaskSAC
from sb3_bruno.encoders import RandomFeatures
from sb3_bruno.export import export_agent
from support.tiny_models import POINT, TINY


class Branching(RandomFeatures):
    """Looks at numbers."""

    def belief(self, memory):
        return super().belief(memory) if memory.n.sum() > 3 else th.zeros_like(super().belief(memory))


class Untranslated(RandomFeatures):
    """Uses what ONNX lacks."""

    def belief(self, memory):
        belief = super().belief(memory)
        return belief * th.linalg.svdvals(belief.unsqueeze(-1))


class Drawing(RandomFeatures):
    """Draws in every step."""

    def belief(self, memory):
        belief = super().belief(memory)
        return belief + th.rand_like(belief)


class Uniform(RandomFeatures):
    """Has noise that is not normal."""

    def redraw(self, memory):
        return memory._replace(total=th.rand_like(memory.total))


@pytest.mark.parametrize(
    ("encoder", "told"),
    [
        (Branching, "Branching cannot be exported: .*data-dependent"),
        (Untranslated, r"Untranslated cannot be exported: the operation aten.*svd"),
        (Drawing, r"Drawing cannot be exported: it draws random numbers by aten.rand_like"),
        (Uniform, "Uniform cannot be exported: .*standard normal"),
    ],
)
def test_an_encoder_that_no_file_can_hold_is_named(encoder, told, tmp_path):
    model = TaskSAC("MlpPolicy", POINT, encoder_class=encoder, **TINY)
    (tmp_path / "agent.onnx").write_text("the older file")
    with pytest.raises(ValueError, match=told) as error:
        model.export(tmp_path / "agent.onnx")
    assert "\n" not in str(error.value)
    assert (tmp_path / "agent.onnx").read_text() == "the older file"
    assert [path.name for path in tmp_path.iterdir()] == ["agent.onnx"]


@pytest.mark.parametrize("name", ["agent", "agent.zip", "agent.onnx.gz", "agent.ONNX", ""])
def test_another_suffix_is_refused(plain, name, tmp_path):
    with pytest.raises(ValueError, match=r"ends neither in \.onnx nor in \.pt"):
        plain.export(tmp_path / name)


def test_a_path_that_cannot_be_written_is_refused(plain, tmp_path):
    (tmp_path / "folder.pt").mkdir()
    (tmp_path / "file").write_text("")
    for path in ("folder.pt", "file/agent.pt"):
        with pytest.raises(ValueError, match="cannot be written"):
            plain.export(tmp_path / path)


def test_an_agent_that_diverged_is_refused(tmp_path):
    model = TaskSAC("MlpPolicy", POINT, encoder_class="random_features", **TINY)
    with th.no_grad():
        next(model.actor.parameters()).fill_(th.nan)
    with pytest.raises(ValueError, match=r"weights .* are not finite"):
        model.export(tmp_path / "agent.pt")


def test_another_model_is_refused(tmp_path):
    with pytest.raises(ValueError, match="`model` is a str"):
        export_agent("agent", tmp_path / "agent.onnx")


def test_a_library_that_is_missing_is_named(plain, tmp_path, monkeypatch):
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    with pytest.raises(ImportError, match=r"onnx is not installed: pip install 'sb3_bruno\[export\]'"):
        plain.export(tmp_path / "agent.onnx")


@pytest.mark.parametrize("given", ["statistics.pkl", DummyVecEnv([lambda: gym.make(POINT)]), "other"])
def test_what_is_no_normalisation_of_the_agent_is_refused(given, tmp_path):
    other = VecNormalize(DummyVecEnv([lambda: gym.make("sb3_bruno_envs:PointGoal-v0")]))
    model = TaskSAC("MlpPolicy", POINT, encoder_class="random_features", **TINY)
    with pytest.raises(ValueError, match="`vec_normalize"):
        model.export(tmp_path / "agent.onnx", vec_normalize=other if given == "other" else given)
