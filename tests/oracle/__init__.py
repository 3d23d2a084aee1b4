"""The integration's slow, obvious twin in plain JAX, which judges the compiled functions.

The benchmarks read it too.
"""

from .double import QUICKLY_COMPILED, jax, jnp
from .integration import dense, integrate, observe, rosenbrock_step

__all__ = ["QUICKLY_COMPILED", "dense", "integrate", "jax", "jnp", "observe", "rosenbrock_step"]
