"""Gymnasium's MuJoCo robots with hidden tasks: directions, velocities, bodies."""
