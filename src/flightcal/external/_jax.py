"""JAX with double precision: temperatures near 300 K need more than seven digits. Import jax from here only."""

import jax
import jax.numpy as jnp

jax.config.update("jax_enable_x64", True)

__all__ = ["jax", "jnp"]
