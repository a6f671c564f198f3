//! Rows of numbers as numpy arrays that own the rows' memory.

use numpy::{Element, IntoPyArray as _, PyArray1, PyArray2, PyArrayMethods as _};
use pyo3::prelude::*;

/// Rows of `K` numbers, shape (n, K).
pub(crate) fn rows<T: Element, const K: usize>(py: Python<'_>, rows: Vec<[T; K]>) -> PyResult<Bound<'_, PyArray2<T>>> {
    let n = rows.len();
    rows.into_flattened().into_pyarray(py).reshape([n, K])
}

/// Numbers, shape (n,).
pub(crate) fn numbers<T: Element>(py: Python<'_>, numbers: Vec<T>) -> Bound<'_, PyArray1<T>> {
    numbers.into_pyarray(py)
}

/// JSON text as Python objects.
pub(crate) fn json<'py>(py: Python<'py>, text: &str) -> PyResult<Bound<'py, PyAny>> {
    py.import("json")?.call_method1("loads", (text,))
}
