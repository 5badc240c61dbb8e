//! The numerical core of patchtransfer: pure Rust, no Python.
//!
//! One file per published method or data structure; `rust/py` only converts. A folder uses those above it only:
//!
//! | folder           | what                                                          | uses                             |
//! |------------------|---------------------------------------------------------------|----------------------------------|
//! | [`numeric`]      | vector lanes, quadrature, linear algebra, budgets             |                                  |
//! | [`spline`]       | bases, Bézier extraction, quality, Galerkin matrices          | `numeric`                        |
//! | [`location`]     | points of the plane found in patches                          | `spline`                         |
//! | [`outline`]      | closed chains of curves by arc length                         | `numeric`, `spline`              |
//! | [`distortion`]   | the energy of a 2×2 Jacobian and its derivatives              | `numeric`                        |
//! | [`proof`]        | injectivity of patches, simple loops                          | `numeric`, `spline`              |
//! | [`registration`] | matching of sequences, inner distances, thin plates           | `numeric`                        |
//! | [`fitting`]      | orthogonal distance fit of boundary sides                     | `numeric`, `spline`, `outline`   |
//! | [`mesh`]         | triangulation, maps of triangle meshes                        | `numeric`, `distortion`          |
//! | [`layout`]       | layouts of a domain from its outline alone                    | `numeric`, `mesh`                |
//! | [`continuity`]   | maps that satisfy rows across patches                         | `numeric`                        |
//! | [`optimizer`]    | projected Newton on the control points of a multi-patch       | `numeric`, `spline`, `distortion`|

pub mod continuity;
pub mod distortion;
pub mod fitting;
pub mod layout;
pub mod location;
pub mod mesh;
pub mod numeric;
pub mod optimizer;
pub mod outline;
pub mod proof;
pub mod registration;
pub mod spline;
