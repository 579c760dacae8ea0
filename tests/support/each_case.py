"""Tests that go through many cases and fail once, with all the cases that failed."""

from __future__ import annotations

import inspect
import reprlib
from collections.abc import Callable, Iterable
from functools import wraps
from typing import Any

import pytest

from support.example_counts import examples

LEAST_CASES = 40
"""Cases of one test that the core tests try if there are as many, evenly spread and the same in every run."""


def each_case(names: str | tuple[str, ...], cases: Iterable[Any]) -> Callable[[Callable[..., None]], Any]:
    """Run a test for every case, with the arguments of `pytest.mark.parametrize`, as a single item of pytest.

    For hundreds of cases of one rule, where an item for each costs more than it tells. All cases share the fixtures of
    the test, so it must not change them.
    """
    arguments = tuple(names.replace(" ", "").split(",")) if isinstance(names, str) else names
    rows = [case if len(arguments) > 1 else (case,) for case in cases]

    def decorate(test: Callable[..., None]) -> Any:
        @wraps(test)
        def run(*args: Any, **fixtures: Any) -> None:
            step = max(1, len(rows) // max(LEAST_CASES, examples(len(rows))))
            failed: list[str] = []
            first: BaseException | None = None
            for row in rows[::step]:
                case = dict(zip(arguments, row, strict=True))
                try:
                    test(*args, **case, **fixtures)
                except (Exception, pytest.fail.Exception) as error:
                    first = first or error
                    failed.append(f"{_short.repr(case)}: {type(error).__name__}: {error}"[:600])
            if first is not None:
                more = ["..."] if len(failed) > 20 else []
                raise AssertionError(
                    "\n".join([f"{len(failed)} of {len(rows)} cases failed:", *failed[:20], *more])
                ) from first

        signature = inspect.signature(test)
        parameters = [one for name, one in signature.parameters.items() if name not in arguments]
        run.__signature__ = signature.replace(parameters=parameters)  # type: ignore[attr-defined]
        del run.__wrapped__  # pytest would take the arguments of the test for fixtures
        return run

    return decorate


_short = reprlib.Repr()
_short.maxstring = _short.maxother = 120
_short.maxdict = 10
