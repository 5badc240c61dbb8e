//! The Python module `patchtransfer._core`: converts arguments, releases the GIL, maps errors. No algorithms.

use pyo3::prelude::*;

mod certificate;
mod convert;
mod correspondence;
mod mesh;
mod optimizer;
mod spline;
mod threads;

#[pymodule(name = "_core")]
fn core_module(m: &Bound<'_, PyModule>) -> PyResult<()> {
    m.add_function(wrap_pyfunction!(threads::set_threads, m)?)?;
    m.add("__version__", env!("CARGO_PKG_VERSION"))?;
    optimizer::register(m)?;
    certificate::register(m)?;
    mesh::register(m)?;
    spline::register(m)?;
    correspondence::register(m)?;
    Ok(())
}
