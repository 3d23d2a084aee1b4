"""What a run keeps: dataclasses as JSON and back, and arrays as netCDF."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Callable, Mapping
from itertools import repeat
from pathlib import Path
from types import UnionType
from typing import Any, Final, TypeVar, Union, get_args, get_origin, get_type_hints

import numpy as np
import xarray

from ..errors import RunError
from .files import write_bytes

ENGINE: Final = "h5netcdf"

_UNREADABLE: Final = (OSError, ValueError, KeyError, RuntimeError)
"""What h5py raises for a damaged file, depending on where the damage is."""

K = TypeVar("K")


def plain(value: Any) -> Any:
    """Dataclasses, NumPy values and times as JSON knows them; NaN as null."""
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        return {field.name: plain(getattr(value, field.name)) for field in dataclasses.fields(value)}
    if isinstance(value, dict):
        return {key: plain(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [plain(item) for item in value]
    if isinstance(value, np.datetime64):
        return str(value.astype("datetime64[s]"))
    if isinstance(value, np.ndarray):
        return plain(value.tolist())
    if isinstance(value, np.generic):
        value = value.item()
    if isinstance(value, float) and not np.isfinite(value):
        return None
    return value


def typed(kind: type[K], content: Mapping[str, Any]) -> K:
    """The dataclass that `plain` was given. Entries that are no fields of `kind` are left out.

    Raises KeyError with the name of a field that lacks and has no default.
    """
    hints = get_type_hints(kind)
    known = {}
    for field in dataclasses.fields(kind):  # type: ignore[arg-type]
        if field.name in content:
            known[field.name] = _value(hints[field.name], content[field.name])
        elif field.default is dataclasses.MISSING and field.default_factory is dataclasses.MISSING:
            raise KeyError(field.name)
    return kind(**known)


def _value(hint: Any, value: Any) -> Any:
    """A value of JSON as the type of its field: a list as a tuple or an array, a missing number as NaN."""
    if get_origin(hint) in (Union, UnionType):
        hint = next(kind for kind in get_args(hint) if kind is not type(None))
        return None if value is None else _value(hint, value)
    if dataclasses.is_dataclass(hint) and isinstance(hint, type):
        return typed(hint, value)
    kinds = get_args(hint)
    if get_origin(hint) is tuple:
        return tuple(map(_value, repeat(kinds[0]) if kinds[-1] is Ellipsis else kinds, value))
    if get_origin(hint) is np.ndarray:
        return np.array(value, float)
    if get_origin(hint) is Mapping:
        return {key: _value(kinds[1], item) for key, item in value.items()}
    if hint is float:
        return np.nan if value is None else value
    return np.datetime64(value) if hint is np.datetime64 else value


def read_json(file: Path) -> Any:
    """Content of a JSON file. Raises RunError where it is damaged."""
    try:
        return json.loads(file.read_text(encoding="utf-8"))
    except ValueError as error:
        raise RunError(f"{file}: not JSON: {error}") from None


def read_records(file: Path, read: Callable[[Any], K]) -> list[K]:
    """Records of a JSON list, each through `read`. Raises RunError where one is not as expected."""
    try:
        return [read(record) for record in read_json(file)]
    except KeyError as error:
        raise RunError(f"{file}: a record has no field {error}") from None
    except TypeError as error:
        raise RunError(f"{file}: a record is not as expected: {error}") from None


def read_dataset(file: Path) -> xarray.Dataset:
    """A dataset, in memory. Raises RunError where it is damaged."""
    try:
        return xarray.load_dataset(file, engine=ENGINE)
    except _UNREADABLE as error:
        raise RunError(f"{file}: not a netCDF file: {error}") from None


def read_tree(file: Path) -> xarray.DataTree:
    """A tree of datasets, in memory. Raises RunError where it is damaged."""
    try:
        with xarray.open_datatree(file, engine=ENGINE) as tree:
            return tree.load()
    except _UNREADABLE as error:
        raise RunError(f"{file}: not a netCDF file: {error}") from None


def json_bytes(content: Any) -> bytes:
    """Content as the JSON file that `write_json` writes; NaN is not JSON and is refused."""
    return (json.dumps(content, indent=1, allow_nan=False) + "\n").encode()


def netcdf_bytes(data: xarray.Dataset | xarray.DataTree) -> bytes:
    """A dataset or a tree of them as a netCDF file.

    In memory: HDF5 that cannot write to its file keeps what is left for the end of the process, and crashes there.
    """
    return bytes(data.to_netcdf(engine=ENGINE))


def write_text(file: Path, text: str) -> None:
    """Write a text file atomically, UTF-8."""
    write_bytes(file, text.encode())


def write_json(file: Path, content: Any) -> None:
    """Write a JSON file atomically; NaN is not JSON and is refused."""
    write_bytes(file, json_bytes(content))


def write_netcdf(file: Path, data: xarray.Dataset | xarray.DataTree) -> None:
    """Write a dataset or a tree of them atomically."""
    write_bytes(file, netcdf_bytes(data))
