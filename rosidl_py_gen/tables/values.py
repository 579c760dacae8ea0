"""Values of Arrow arrays of any layout, for messages.

Values are read and compared, never cast: casts of Arrow parse texts as numbers, make values that do not fit infinite,
and lose elements of list views.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from rosidl_py_gen.bags.common import BagError
from rosidl_py_gen.errors import printable
from rosidl_py_gen.tables.arrow import pa
from rosidl_py_gen.tables.columns import Kind
from rosidl_py_gen.tables.schema import NUMBERS

if TYPE_CHECKING:
    from numpy.typing import NDArray

_UNITS_NS = {"s": 1_000_000_000, "ms": 1_000_000, "us": 1_000, "ns": 1}
_MAX_TEXT = 200
"""Maximum number of characters of a name or a type in an error text."""


def plain(column: Any) -> Any:
    """Return an array without dictionaries, run ends and views, except list views, which `lists` reads."""
    kind, types = column.type, pa.types
    if isinstance(kind, pa.BaseExtensionType):
        return plain(column.storage)
    result = column
    if types.is_dictionary(kind):
        result = plain(_take(plain(column.dictionary), column.indices))
    elif types.is_run_end_encoded(kind):
        rows = column.offset + np.arange(len(column))
        runs = np.searchsorted(column.run_ends.to_numpy(), rows, side="right")
        result = plain(_take(plain(column.values), pa.array(runs)))
    elif types.is_string_view(kind):
        result = pa.array(column.to_pylist(), pa.large_string())
    elif types.is_binary_view(kind):
        result = pa.array(column.to_pylist(), pa.large_binary())
    if len(result) != len(column):
        raise BagError(f"Arrow has read {len(result)} of {len(column)} values of {short_text(kind)}")
    return result


def _take(column: Any, indices: Any) -> Any:
    try:
        return column.take(indices)
    except pa.ArrowNotImplementedError:  # for example structs with string views
        rows = (pa.nulls(1, column.type) if at is None else column.slice(at, 1) for at in indices.to_pylist())
        return pa.concat_arrays([column.slice(0, 0), *rows])


def require_values(column: Any, path: str) -> None:
    """Raise `BagError` if one of the values is null."""
    if column.null_count:
        row = column.is_null().index(True).as_py()
        raise BagError(f"{path}: no value in row {row}; messages have a value for every field")


def lists(column: Any, path: str, expected: object) -> tuple[NDArray[np.int64], Any]:
    """Return the length of each list of an array, and all elements, one list after the other."""
    kind, types = column.type, pa.types
    if types.is_list_view(kind) or types.is_large_list_view(kind):
        return _view_lists(column, path)
    if types.is_fixed_size_list(kind):
        sizes = np.full(len(column), kind.list_size, np.int64)
    elif types.is_list(kind) or types.is_large_list(kind):
        sizes = column.value_lengths().to_numpy(zero_copy_only=False).astype(np.int64)
    else:
        raise BagError(f"{path}: expected a list for {expected}, found {short_text(kind)}")
    return sizes, _require_count(column.flatten(), int(sizes.sum()), path)


def _view_lists(column: Any, path: str) -> tuple[NDArray[np.int64], Any]:
    sizes = column.sizes.to_numpy(zero_copy_only=False).astype(np.int64)
    offsets = column.offsets.to_numpy(zero_copy_only=False).astype(np.int64)
    inside = plain(column.values)
    if len(sizes) and (min(offsets.min(), sizes.min()) < 0 or (offsets + sizes).max() > len(inside)):
        raise BagError(f"{path}: a list refers to elements beyond the {len(inside)} stored")
    total = int(sizes.sum())
    indices = np.repeat(offsets - (sizes.cumsum() - sizes), sizes) + np.arange(total)
    return sizes, _require_count(_take(inside, pa.array(indices)), total, path)


def _require_count(elements: Any, count: int, path: str) -> Any:
    if len(elements) != count:
        raise BagError(f"{path}: found {len(elements)} elements in lists of {count}")
    return plain(elements)


def texts(column: Any, path: str) -> list[str]:
    """Return the values of an array of text."""
    kind, types = column.type, pa.types
    if not (types.is_string(kind) or types.is_large_string(kind) or _is_empty_null(column)):
        raise BagError(f"{path}: expected text, found {short_text(kind)}")
    return column.to_pylist()  # type: ignore[no-any-return]


def is_octets(kind: Any) -> bool:
    """Return True if the values of an Arrow type are bytes."""
    types = pa.types
    return bool(types.is_binary(kind) or types.is_large_binary(kind) or types.is_fixed_size_binary(kind))


def numbers(column: Any, code: str, path: str) -> NDArray[Any]:
    """Return the values of an array of numbers in the type of a struct code.

    Raises `BagError` if the array has other values, or a value does not fit: it is out of range, has a fraction where
    integers are expected, or is an integer without exact floating point number.
    """
    target, kind, types = NUMBERS[code], column.type, pa.types
    dtype = np.dtype(target.to_pandas_dtype())
    if _is_empty_null(column):
        return np.empty(0, dtype)
    is_number = types.is_integer(kind) or types.is_floating(kind) or types.is_decimal(kind)
    if not (types.is_boolean(kind) if code == "?" else is_number):
        raise BagError(f"{path}: expected {target}, found {short_text(kind)}")
    values = np.asarray(column.to_pylist(), object) if types.is_decimal(kind) else column.to_numpy(zero_copy_only=False)
    if values.dtype == dtype:
        return values
    wrong, result = (_to_floats if dtype.kind == "f" else _to_integers)(values, dtype)
    if wrong.any():
        row = int(wrong.argmax())
        raise BagError(f"{path}: {short_text(values[row])} in row {row} does not fit {target}")
    return result


def _to_integers(values: NDArray[Any], dtype: np.dtype[Any]) -> tuple[NDArray[np.bool_], NDArray[Any]]:
    """Return a mask of values that the integer type cannot represent, and the converted values."""
    limits = np.iinfo(dtype)
    if values.dtype.kind in "iu":
        own = np.iinfo(values.dtype)
        wrong = (values < max(limits.min, own.min)) | (values > min(limits.max, own.max))  # exact comparisons
    elif values.dtype.kind == "f":
        double = values.astype(np.float64)  # the limits, powers of 2, are exact
        wrong = ~((double >= float(limits.min)) & (double < float(limits.max + 1)) & (np.trunc(double) == double))
    else:
        wrong = np.array([one != one.to_integral_value() or not limits.min <= one <= limits.max for one in values])
    return wrong, np.where(wrong, 0, values).astype(dtype)


def _to_floats(values: NDArray[Any], dtype: np.dtype[Any]) -> tuple[NDArray[np.bool_], NDArray[Any]]:
    """Return a mask of values that the float type cannot represent, and the converted values; fractions are rounded."""
    with np.errstate(over="ignore"):
        result = values.astype(dtype)
    if values.dtype.kind == "f":
        return np.isinf(result) & ~np.isinf(values), result
    wrong = np.isinf(result)
    for row in np.flatnonzero(np.abs(result) > 2 ** np.finfo(dtype).nmant).tolist():
        whole = int(values[row])
        wrong[row] = wrong[row] or (values[row] == whole and int(result[row]) != whole)
    return wrong, result


def nanoseconds(column: Any, path: str, time_kind: Kind) -> NDArray[np.int64]:
    """Return times or durations, or integers, as nanoseconds."""
    kind, types = column.type, pa.types
    if _is_empty_null(column) or types.is_integer(kind):
        return numbers(column, "q", path)
    is_time = time_kind is Kind.TIME
    if not (types.is_timestamp(kind) if is_time else types.is_duration(kind)):
        name = "a time" if is_time else "a duration"
        raise BagError(f"{path}: expected {name}, or nanoseconds as integers, found {short_text(kind)}")
    values: NDArray[np.int64] = column.view(pa.int64()).to_numpy(zero_copy_only=False)
    factor = _UNITS_NS[kind.unit]
    limits = np.iinfo(np.int64)
    wrong = (values > limits.max // factor) | (values < -(limits.max // factor))
    if wrong.any():
        row = int(wrong.argmax())
        raise BagError(f"{path}: {values[row]} {kind.unit} in row {row} does not fit 64 bits of nanoseconds")
    return values * factor


def _is_empty_null(column: Any) -> bool:
    """Return True for the elements of lists that are all empty: they may have no type."""
    return pa.types.is_null(column.type) and not len(column)


def short_text(value: object) -> str:
    """Return a name, a type or a value for an error text, printable and of bounded length."""
    return printable(str(value), _MAX_TEXT)
