//! The Python module `patchtransfer._core`: converts arguments, releases the GIL, maps errors. No algorithms.

use pyo3::exceptions::PyRuntimeError;
use pyo3::prelude::*;

mod certificate;
mod convert;
mod mesh;
mod optimizer;
mod spline;

/// Limit the core to `n` threads; possible once, before anything ran in parallel. Results do not depend on it.
#[pyfunction]
fn set_threads(n: usize) -> PyResult<()> {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(n).build_global();
    pool.map_err(|e| {
        PyRuntimeError::new_err(format!("the number of threads cannot be changed any more: {e}"))
    })
}

#[pymodule(name = "_core")]
fn core_module(m: &Bound<'_, PyModule>) -> PyResult<()> {
    m.add_function(wrap_pyfunction!(set_threads, m)?)?;
    m.add("__version__", env!("CARGO_PKG_VERSION"))?;
    optimizer::register(m)?;
    certificate::register(m)?;
    mesh::register(m)?;
    spline::register(m)?;
    Ok(())
}
