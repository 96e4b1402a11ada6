"""A matrix whose rows and columns have names, as a table: a mapping of names to a mapping of names to numbers."""

from __future__ import annotations

from collections.abc import Collection, Mapping

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]

Table = Mapping[str, Mapping[str, float]]


def matrix_of(table: Table, names: Collection[str], others: Collection[str] | None = None) -> FloatArray:
    """The rows of some names and their columns, or those of others.

    Parameters
    ----------
    table : mapping of name to mapping of name to float
    names : collection of str
    others : collection of str, optional

    Returns
    -------
    matrix : float array, shape (n_names, n_names or n_others)

    Examples
    --------
    >>> matrix_of({"a": {"a": 4.0, "b": 1.0}, "b": {"a": 1.0, "b": 9.0}}, ["b"], ["a", "b"])
    array([[1., 9.]])
    """
    columns = names if others is None else others
    rows = [[table[name][other] for other in columns] for name in names]
    return np.array(rows, dtype=np.float64).reshape(len(names), len(columns))


def table_of(names: Collection[str], matrix: FloatArray) -> dict[str, dict[str, float]]:
    """A square matrix by the names of its rows and columns.

    Examples
    --------
    >>> table_of(["a", "b"], np.eye(2))
    {'a': {'a': 1.0, 'b': 0.0}, 'b': {'a': 0.0, 'b': 1.0}}
    """
    return {name: dict(zip(names, row, strict=True)) for name, row in zip(names, matrix.tolist(), strict=True)}
