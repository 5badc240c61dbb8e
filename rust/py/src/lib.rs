//! The Python module `patchtransfer._core`: converts arguments, releases the GIL, maps errors. No algorithms.

use pyo3::prelude::*;

mod boundary_fit;
mod certificate;
mod convert;
mod correspondence;
mod dense;
mod galerkin;
mod layout;
mod mesh;
mod mesh_map;
mod optimizer;
mod outline;
mod quality;
mod spline;
mod threads;

#[pymodule(name = "_core")]
fn core_module(m: &Bound<'_, PyModule>) -> PyResult<()> {
    m.add_function(wrap_pyfunction!(threads::set_threads, m)?)?;
    m.add("__version__", env!("CARGO_PKG_VERSION"))?;
    boundary_fit::register(m)?;
    optimizer::register(m)?;
    outline::register(m)?;
    certificate::register(m)?;
    galerkin::register(m)?;
    layout::register(m)?;
    mesh::register(m)?;
    mesh_map::register(m)?;
    quality::register(m)?;
    spline::register(m)?;
    correspondence::register(m)?;
    dense::register(m)?;
    Ok(())
}
