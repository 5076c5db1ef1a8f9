"""The controller: what it needs, what it tells, and what it refuses."""

import json
import pickle
import subprocess
import sys

import numpy as np
import onnx
import pytest

from sb3_bruno.export import Controller

FORBIDDEN = ["torch", "stable_baselines3", "sb3_contrib", "gymnasium", "zuko", "onnx", "onnxscript", "sb3_bruno_envs"]
ALONE = f"""
import sys

class Blocked:
    def find_spec(self, name, path=None, target=None):
        if name.split(".")[0] in {FORBIDDEN}:
            raise ImportError(f"{{name}} is not installed")

sys.meta_path.insert(0, Blocked())
from sb3_bruno.export import Controller

controller = Controller(sys.argv[1])
for _ in range(3):
    action = controller.act([0.1, 0.2], 1.0)
print(action.tolist())
print(controller.task_estimate())
assert not {{name.split(".")[0] for name in sys.modules}} & set({FORBIDDEN})
"""
TORCH_ALONE = """
import sys

class Blocked:
    def find_spec(self, name, path=None, target=None):
        if name.split(".")[0] in ("sb3_bruno", "stable_baselines3", "zuko", "gymnasium"):
            raise ImportError(f"{name} is not installed")

sys.meta_path.insert(0, Blocked())
import json
import torch

about = {"sb3_bruno": ""}
step = torch.jit.load(sys.argv[1], _extra_files=about)
about = json.loads(about["sb3_bruno"])
inputs = {name: torch.zeros(shape) for name, shape in about["inputs"].items()}
inputs["observation"] = torch.tensor([[0.1, 0.2]])
for t in range(3):
    inputs["episode_start"], inputs["reward"] = torch.full((1, 1), float(t == 0)), torch.ones(1, 1)
    outputs = dict(zip(about["outputs"], step(*inputs.values())))
    inputs |= {"action": outputs["next_action"], "memory": outputs["next_memory"]}
print(outputs["next_action"][0].tolist())
"""


def in_a_process(script, path):
    done = subprocess.run([sys.executable, "-c", script, str(path)], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return done.stdout.splitlines()


@pytest.fixture
def controller(exported):
    return Controller(exported / "agent.onnx")


def test_numpy_and_onnxruntime_are_enough(exported, controller):
    action, estimate = in_a_process(ALONE, exported / "agent.onnx")
    for _ in range(3):
        expected = controller.act([0.1, 0.2], 1.0)
    np.testing.assert_allclose(json.loads(action), expected, atol=1e-6)
    assert estimate == str(controller.task_estimate())


def test_torch_is_enough_for_torchscript(exported, controller):
    (action,) = in_a_process(TORCH_ALONE, exported / "agent.pt")
    for _ in range(3):
        expected = controller.act([0.1, 0.2], 1.0)
    np.testing.assert_allclose(json.loads(action), expected, atol=1e-5)


def test_a_file_says_what_goes_in_and_comes_out(controller, forgetful):
    about = controller.metadata
    assert about["made_by"]["algorithm"] == "BrunoSAC" and about["made_by"]["encoder"] == "BrunoEncoder"
    assert about["action"] == {"shape": [2], "low": [-1.0, -1.0], "high": [1.0, 1.0]}
    assert about["observation"]["shape"] == [2] and about["forget_threshold"] == 0.2
    assert about["outputs"] == [
        "next_action",
        "next_memory",
        "surprise",
        "task_mean",
        "task_std",
        "task_probabilities",
    ]
    assert about["task"]["names"] == list(forgetful.task_labels.names)
    ends = [part["start"] + int(np.prod(part["shape"])) for part in about["memory"]]
    assert [part["start"] for part in about["memory"]] == [0, *ends[:-1]]
    assert about["inputs"]["memory"] == [1, ends[-1]]
    assert controller.action_low.tolist() == [-1, -1] and controller.action_high.tolist() == [1, 1]


def test_reset_forgets_everything(controller):
    first = controller.act([0.1, 0.2])
    estimate = controller.task_estimate()
    for _ in range(5):
        controller.act([0.3, 0.2], 2.0)
    controller.reset()
    assert controller.surprise is None
    with pytest.raises(ValueError, match="has not acted"):
        controller.task_estimate()
    np.testing.assert_array_equal(controller.act([0.1, 0.2], reward=7.0), first)  # whose reward nobody reads
    np.testing.assert_array_equal(controller.task_estimate().mean, estimate.mean)


def test_an_action_is_the_callers_own(controller):
    action = controller.act([0.1, 0.2])
    kept = action.copy()
    action[:] = 99.0
    other = controller.act([0.1, 0.2])
    controller.reset()
    np.testing.assert_array_equal(controller.act([0.1, 0.2]), kept)
    np.testing.assert_array_equal(controller.act([0.1, 0.2]), other)


def test_a_new_task_stays_one_if_an_episode_is_started_too(controller):
    for _ in range(3):
        controller.act([0.1, 0.2], 1.0)
    controller.reset()
    controller.start_episode()
    first = controller.act([0.1, 0.2])
    controller.reset()
    np.testing.assert_array_equal(controller.act([0.1, 0.2]), first)


@pytest.mark.parametrize(
    ("given", "told"),
    [
        ({"observation": [0.1]}, r"`observation` has shape \(1,\), expected \(2,\)"),
        ({"observation": [[0.1, 0.2], [0.1, 0.2]]}, "`observation` has shape"),
        ({"observation": [0.1, np.nan]}, "`observation` is nan at index 1"),
        ({"observation": [0.1, np.inf]}, "`observation` is inf at index 1"),
        ({"observation": "left"}, "`observation` is of type <U4, no array of numbers"),
        ({"observation": ["0.1", "0.2"]}, "`observation` is of type <U3, no array of numbers"),
        ({"observation": [0.1, 0.2j]}, "`observation` is of type complex128"),
        ({"observation": None}, "`observation` is of type object"),
        ({"observation": {"eye": [0.1], "ear": [0.2]}}, "`observation` is a dict: give the vector"),
        ({"observation": [0.1, -1e300]}, r"`observation` is -1e\+300 at index 1: give finite numbers up to 1e9"),
        ({"observation": [0.1, 0.2], "reward": None}, "`reward` is of type object"),
        ({"observation": [[0.1], [0.2, 0.3]]}, "`observation` is no array of numbers"),
        ({"observation": [0.1, 0.2], "reward": np.nan}, "`reward` is nan"),
        ({"observation": [0.1, 0.2], "reward": [1.0, 2.0]}, "`reward` has shape"),
        ({"observation": [0.1, 0.2], "action": [1.0]}, "`action` has shape"),
        ({"observation": [0.1, 0.2], "action": [1.0, -np.inf]}, "`action` is -inf"),
    ],
)
def test_what_is_no_step_is_refused_and_changes_nothing(controller, given, told):
    controller.act([0.1, 0.2])
    with pytest.raises(ValueError, match=told):
        controller.act(**given)
    after = controller.act([0.3, 0.2], 1.0)
    controller.reset()
    controller.act([0.1, 0.2])
    np.testing.assert_array_equal(controller.act([0.3, 0.2], 1.0), after)


@pytest.mark.parametrize(
    "change",
    [
        {"format": "1"},
        {"outputs": None},
        {"outputs": ["next_action"]},
        {"action": None},
        {"action": {"shape": [3], "low": [-1.0, -1.0], "high": [1.0, 1.0]}},
        {"observation": {"shape": 2}},
        {"inputs": {"observation": "wide"}},
        {"inputs": []},
    ],
)
def test_a_file_that_describes_itself_wrongly_is_refused(exported, tmp_path, change):
    model = onnx.load(exported / "agent.onnx")
    model.metadata_props[0].value = json.dumps({**json.loads(model.metadata_props[0].value), **change})
    onnx.save(model, tmp_path / "odd.onnx")
    with pytest.raises(ValueError, match=r"describes itself wrongly|describes other outputs"):
        Controller(tmp_path / "odd.onnx")


@pytest.mark.parametrize("n_threads", [0, -1, "2", 1.5, True, None])
def test_threads_are_a_positive_number(exported, n_threads):
    with pytest.raises(ValueError, match=r"`n_threads=.*` is no positive whole number"):
        Controller(exported / "agent.onnx", n_threads=n_threads)


@pytest.mark.parametrize("seed", [-1, "x", 1.0, True, np.int64(-3), [1, 2]])
def test_a_seed_is_a_whole_number(exported, seed):
    with pytest.raises(ValueError, match=r"`seed=.*` is no whole number of 0 or more: give one, or None"):
        Controller(exported / "agent.onnx", seed=seed)
    assert Controller(exported / "agent.onnx", seed=np.int64(3)).act([0.1, 0.2]).shape == (2,)


@pytest.mark.parametrize("path", [None, 5, b"agent.onnx", ["agent.onnx"]])
def test_a_path_is_a_text_or_a_path(path):
    with pytest.raises(ValueError, match=r"`path=.*` is no path: give the .onnx file that `model.export` wrote"):
        Controller(path)


def test_a_copy_goes_on_where_the_controller_was(controller):
    for _ in range(3):
        controller.act([0.1, 0.2], 1.0)
    copied = pickle.loads(pickle.dumps(controller))
    np.testing.assert_array_equal(copied.act([0.3, 0.2], 1.0), controller.act([0.3, 0.2], 1.0))


def test_a_file_that_is_no_agent_is_refused(exported, tmp_path):
    model = onnx.load(exported / "agent.onnx")
    about = json.loads(model.metadata_props[0].value)
    about["format"] += 1
    model.metadata_props[0].value = json.dumps(about)
    onnx.save(model, tmp_path / "later.onnx")
    model.metadata_props.pop()
    onnx.save(model, tmp_path / "other.onnx")
    (tmp_path / "text.onnx").write_text("no agent")
    for path, told in {
        tmp_path / "missing.onnx": "does not exist",
        tmp_path: "is no file",
        tmp_path / "text.onnx": "cannot be run by onnxruntime",
        exported / "agent.pt": "cannot be run by onnxruntime",
        tmp_path / "other.onnx": "is no agent of sb3_bruno",
        tmp_path / "later.onnx": "install a later one",
    }.items():
        with pytest.raises(ValueError, match=told):
            Controller(path)
