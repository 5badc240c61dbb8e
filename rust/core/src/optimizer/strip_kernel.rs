//! Energy, gradient and products with the Hessian of one strip by sum factorisation.
//!
//! Values go from points to nodes and back one direction after the other.

mod matrix;

use crate::distortion::{self, HessianKind};
use crate::numeric::lanes::{Lanes, Vectorizable, WIDTH, fused, vectorized};
use crate::optimizer::axis::Axis;
use crate::optimizer::elements::{Nodes, Strip};
use matrix::sweep_matrix;

/// Packed index of the symmetric second derivatives by (component, direction) pairs.
const PACKED: [[usize; 4]; 4] = distortion::PACKED;

/// What is differentiated, and at which parameters.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Parameters {
    /// Factor of all Jacobians.
    pub scale: f64,
    /// Regularisation ε.
    pub eps: f64,
    /// Weight λ of the area term.
    pub lambda: f64,
    /// Power p of the energy density, relative to its least value: for p = 1 the energy is the mean distortion, for
    /// large p its p-th root nears the largest.
    pub power: u32,
}

/// `(e / e₀)^p` and its first two derivatives by e, where e₀ = 2 + 2 λ is the least that e can be.
#[inline(always)]
fn raised(e: Lanes, at: &Parameters) -> (Lanes, Lanes, Lanes) {
    let least = 1.0 / (2.0 + 2.0 * at.lambda);
    let ratio = least * e;
    let mut below = Lanes::splat(1.0);
    for _ in 0..at.power - 2 {
        below = below * ratio;
    }
    let (p, first) = (f64::from(at.power), below * ratio);
    (first * ratio, p * least * first, p * (p - 1.0) * least * least * below)
}

/// Energy, smallest and mean determinant.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Summary {
    pub energy: f64,
    pub min_det: f64,
    /// Weighted sum of the determinants: their mean, summed over all strips.
    pub mean_det: f64,
}

/// Which derivatives are wanted.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Order {
    Energy,
    Gradient,
    /// Gradient of the Dirichlet energy `‖A‖² / 2` instead.
    Dirichlet,
    /// The exact Hessian times a direction, as a gradient.
    Product,
    Hessian(HessianKind),
    /// The Laplacian's scalar matrix on the reference map instead of the energy.
    Stiffness,
}

/// Memory and results of one strip; kept from one evaluation to the next.
#[derive(Default)]
pub(crate) struct Buffers {
    fields: Vec<f64>,
    by_node: Vec<f64>,
    pending: Vec<f64>,
    /// Gradient of function (i, j), `[j * n_u + i]`.
    pub gradient: Vec<[f64; 2]>,
    /// `[(((j * n) + dj) * n_u + i) * (2 m - 1) + di + m - 1) * components + cd]`: functions (i, j), (i + di, j + dj),
    /// n and m functions a span in the second and first direction; components 4 (c * 2 + d) or 1.
    pub rows: Vec<f64>,
}

/// What is evaluated on one strip, and where.
pub(crate) struct StripKernel<'a> {
    pub strip: &'a Strip,
    pub nodes: &'a Nodes,
    pub axes: &'a [Axis],
    pub x: &'a [[f64; 2]],
    /// For [`Order::Product`], else empty.
    pub direction: &'a [[f64; 2]],
    pub parameters: Parameters,
    pub order: Order,
    pub buffers: &'a mut Buffers,
}

impl StripKernel<'_> {
    /// Evaluate on the best vector unit of this machine.
    pub fn evaluate(self) -> Summary {
        vectorized(self)
    }

    fn u(&self) -> &Axis {
        &self.axes[self.nodes.u]
    }

    fn v(&self) -> &Axis {
        &self.axes[self.nodes.v]
    }
}

impl Vectorizable for StripKernel<'_> {
    type Output = Summary;

    #[inline(always)]
    fn run<const FUSED: bool>(self) -> Summary {
        if self.strip.weights.is_empty() { sweep::<FUSED, false>(self) } else { sweep::<FUSED, true>(self) }
    }
}

/// Evaluate a polynomial strip, or a rational one.
#[inline(always)]
fn sweep<const FUSED: bool, const RATIONAL: bool>(mut e: StripKernel) -> Summary {
    match e.order {
        Order::Energy => {
            interpolate::<FUSED, RATIONAL>(&mut e);
            sweep_energy::<FUSED, RATIONAL>(&mut e)
        }
        Order::Gradient | Order::Dirichlet | Order::Product => {
            interpolate::<FUSED, RATIONAL>(&mut e);
            let out = match e.order {
                Order::Gradient => sweep_gradient::<FUSED, RATIONAL, ENERGY>(&mut e),
                Order::Dirichlet => sweep_gradient::<FUSED, RATIONAL, DIRICHLET>(&mut e),
                _ => sweep_gradient::<FUSED, RATIONAL, PRODUCT>(&mut e),
            };
            collect_gradient::<FUSED, RATIONAL>(&mut e);
            out
        }
        Order::Hessian(kind) => {
            interpolate::<FUSED, RATIONAL>(&mut e);
            sweep_matrix::<FUSED, RATIONAL, 4>(&mut e, kind);
            Summary { energy: 0.0, min_det: 0.0, mean_det: 0.0 }
        }
        Order::Stiffness => {
            sweep_matrix::<FUSED, RATIONAL, 1>(&mut e, HessianKind::Exact);
            Summary { energy: 0.0, min_det: 0.0, mean_det: 0.0 }
        }
    }
}

fn cleared(buffer: &mut Vec<f64>, length: usize) -> &mut [f64] {
    buffer.clear();
    buffer.resize(length, 0.0);
    buffer
}

/// What [`sweep_gradient`] gives: the energy's gradient, the Dirichlet energy's, or the Hessian times the direction.
const ENERGY: u8 = 0;
const DIRICHLET: u8 = 1;
const PRODUCT: u8 = 2;

/// Coordinates and their derivatives in the first direction at its nodes, for every row of functions; after those of
/// the map those of the direction, if there is one. Of a rational strip those of the weighted points.
#[inline(always)]
fn interpolate<const FUSED: bool, const RATIONAL: bool>(e: &mut StripKernel) {
    let (u, columns) = (&e.axes[e.nodes.u], e.nodes.columns);
    let [n_u, n_v] = e.strip.shape;
    let maps = if e.direction.is_empty() { 1 } else { 2 };
    let fields = cleared(&mut e.buffers.fields, maps * 4 * n_v * columns);
    for (map, to) in [e.x, e.direction].into_iter().zip(fields.chunks_exact_mut(4 * n_v * columns)) {
        for j in 0..n_v {
            let points = &e.strip.points[j * n_u..][..n_u];
            for node in 0..u.nodes() {
                let first = u.first[node / u.per_span];
                let mut sum = [0.0; 4];
                for a in 0..u.n {
                    let [mut x, mut y] = map[points[first + a] as usize];
                    if RATIONAL {
                        let w = e.strip.weights[j * n_u + first + a];
                        (x, y) = (w * x, w * y);
                    }
                    let (value, slope) = (u.values[node * u.n + a], u.slopes[node * u.n + a]);
                    sum[0] = fused::<FUSED>(slope, x, sum[0]);
                    sum[1] = fused::<FUSED>(value, x, sum[1]);
                    sum[2] = fused::<FUSED>(slope, y, sum[2]);
                    sum[3] = fused::<FUSED>(value, y, sum[3]);
                }
                for k in 0..4 {
                    to[(k * n_v + j) * columns + node] = sum[k];
                }
            }
        }
    }
}

/// Add the Jacobian at eight nodes of a row of a map that was interpolated: the first, or the second.
#[inline(always)]
fn add_jacobian<const FUSED: bool, const RATIONAL: bool>(
    e: &StripKernel,
    map: usize,
    row: usize,
    column: usize,
    mut j: [Lanes; 4],
) -> [Lanes; 4] {
    let (v, columns, n_v) = (e.v(), e.nodes.columns, e.strip.shape[1]);
    let first = v.first[row / v.per_span];
    let fields = &e.buffers.fields[map * 4 * n_v * columns..];
    let mut point = [Lanes::ZERO; 2];
    for b in 0..v.n {
        let (value, slope) = (v.values[row * v.n + b], v.slopes[row * v.n + b]);
        let field = |k: usize| Lanes::load(&fields[(k * n_v + first + b) * columns + column..]);
        j[0] = j[0].add_product::<FUSED>(value, field(0));
        j[1] = j[1].add_product::<FUSED>(slope, field(1));
        j[2] = j[2].add_product::<FUSED>(value, field(2));
        j[3] = j[3].add_product::<FUSED>(slope, field(3));
        if RATIONAL {
            point[0] = point[0].add_product::<FUSED>(value, field(1));
            point[1] = point[1].add_product::<FUSED>(value, field(3));
        }
    }
    if RATIONAL {
        let [alpha, beta_u, beta_v] = quotient(e, row, column);
        j = [
            alpha * j[0] - beta_u * point[0],
            alpha * j[1] - beta_v * point[0],
            alpha * j[2] - beta_u * point[1],
            alpha * j[3] - beta_v * point[1],
        ];
    }
    j
}

/// α, β_u and β_v of the quotient rule at eight nodes of a row of a rational strip.
#[inline(always)]
fn quotient(e: &StripKernel, row: usize, column: usize) -> [Lanes; 3] {
    let plane = |k: usize| Lanes::load(&e.nodes.quotient[(row * 3 + k) * e.nodes.columns + column..]);
    [plane(0), plane(1), plane(2)]
}

/// `J T` for Jacobians.
#[inline(always)]
fn relative(j: &[Lanes; 4], t: &[Lanes; 4]) -> [Lanes; 4] {
    [
        j[0] * t[0] + j[1] * t[2],
        j[0] * t[1] + j[1] * t[3],
        j[2] * t[0] + j[3] * t[2],
        j[2] * t[1] + j[3] * t[3],
    ]
}

/// Inverse of the reference Jacobian times the scale, weight, and `A` at eight nodes of a row.
#[inline(always)]
fn at_nodes<const FUSED: bool, const RATIONAL: bool>(
    e: &StripKernel,
    row: usize,
    column: usize,
) -> ([Lanes; 4], Lanes, [Lanes; 4]) {
    let columns = e.nodes.columns;
    let base = if e.nodes.base.is_empty() {
        [Lanes::ZERO; 4]
    } else {
        let base = |k: usize| Lanes::load(&e.nodes.base[(row * 4 + k) * columns + column..]);
        [base(0), base(1), base(2), base(3)]
    };
    let j = add_jacobian::<FUSED, RATIONAL>(e, 0, row, column, base);
    let plane = |k: usize| Lanes::load(&e.nodes.planes[(row * 5 + k) * columns + column..]);
    let s = e.parameters.scale;
    let t = [s * plane(0), s * plane(1), s * plane(2), s * plane(3)];
    (t, plane(4), relative(&j, &t))
}

/// Running sums over the nodes.
struct Totals {
    energy: Lanes,
    min_det: Lanes,
    mean_det: Lanes,
}

impl Totals {
    #[inline(always)]
    fn new() -> Self {
        Self { energy: Lanes::ZERO, min_det: Lanes::splat(f64::INFINITY), mean_det: Lanes::ZERO }
    }

    #[inline(always)]
    fn add(&mut self, weight: Lanes, energy: Lanes, det: Lanes) {
        self.energy = self.energy + weight * energy;
        self.mean_det = self.mean_det + weight * det;
        self.min_det = self.min_det.min(weight.where_positive(det, Lanes::splat(f64::INFINITY)));
    }

    #[inline(always)]
    fn summary(&self) -> Summary {
        Summary { energy: self.energy.sum(), min_det: self.min_det.least(), mean_det: self.mean_det.sum() }
    }
}

/// Hessian of the density, raised to its power, with respect to the entries of `A`.
#[inline(always)]
fn hessian(a: &[Lanes; 4], at: &Parameters, kind: HessianKind) -> [Lanes; 10] {
    let mut h = distortion::hessian(a, at.eps, at.lambda, kind);
    if at.power > 1 {
        let (energy, _, g) = distortion::gradient(a, at.eps, at.lambda);
        let (_, slope, bend) = raised(energy, at);
        // What is added is semidefinite: a projected Hessian stays so.
        for i in 0..4 {
            for j in i..4 {
                h[PACKED[i][j]] = slope * h[PACKED[i][j]] + bend * g[i] * g[j];
            }
        }
    }
    h
}

#[inline(always)]
fn sweep_energy<const FUSED: bool, const RATIONAL: bool>(e: &mut StripKernel) -> Summary {
    let Parameters { eps, lambda, power, .. } = e.parameters;
    let mut totals = Totals::new();
    for row in 0..e.v().nodes() {
        for column in (0..e.nodes.columns).step_by(WIDTH) {
            let (_, w, a) = at_nodes::<FUSED, RATIONAL>(e, row, column);
            let (mut energy, det) = distortion::energy(&a, eps, lambda);
            if power > 1 {
                energy = raised(energy, &e.parameters).0;
            }
            totals.add(w, energy, det);
        }
    }
    totals.summary()
}

/// Energy, and its derivatives by the fields (`buffers.by_node`), or what else `WHAT` asks for.
#[inline(always)]
fn sweep_gradient<const FUSED: bool, const RATIONAL: bool, const WHAT: u8>(e: &mut StripKernel) -> Summary {
    let Parameters { eps, lambda, power, .. } = e.parameters;
    let (columns, n_v) = (e.nodes.columns, e.strip.shape[1]);
    let mut by_field = std::mem::take(&mut e.buffers.by_node);
    cleared(&mut by_field, 4 * n_v * columns);
    let mut totals = Totals::new();
    for row in 0..e.v().nodes() {
        for column in (0..columns).step_by(WIDTH) {
            let (t, w, a) = at_nodes::<FUSED, RATIONAL>(e, row, column);
            let (energy, det, g) = match WHAT {
                ENERGY if power > 1 => {
                    let (energy, det, g) = distortion::gradient(&a, eps, lambda);
                    let (energy, slope, _) = raised(energy, &e.parameters);
                    (energy, det, g.map(|g| slope * g))
                }
                ENERGY => distortion::gradient(&a, eps, lambda),
                DIRICHLET => (Lanes::ZERO, Lanes::ZERO, a),
                _ => {
                    let moved = add_jacobian::<FUSED, RATIONAL>(e, 1, row, column, [Lanes::ZERO; 4]);
                    let h = hessian(&a, &e.parameters, HessianKind::Exact);
                    (Lanes::ZERO, Lanes::ZERO, times(&h, &relative(&moved, &t)))
                }
            };
            totals.add(w, energy, det);
            // dE/dJ = dE/dA Tᵀ.
            let mut by_j = [
                w * (g[0] * t[0] + g[1] * t[1]),
                w * (g[0] * t[2] + g[1] * t[3]),
                w * (g[2] * t[0] + g[3] * t[1]),
                w * (g[2] * t[2] + g[3] * t[3]),
            ];
            // By the weighted points: what their values count for, besides their derivatives.
            let mut by_point = [Lanes::ZERO; 2];
            if RATIONAL {
                let [alpha, beta_u, beta_v] = quotient(e, row, column);
                by_point = [
                    Lanes::ZERO - (beta_u * by_j[0] + beta_v * by_j[1]),
                    Lanes::ZERO - (beta_u * by_j[2] + beta_v * by_j[3]),
                ];
                by_j = [alpha * by_j[0], alpha * by_j[1], alpha * by_j[2], alpha * by_j[3]];
            }
            let v = e.v();
            let first = v.first[row / v.per_span];
            for b in 0..v.n {
                let factors = [v.values[row * v.n + b], v.slopes[row * v.n + b]];
                for k in 0..4 {
                    let to = &mut by_field[(k * n_v + first + b) * columns + column..];
                    let mut sum = Lanes::load(to).add_product::<FUSED>(factors[k % 2], by_j[k]);
                    if RATIONAL && k % 2 == 1 {
                        sum = sum.add_product::<FUSED>(factors[0], by_point[k / 2]);
                    }
                    sum.store(to);
                }
            }
        }
    }
    e.buffers.by_node = by_field;
    totals.summary()
}

/// Packed symmetric matrix times vector.
#[inline(always)]
fn times(h: &[Lanes; 10], d: &[Lanes; 4]) -> [Lanes; 4] {
    let row = |i: usize| {
        let [p, q, r, s] = PACKED[i];
        h[p] * d[0] + h[q] * d[1] + h[r] * d[2] + h[s] * d[3]
    };
    [row(0), row(1), row(2), row(3)]
}

#[inline(always)]
fn collect_gradient<const FUSED: bool, const RATIONAL: bool>(e: &mut StripKernel) {
    let (u, columns) = (&e.axes[e.nodes.u], e.nodes.columns);
    let [n_u, n_v] = e.strip.shape;
    e.buffers.gradient.clear();
    e.buffers.gradient.resize(n_u * n_v, [0.0; 2]);
    for j in 0..n_v {
        let to = &mut e.buffers.gradient[j * n_u..][..n_u];
        for node in 0..u.nodes() {
            let by_field = |k: usize| e.buffers.by_node[(k * n_v + j) * columns + node];
            let d = [by_field(0), by_field(1), by_field(2), by_field(3)];
            let first = u.first[node / u.per_span];
            for a in 0..u.n {
                let (value, slope) = (u.values[node * u.n + a], u.slopes[node * u.n + a]);
                let g = &mut to[first + a];
                g[0] = fused::<FUSED>(slope, d[0], fused::<FUSED>(value, d[1], g[0]));
                g[1] = fused::<FUSED>(slope, d[2], fused::<FUSED>(value, d[3], g[1]));
            }
        }
    }
    if RATIONAL {
        for (g, w) in e.buffers.gradient.iter_mut().zip(&e.strip.weights) {
            *g = [w * g[0], w * g[1]];
        }
    }
}
