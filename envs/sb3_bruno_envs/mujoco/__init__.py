"""Gives Gymnasium's MuJoCo robots hidden tasks: directions, velocities, bodies."""
