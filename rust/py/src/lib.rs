//! The Python module `patchtransfer._core`: converts arguments, releases the GIL, maps errors. No algorithms.

use pyo3::prelude::*;

mod continuity;
mod convert;
mod fitting;
mod layout;
mod location;
mod mesh;
mod numeric;
mod optimizer;
mod outline;
mod proof;
mod registration;
mod spline;
mod threads;

#[pymodule(name = "_core")]
fn core_module(m: &Bound<'_, PyModule>) -> PyResult<()> {
    m.add_function(wrap_pyfunction!(threads::set_threads, m)?)?;
    m.add("__version__", env!("CARGO_PKG_VERSION"))?;
    numeric::register(m)?;
    spline::register(m)?;
    location::register(m)?;
    outline::register(m)?;
    proof::register(m)?;
    registration::register(m)?;
    fitting::register(m)?;
    mesh::register(m)?;
    layout::register(m)?;
    continuity::register(m)?;
    optimizer::register(m)?;
    Ok(())
}
