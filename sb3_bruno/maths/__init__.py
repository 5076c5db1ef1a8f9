"""Processes and flows: torch and zuko alone, no reinforcement learning."""
