"""The integration's slow, obvious twin in plain JAX, which judges the compiled functions.

The benchmarks read it too.
"""

from .double import QUICKLY_COMPILED, jax, jnp
from .integration import dense, integrate, rosenbrock_step, simulate

__all__ = ["QUICKLY_COMPILED", "dense", "integrate", "jax", "jnp", "rosenbrock_step", "simulate"]
