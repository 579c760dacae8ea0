"""Values of Arrow arrays of any layout, for messages.

Values are read and compared, never cast: casts of Arrow take text for numbers, turn what does not fit into infinity,
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
_MAX_SHOWN = 200
"""Characters of a name or a type in an error text."""


def plain(column: Any) -> Any:
    """Return an array without the encodings and views that Arrow has for the same values.

    List views stay: `lists` reads them.
    """
    kind, types = column.type, pa.types
    if isinstance(kind, pa.BaseExtensionType):
        return plain(column.storage)
    found = column
    if types.is_dictionary(kind):
        found = plain(_taken(plain(column.dictionary), column.indices))
    elif types.is_run_end_encoded(kind):
        found = plain(_taken(plain(column.values), _runs(column)))
    elif types.is_string_view(kind):
        found = pa.array(column.to_pylist(), pa.large_string())
    elif types.is_binary_view(kind):
        found = pa.array(column.to_pylist(), pa.large_binary())
    if len(found) != len(column):
        raise BagError(f"Arrow has read {len(found)} of {len(column)} values of {shown(kind)}")
    return found


def _runs(column: Any) -> Any:
    """Return for each element of a run-end encoded array the place of its value."""
    rows = column.offset + np.arange(len(column))
    return pa.array(np.searchsorted(column.run_ends.to_numpy(), rows, side="right"))


def _taken(column: Any, places: Any) -> Any:
    try:
        return column.take(places)
    except pa.ArrowNotImplementedError:  # as of structs with string views
        ones = (pa.nulls(1, column.type) if at is None else column.slice(at, 1) for at in places.to_pylist())
        return pa.concat_arrays([column.slice(0, 0), *ones])


def require_values(column: Any, path: str) -> None:
    """Raise `BagError` if one of the values is null."""
    if column.null_count:
        row = column.is_null().index(True).as_py()
        raise BagError(f"{path}: no value in row {row}; messages have one for every field")


def lists(column: Any, path: str, wanted: object) -> tuple[NDArray[np.int64], Any]:
    """Return the length of each list of an array, and all elements, one list after the other."""
    kind, types = column.type, pa.types
    if types.is_list_view(kind) or types.is_large_list_view(kind):
        return _viewed(column, path)
    if types.is_fixed_size_list(kind):
        sizes = np.full(len(column), kind.list_size, np.int64)
    elif types.is_list(kind) or types.is_large_list(kind):
        sizes = column.value_lengths().to_numpy(zero_copy_only=False).astype(np.int64)
    else:
        raise BagError(f"{path}: expected a list for {wanted}, found {shown(kind)}")
    return sizes, _counted(column.flatten(), int(sizes.sum()), path)


def _viewed(column: Any, path: str) -> tuple[NDArray[np.int64], Any]:
    sizes = column.sizes.to_numpy(zero_copy_only=False).astype(np.int64)
    offsets = column.offsets.to_numpy(zero_copy_only=False).astype(np.int64)
    inside = plain(column.values)
    if len(sizes) and (min(offsets.min(), sizes.min()) < 0 or (offsets + sizes).max() > len(inside)):
        raise BagError(f"{path}: lists that lie outside of their {len(inside)} elements")
    total = int(sizes.sum())
    places = np.repeat(offsets - (sizes.cumsum() - sizes), sizes) + np.arange(total)
    return sizes, _counted(_taken(inside, pa.array(places)), total, path)


def _counted(elements: Any, count: int, path: str) -> Any:
    if len(elements) != count:
        raise BagError(f"{path}: found {len(elements)} elements in lists of {count}")
    return plain(elements)


def texts(column: Any, path: str) -> list[str]:
    """Return the values of an array of text."""
    kind, types = column.type, pa.types
    if not (types.is_string(kind) or types.is_large_string(kind) or _is_nothing(column)):
        raise BagError(f"{path}: expected text, found {shown(kind)}")
    return column.to_pylist()  # type: ignore[no-any-return]


def is_octets(kind: Any) -> bool:
    """Return True if the values of an Arrow type are bytes."""
    types = pa.types
    return bool(types.is_binary(kind) or types.is_large_binary(kind) or types.is_fixed_size_binary(kind))


def numbers(column: Any, code: str, path: str) -> NDArray[Any]:
    """Return the values of an array of numbers as those that the code of `struct` means.

    Raises:
        BagError: the array has something else, or a value does not fit: it is out of range, has a fraction where
            integers are expected, or is an integer that has no exact floating point number.
    """
    wanted, kind, types = NUMBERS[code], column.type, pa.types
    dtype = np.dtype(wanted.to_pandas_dtype())
    if _is_nothing(column):
        return np.empty(0, dtype)
    is_number = types.is_integer(kind) or types.is_floating(kind) or types.is_decimal(kind)
    if not (types.is_boolean(kind) if code == "?" else is_number):
        raise BagError(f"{path}: expected {wanted}, found {shown(kind)}")
    values = np.asarray(column.to_pylist(), object) if types.is_decimal(kind) else column.to_numpy(zero_copy_only=False)
    if values.dtype == dtype:
        return values
    if dtype.kind == "f":
        wrong, found = _wrong_floats(values, dtype)
    else:
        wrong, found = _wrong_integers(values, dtype)
    if wrong.any():
        row = int(wrong.argmax())
        raise BagError(f"{path}: {shown(values[row])} in row {row} does not fit {wanted}")
    return found


def _wrong_integers(values: NDArray[Any], dtype: np.dtype[Any]) -> tuple[NDArray[np.bool_], NDArray[Any]]:
    """Return where values are no integers of a type, and the others."""
    limits = np.iinfo(dtype)
    if values.dtype.kind in "iu":
        # numpy compares integers of any sizes with Python's exactly
        wrong = (values < max(limits.min, np.iinfo(values.dtype).min)) | (
            values > min(limits.max, np.iinfo(values.dtype).max)
        )
    elif values.dtype.kind == "f":
        double = values.astype(np.float64)  # in which the limits, powers of 2, are exact
        wrong = ~((double >= float(limits.min)) & (double < float(limits.max + 1)) & (np.trunc(double) == double))
    else:
        wrong = np.array([one != one.to_integral_value() or not limits.min <= one <= limits.max for one in values])
    return wrong, np.where(wrong, 0, values).astype(dtype)


def _wrong_floats(values: NDArray[Any], dtype: np.dtype[Any]) -> tuple[NDArray[np.bool_], NDArray[Any]]:
    """Return where values are no floating point numbers of a type, and all as such; fractions are rounded."""
    with np.errstate(over="ignore"):
        found = values.astype(dtype)
    if values.dtype.kind == "f":
        return np.isinf(found) & ~np.isinf(values), found
    wrong = np.isinf(found)
    for row in np.flatnonzero(np.abs(found) > 2 ** np.finfo(dtype).nmant).tolist():
        whole = int(values[row])
        wrong[row] = wrong[row] or (values[row] == whole and int(found[row]) != whole)
    return wrong, found


def nanoseconds(column: Any, path: str, wanted: Kind) -> NDArray[np.int64]:
    """Return times or durations, or integers, as nanoseconds."""
    kind, types = column.type, pa.types
    if _is_nothing(column) or types.is_integer(kind):
        return numbers(column, "q", path)
    is_time = wanted is Kind.TIME
    if not (types.is_timestamp(kind) if is_time else types.is_duration(kind)):
        name = "a time" if is_time else "a duration"
        raise BagError(f"{path}: expected {name}, or nanoseconds as integers, found {shown(kind)}")
    values: NDArray[np.int64] = column.view(pa.int64()).to_numpy(zero_copy_only=False)
    factor = _UNITS_NS[kind.unit]
    limits = np.iinfo(np.int64)
    wrong = (values > limits.max // factor) | (values < -(limits.max // factor))
    if wrong.any():
        row = int(wrong.argmax())
        raise BagError(f"{path}: {values[row]} {kind.unit} in row {row} does not fit 64 bits of nanoseconds")
    return values * factor


def _is_nothing(column: Any) -> bool:
    """Return True for the elements of lists that are all empty: they may have no type."""
    return pa.types.is_null(column.type) and not len(column)


def shown(value: object) -> str:
    """Return a name, a type or a value for an error text, printable and of bounded length."""
    return printable(str(value), _MAX_SHOWN)
