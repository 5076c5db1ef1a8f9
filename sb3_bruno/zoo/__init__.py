"""The adapter to RL Zoo and Optuna: experiments, registry, configs, sweeps."""
