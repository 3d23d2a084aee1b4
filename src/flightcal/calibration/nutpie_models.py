"""A density as nutpie takes it: a Python function, or a C function that needs no Python while it samples.

nutpie documents neither (what it compiles of PyMC's models is the latter); the tests hold down what is relied on.
"""

from __future__ import annotations

import os
import warnings
from collections.abc import Callable
from typing import Any

import numpy as np

from ..problem import NativeDensity
from ..simulator import FloatArray

NAME = "w"
"""Of what is kept of each draw, [d]."""


def python_model(
    density: Callable[[FloatArray], tuple[float, FloatArray]],
    record: Callable[[FloatArray], dict[str, FloatArray]],
    start: FloatArray,
) -> Any:
    """density: w [d] -> (log density, gradient [d]); record: what to keep of a draw; start: [d]."""
    _import_nutpie()
    from nutpie.compiled_pyfunc import from_pyfunc

    return from_pyfunc(
        ndim=len(start),
        make_logp_fn=lambda: density,
        make_expand_fn=lambda *_: record,
        expanded_dtypes=[np.dtype(np.float64)],
        expanded_shapes=[(len(start),)],
        expanded_names=[NAME],
        make_initial_point_fn=lambda _: start,
    )


def native_model(density: NativeDensity, start: FloatArray) -> Any:
    """The same of a C function."""
    _import_nutpie()
    from nutpie import _lib
    from nutpie.compiled_pyfunc import CompiledModel

    class Model(CompiledModel):
        """What `nutpie.sample` asks of a model."""

        n_dim = len(start)
        shapes = {NAME: (len(start),)}  # noqa: RUF012
        coords: dict[str, Any] = {}  # noqa: RUF012

        def _make_sampler(self, settings: Any, init_mean: Any, cores: Any, *rest: Any) -> Any:
            return _lib.PySampler.from_pymc(settings, cores, self._make_model(init_mean), *rest)

        def _make_model(self, init_mean: Any) -> Any:
            d = len(start)
            sizes = {f"{NAME}_dim_0": d}
            return _lib.PyMcModel(
                _lib.LogpFunc(density.function, density.address, density),
                _lib.ExpandFunc(d, d, density.record, density.address, density),
                _lib.PyVariable.new_variables([NAME], ["float64"], [(d,)], {}, {}),
                d,
                sizes,
                {},
                lambda seed: start,
                None,
            )

    return Model(dims={})


_STACK = 16 * 2**20
"""Bytes for each of nutpie's threads, instead of 2 MiB: linear algebra in a Python density (LAPACK) may need more."""


def _import_nutpie() -> None:
    os.environ.setdefault("RUST_MIN_STACK", str(_STACK))
    with warnings.catch_warnings():
        # nutpie imports the arviz of old, which announces its successor once a day.
        warnings.filterwarnings("ignore", "(?s).*ArviZ is undergoing a major refactor", FutureWarning)
        import nutpie  # noqa: F401
