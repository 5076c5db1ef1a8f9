"""Off-policy actor-critics that infer the task: a mixin, its policies, and one thin class per algorithm."""
