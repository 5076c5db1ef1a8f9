"""One step of an agent as a pure function: what it sees and remembers in, its action and its new memory out.

It computes what ``predict(deterministic=True)`` does in one env, by operations that an exporter can follow. The env's
own units go in and come out: scaling and normalisation are part of it.
"""

from __future__ import annotations

import io
from typing import Any

import cloudpickle
import torch as th
from gymnasium import spaces
from stable_baselines3.common.vec_env import VecNormalize
from torch import Tensor, nn

from sb3_bruno.algorithms.carried import Carried
from sb3_bruno.algorithms.forgetting import Suspicion, absorb_or_forget
from sb3_bruno.algorithms.policies import TaskInferencePolicy
from sb3_bruno.encoders import Predicts, TaskEncoder, Transitions
from sb3_bruno.encoders.base import AnyMemory, map_memory
from sb3_bruno.encoders.task_readout import ListReadout, TaskReadout
from sb3_bruno.export.noise import drawn_by_redraw, keep_noise
from sb3_bruno.export.units import ActionBounds, normalizer

NEW_TASK = 1.0
"""``episode_start`` where a task begins: the memory is not read. Between 0 and it, an episode of the same task."""


class Step(nn.Module):
    """Creates the step of an agent, of its weights on the CPU as they are now.

    Args:
        policy: the agent's. Its ``forget_threshold`` becomes part of the step.
        vec_normalize: the VecNormalize of its env, if there is one.

    Attributes:
        encoder: a copy of the policy's encoder, whose noise the caller gives.
        readout: a copy of the policy's, or None.
        forgets: whether the memory holds a suspicion of a switch.
        parts: what the memory holds, by name: shapes without the batch dimension, in order.
        noise: which entries of the encoder's memory are noise.
        noise_dim: how many numbers these have.
    """

    def __init__(self, policy: TaskInferencePolicy, vec_normalize: VecNormalize | None = None) -> None:
        super().__init__()
        self.encoder: TaskEncoder = _copied(policy.encoder)
        actor: Any = policy.actor  # of the policy that the mixin is mixed into
        self.actor = _copied(actor)
        self.readout: TaskReadout | None = None if policy.readout is None else _copied(policy.readout)
        self.layout = policy.layout
        self.forget_threshold = policy.forget_threshold
        self.forgets = policy.forget_threshold is not None
        assert isinstance(policy.action_space, spaces.Box)  # for mypy
        self.bounds = ActionBounds(policy.action_space)
        self.show_observation = normalizer(vec_normalize, "observation")
        self.show_action = normalizer(vec_normalize, "action")
        self.show_reward = normalizer(vec_normalize, "reward")
        self.observation_dim = spaces.flatdim(policy.observation_space["observation"])
        self.noise = drawn_by_redraw(self.encoder)
        keep_noise(self.encoder)
        kept = self.encoder.empty((1,))
        self.noise_dim = sum(kept[i].numel() for i in self.noise)
        self.parts = self._parts(kept)

    @property
    def memory_dim(self) -> int:
        """How many numbers the memory has."""
        return sum(shape.numel() for shape in self.parts.values())

    def example(self) -> dict[str, Tensor]:
        """Make the inputs of a task's first step, by name: zeros, of shape (1, dim) each."""
        sizes = {
            "observation": self.observation_dim,
            "action": len(self.bounds.low),
            "reward": 1,
            "episode_start": 1,
            "memory": self.memory_dim,
        }
        if self.noise:
            sizes["noise"] = self.noise_dim
        inputs = {name: th.zeros(1, size) for name, size in sizes.items()}
        return {**inputs, "episode_start": th.full((1, 1), NEW_TASK)}

    def output_names(self) -> list[str]:
        """Name what ``forward`` returns, in order."""
        names = ["next_action", "next_memory"]
        if isinstance(self.encoder, Predicts):
            names.append("surprise")
        if self.readout is not None:
            names += ["task_mean", "task_std"]
        if isinstance(self.readout, ListReadout):
            names.append("task_probabilities")
        return names

    def forward(
        self,
        observation: Tensor,
        action: Tensor,
        reward: Tensor,
        episode_start: Tensor,
        memory: Tensor,
        noise: Tensor | None = None,
    ) -> tuple[Tensor, ...]:
        """Absorb the transition that led here, and act. All tensors have shape (1, dim), and the env's own units.

        Args:
            observation: what is seen now.
            action: what was done last.
            reward: what came of it.
            episode_start: 0 where that led here; ``NEW_TASK`` where a task begins, whatever the memory; a half where
                another episode of the same task does. Action and reward are read in the first case alone.
            memory: what the last step returned.
            noise: standard normal, read where an episode begins; of an encoder that samples.

        Returns:
            What ``output_names`` says: the action; the memory; of an encoder that predicts, the surprise at the
            transition in nats, log p(it | nothing known) - log p(it | what was known), 0 where an episode begins; of an
            agent with a read-out, the task's mean and standard deviation, and of few tasks their probabilities.
        """
        here = self.show_observation(observation)
        nothing = Carried.start(self.encoder, here, may_forget=self.forgets)
        carried = self._unpack(memory, nothing).where(episode_start < NEW_TASK, nothing)
        last = self.show_action(self.bounds.scale(action)), self.show_reward(reward)
        transition = Transitions(carried.observation, *last, here)
        began = episode_start > 0
        begun = carried._replace(memory=self.encoder.start_episode(self._with_noise(carried.memory, noise)))
        after = begun.where(began, self._absorb(carried, transition))._replace(observation=here)
        extended = self.layout.join(here, self.encoder.belief(after.memory))
        chosen = self.bounds.unscale(self.actor._predict(extended, deterministic=True))
        outputs = [chosen, _pack(after)]
        if isinstance(self.encoder, Predicts):
            surprise = self.encoder.log_bayes_factor(carried.memory, transition).unsqueeze(-1)
            outputs.append(th.where(began, 0.0, surprise))
        if self.readout is not None:
            outputs += [told for told in self.readout.read(self.encoder, after.memory) if told is not None]
        return tuple(outputs)

    def _absorb(self, carried: Carried, transition: Transitions) -> Carried:
        memory, _, suspicion = carried
        if self.forget_threshold is None or suspicion is None:
            return carried._replace(memory=self.encoder.absorb(memory, transition))
        memory, suspicion = absorb_or_forget(self.encoder, memory, suspicion, transition, self.forget_threshold)
        return carried._replace(memory=memory, suspicion=suspicion)

    def _with_noise(self, memory: AnyMemory, noise: Tensor | None) -> AnyMemory:
        """Put the noise in its place."""
        if noise is None:
            return memory
        entries = list(memory)
        numbers = noise.split([entries[i].numel() for i in self.noise], dim=-1)
        for i, drawn in zip(self.noise, numbers, strict=True):
            entries[i] = drawn.reshape(entries[i].shape)
        given = iter(entries)
        return map_memory(lambda _: next(given), memory)

    def _unpack(self, memory: Tensor, like: Carried) -> Carried:
        """Divide the memory, (1, memory_dim), into what is carried."""
        tensors = iter(memory.split([shape.numel() for shape in self.parts.values()], dim=-1))

        def encoders() -> AnyMemory:
            return map_memory(lambda entry: next(tensors).reshape(entry.shape).to(entry.dtype), like.memory)

        kept, observation = encoders(), next(tensors)
        if not self.forgets:
            return Carried(kept, observation, None)
        recent = encoders()
        return Carried(kept, observation, Suspicion(next(tensors), recent))

    def _parts(self, kept: AnyMemory) -> dict[str, th.Size]:
        names = getattr(kept, "_fields", range(len(kept)))
        of_encoder = {f"{name}": entry.shape[1:] for name, entry in zip(names, kept, strict=True)}
        parts = {**of_encoder, "previous_observation": th.Size([self.observation_dim])}
        if self.forgets:
            parts |= {**{f"recent_{name}": shape for name, shape in of_encoder.items()}, "evidence": th.Size([1])}
        return parts


def _pack(carried: Carried) -> Tensor:
    """Join what is carried to one vector, (1, memory_dim), in the order of ``Carried.pack``."""
    tensors = [*carried.memory, carried.observation]
    if carried.suspicion is not None:
        tensors += [*carried.suspicion.recent, carried.suspicion.evidence]
    return th.cat([tensor.flatten(1).float() for tensor in tensors], dim=-1)


def _copied(module: nn.Module) -> Any:
    """Copy a module to the CPU, to act with; ``copy.deepcopy`` refuses one that keeps a computed tensor, as gSDE's."""
    buffer = io.BytesIO()
    th.save(module, buffer, pickle_module=cloudpickle)
    buffer.seek(0)
    copied: nn.Module = th.load(buffer, map_location="cpu", weights_only=False)
    return copied.eval()
