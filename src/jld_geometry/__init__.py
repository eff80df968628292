"""Joints that move: derivatives of λ by geometry, optimisation, shapes of joints, bounds over boxes."""
