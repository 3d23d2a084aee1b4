"""JAX with double precision: temperatures near 300 K need more than seven digits."""

import jax
import jax.numpy as jnp

jax.config.update("jax_enable_x64", True)

QUICKLY_COMPILED = {"xla_backend_optimization_level": 0, "xla_llvm_disable_expensive_passes": True}
"""For `jax.jit`: the oracle runs once in a test, and takes far longer to compile than to run."""

__all__ = ["QUICKLY_COMPILED", "jax", "jnp"]
