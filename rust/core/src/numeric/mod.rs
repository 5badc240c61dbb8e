//! What any method may need: vector lanes, quadrature, linear algebra, exact signs, budgets of work.

pub(crate) mod budget;
pub mod dense;
pub(crate) mod lanes;
pub mod quadrature;
pub(crate) mod quasi_newton;
pub mod sparse;
pub mod ssvd;
pub(crate) mod triangle_sign;
pub(crate) mod tridiagonal;
