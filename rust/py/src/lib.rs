//! The Python module `patchtransfer._core`: converts arguments, releases the GIL, maps errors. No algorithms.

use pyo3::prelude::*;

mod certificate;
mod convert;
mod optimizer;
mod mesh;
mod spline;

#[pymodule(name = "_core")]
fn core_module(m: &Bound<'_, PyModule>) -> PyResult<()> {
    m.add("__version__", env!("CARGO_PKG_VERSION"))?;
    optimizer::register(m)?;
    certificate::register(m)?;
    mesh::register(m)?;
    spline::register(m)?;
    Ok(())
}
