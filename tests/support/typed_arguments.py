"""What a type checker sees of the algorithms' arguments. ``tox -e type`` checks this file; nothing runs it.

An unused ``type: ignore`` is an error there, so each of them says that a mistake is seen.
"""

from sb3_bruno import (
    BeliefSAC,
    BrunoSAC,
    BrunoTD3,
    PearlSAC,
    RecurrentCrossQ,
    RecurrentSAC,
    RecurrentTQC,
    TaskSAC,
    VaribadSAC,
)

ENV = "sb3_bruno_envs:PointDir-v0"

BrunoSAC(
    "MlpPolicy",
    ENV,
    learning_rate=1e-3,
    ent_coef="auto",
    encoder_kwargs={"process": "gaussian", "extra_dims": 1},
    replay_buffer_kwargs={"context": "episode", "n_sequences": 8},
    critic_input="both",
)
RecurrentSAC("MlpPolicy", ENV, encoder_kwargs={"cell": "lstm", "hidden_size": 32}, encoder_tau=0.05)
PearlSAC("MlpPolicy", ENV, encoder_kwargs={"belief": "sample", "kl_weight": 0.1})
VaribadSAC("MlpPolicy", ENV, encoder_kwargs={"modelled": "rewards", "kl_weight": 0.1})
BeliefSAC("MlpPolicy", ENV, encoder_kwargs={"head": "mixture", "belief": "moments"})
RecurrentTQC("MlpPolicy", ENV, top_quantiles_to_drop_per_net=2)
model = TaskSAC("MlpPolicy", ENV, encoder_class="recurrent", encoder_kwargs={"hidden_size": 8})
loaded = TaskSAC.load("agent")

BrunoSAC("MlpPolicy", ENV, learning_rte=1e-3)  # type: ignore[call-arg]
BrunoSAC("MlpPolicy", ENV, critic_input="tasks")  # type: ignore[arg-type]
BrunoSAC("MlpPolicy", ENV, encoder_kwargs={"proces": "gaussian"})  # type: ignore[arg-type]
BrunoSAC("MlpPolicy", ENV, encoder_kwargs={"process": "gausian"})  # type: ignore[arg-type]
BrunoSAC("MlpPolicy", ENV, encoder_kwargs={"cell": "lstm"})  # type: ignore[arg-type]
BrunoSAC("MlpPolicy", ENV, replay_buffer_kwargs={"contxt": "iid"})  # type: ignore[arg-type]
RecurrentSAC("MlpPolicy", ENV, encoder_kwargs={"hidden_size": "32"})  # type: ignore[arg-type]
PearlSAC("MlpPolicy", ENV, encoder_kwargs={"belief": "samples"})  # type: ignore[arg-type]
VaribadSAC("MlpPolicy", ENV, encoder_kwargs={"modelled": "reward"})  # type: ignore[arg-type]
BeliefSAC("MlpPolicy", ENV, encoder_kwargs={"haed": "mixture"})  # type: ignore[arg-type]
BrunoTD3("MlpPolicy", ENV, ent_coef="auto")  # type: ignore[call-arg]
RecurrentCrossQ("MlpPolicy", ENV, tau=0.005)  # type: ignore[call-arg]
