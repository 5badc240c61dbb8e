//! Energy, gradient and Hessian of one strip by sum factorisation.
//!
//! Values go from points to nodes and back one direction after the other. The Hessian is contracted row of functions
//! by row of functions: what several spans of the second direction add to a pair of rows is gathered before the first
//! direction is touched, which a span at a time would do over and over.

use crate::distortion::{self, HessianKind};
use crate::numeric::lanes::{Lanes, Vectorizable, WIDTH, fused, vectorized};
use crate::optimizer::axis::Axis;
use crate::optimizer::elements::{Nodes, Strip};

/// Packed index of the symmetric second derivatives by (component, direction) pairs.
const PACKED: [[usize; 4]; 4] = distortion::PACKED;

/// Pairs of functions contracted together: few enough to stay in registers.
const TOGETHER: usize = 3;

/// What is differentiated, and at which parameters.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Parameters {
    /// Factor of all Jacobians.
    pub scale: f64,
    /// Regularisation ε.
    pub eps: f64,
    /// Weight λ of the area term.
    pub lambda: f64,
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
    fn run<const FUSED: bool>(mut self) -> Summary {
        match self.order {
            Order::Energy => {
                interpolate::<FUSED>(&mut self);
                sweep_energy::<FUSED>(&mut self)
            }
            Order::Gradient | Order::Dirichlet => {
                interpolate::<FUSED>(&mut self);
                let out = if self.order == Order::Gradient {
                    sweep_gradient::<FUSED, false>(&mut self)
                } else {
                    sweep_gradient::<FUSED, true>(&mut self)
                };
                collect_gradient::<FUSED>(&mut self);
                out
            }
            Order::Hessian(kind) => {
                interpolate::<FUSED>(&mut self);
                sweep_matrix::<FUSED, 4>(&mut self, kind);
                Summary { energy: 0.0, min_det: 0.0, mean_det: 0.0 }
            }
            Order::Stiffness => {
                sweep_matrix::<FUSED, 1>(&mut self, HessianKind::Exact);
                Summary { energy: 0.0, min_det: 0.0, mean_det: 0.0 }
            }
        }
    }
}

fn cleared(buffer: &mut Vec<f64>, length: usize) -> &mut [f64] {
    buffer.clear();
    buffer.resize(length, 0.0);
    buffer
}

/// Coordinates and their derivatives in the first direction at its nodes, for every row of functions.
#[inline(always)]
fn interpolate<const FUSED: bool>(e: &mut StripKernel) {
    let (u, columns) = (&e.axes[e.nodes.u], e.nodes.columns);
    let [n_u, n_v] = e.strip.shape;
    let fields = cleared(&mut e.buffers.fields, 4 * n_v * columns);
    for j in 0..n_v {
        let points = &e.strip.points[j * n_u..][..n_u];
        for node in 0..u.nodes() {
            let first = u.first[node / u.per_span];
            let mut sum = [0.0; 4];
            for a in 0..u.n {
                let [x, y] = e.x[points[first + a] as usize];
                let (value, slope) = (u.values[node * u.n + a], u.slopes[node * u.n + a]);
                sum[0] = fused::<FUSED>(slope, x, sum[0]);
                sum[1] = fused::<FUSED>(value, x, sum[1]);
                sum[2] = fused::<FUSED>(slope, y, sum[2]);
                sum[3] = fused::<FUSED>(value, y, sum[3]);
            }
            for k in 0..4 {
                fields[(k * n_v + j) * columns + node] = sum[k];
            }
        }
    }
}

/// Inverse of the reference Jacobian times the scale, weight, and `A` at eight nodes of a row.
#[inline(always)]
fn at_nodes<const FUSED: bool>(
    e: &StripKernel,
    row: usize,
    column: usize,
) -> ([Lanes; 4], Lanes, [Lanes; 4]) {
    let (v, columns, n_v) = (e.v(), e.nodes.columns, e.strip.shape[1]);
    let first = v.first[row / v.per_span];
    let mut j = if e.nodes.base.is_empty() {
        [Lanes::ZERO; 4]
    } else {
        let base = |k: usize| Lanes::load(&e.nodes.base[(row * 4 + k) * columns + column..]);
        [base(0), base(1), base(2), base(3)]
    };
    for b in 0..v.n {
        let (value, slope) = (v.values[row * v.n + b], v.slopes[row * v.n + b]);
        let field = |k: usize| Lanes::load(&e.buffers.fields[(k * n_v + first + b) * columns + column..]);
        j[0] = j[0].add_product::<FUSED>(value, field(0));
        j[1] = j[1].add_product::<FUSED>(slope, field(1));
        j[2] = j[2].add_product::<FUSED>(value, field(2));
        j[3] = j[3].add_product::<FUSED>(slope, field(3));
    }
    let plane = |k: usize| Lanes::load(&e.nodes.planes[(row * 5 + k) * columns + column..]);
    let s = e.parameters.scale;
    let t = [s * plane(0), s * plane(1), s * plane(2), s * plane(3)];
    let a = [
        j[0] * t[0] + j[1] * t[2],
        j[0] * t[1] + j[1] * t[3],
        j[2] * t[0] + j[3] * t[2],
        j[2] * t[1] + j[3] * t[3],
    ];
    (t, plane(4), a)
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

#[inline(always)]
fn sweep_energy<const FUSED: bool>(e: &mut StripKernel) -> Summary {
    let Parameters { eps, lambda, .. } = e.parameters;
    let mut totals = Totals::new();
    for row in 0..e.v().nodes() {
        for column in (0..e.nodes.columns).step_by(WIDTH) {
            let (_, w, a) = at_nodes::<FUSED>(e, row, column);
            let (energy, det) = distortion::energy(&a, eps, lambda);
            totals.add(w, energy, det);
        }
    }
    totals.summary()
}

/// Energy, and its derivatives by the fields (`buffers.by_node`).
#[inline(always)]
fn sweep_gradient<const FUSED: bool, const DIRICHLET: bool>(e: &mut StripKernel) -> Summary {
    let Parameters { eps, lambda, .. } = e.parameters;
    let (columns, n_v) = (e.nodes.columns, e.strip.shape[1]);
    let mut by_field = std::mem::take(&mut e.buffers.by_node);
    cleared(&mut by_field, 4 * n_v * columns);
    let mut totals = Totals::new();
    for row in 0..e.v().nodes() {
        for column in (0..columns).step_by(WIDTH) {
            let (t, w, a) = at_nodes::<FUSED>(e, row, column);
            let (energy, det, g) =
                if DIRICHLET { (Lanes::ZERO, Lanes::ZERO, a) } else { distortion::gradient(&a, eps, lambda) };
            totals.add(w, energy, det);
            // dE/dJ = dE/dA Tᵀ.
            let by_j = [
                w * (g[0] * t[0] + g[1] * t[1]),
                w * (g[0] * t[2] + g[1] * t[3]),
                w * (g[2] * t[0] + g[3] * t[1]),
                w * (g[2] * t[2] + g[3] * t[3]),
            ];
            let v = e.v();
            let first = v.first[row / v.per_span];
            for b in 0..v.n {
                let factors = [v.values[row * v.n + b], v.slopes[row * v.n + b]];
                for k in 0..4 {
                    let to = &mut by_field[(k * n_v + first + b) * columns + column..];
                    Lanes::load(to).add_product::<FUSED>(factors[k % 2], by_j[k]).store(to);
                }
            }
        }
    }
    e.buffers.by_node = by_field;
    totals.summary()
}

#[inline(always)]
fn collect_gradient<const FUSED: bool>(e: &mut StripKernel) {
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
}

/// Second derivatives by the Jacobian's entries at eight nodes, packed.
#[inline(always)]
fn second_derivatives<const FUSED: bool>(
    e: &StripKernel,
    kind: HessianKind,
    row: usize,
    column: usize,
) -> [Lanes; 10] {
    let (t, w, a) = at_nodes::<FUSED>(e, row, column);
    let h = distortion::hessian(&a, e.parameters.eps, e.parameters.lambda, kind);
    // T H Tᵀ for a pair of components.
    let turned = |h00: Lanes, h01: Lanes, h10: Lanes, h11: Lanes| {
        let (r00, r01) = (t[0] * h00 + t[1] * h10, t[0] * h01 + t[1] * h11);
        let (r10, r11) = (t[2] * h00 + t[3] * h10, t[2] * h01 + t[3] * h11);
        [r00 * t[0] + r01 * t[1], r00 * t[2] + r01 * t[3], r10 * t[0] + r11 * t[1], r10 * t[2] + r11 * t[3]]
    };
    let xx = turned(h[0], h[1], h[1], h[4]);
    let xy = turned(h[2], h[3], h[5], h[6]);
    let yy = turned(h[7], h[8], h[8], h[9]);
    let mut out = [xx[0], xx[1], xy[0], xy[1], xx[3], xy[2], xy[3], yy[0], yy[1], yy[3]];
    for v in &mut out {
        *v = w * *v;
    }
    out
}

/// `w T Tᵀ`: the Laplacian's coefficients.
#[inline(always)]
fn metric(e: &StripKernel, row: usize, column: usize) -> [Lanes; 3] {
    let plane = |k: usize| Lanes::load(&e.nodes.planes[(row * 5 + k) * e.nodes.columns + column..]);
    let (t, w) = ([plane(0), plane(1), plane(2), plane(3)], plane(4));
    [w * (t[0] * t[0] + t[1] * t[1]), w * (t[0] * t[2] + t[1] * t[3]), w * (t[2] * t[2] + t[3] * t[3])]
}

/// Where the coefficient of components `cd` and derivatives `kl` stands among those of a node.
#[inline(always)]
fn coefficient<const COMPONENTS: usize>(cd: usize, kl: usize) -> usize {
    if COMPONENTS == 4 { PACKED[cd / 2 * 2 + kl / 2][cd % 2 * 2 + kl % 2] } else { [0, 1, 1, 2][kl] }
}

/// Matrix of the energy (`COMPONENTS` = 4) or of the Laplacian (1), into `buffers.rows`.
#[inline(always)]
fn sweep_matrix<const FUSED: bool, const COMPONENTS: usize>(e: &mut StripKernel, kind: HessianKind) {
    let (columns, [n_u, n_v]) = (e.nodes.columns, e.strip.shape);
    let (n, per_span, spans) = (e.v().n, e.v().per_span, e.v().first.len());
    let width = 2 * e.u().n - 1;
    let stored = if COMPONENTS == 4 { 10 } else { 3 };
    let mut by_node = std::mem::take(&mut e.buffers.by_node);
    let mut pending = std::mem::take(&mut e.buffers.pending);
    let mut rows = std::mem::take(&mut e.buffers.rows);
    cleared(&mut by_node, stored * per_span * columns);
    cleared(&mut pending, n * n * 4 * COMPONENTS * columns);
    cleared(&mut rows, n_v * n * n_u * width * COMPONENTS);
    for span in 0..spans {
        for q in 0..per_span {
            for column in (0..columns).step_by(WIDTH) {
                let row = span * per_span + q;
                if COMPONENTS == 4 {
                    for (k, h) in second_derivatives::<FUSED>(e, kind, row, column).into_iter().enumerate() {
                        h.store(&mut by_node[(k * per_span + q) * columns + column..]);
                    }
                } else {
                    for (k, h) in metric(e, row, column).into_iter().enumerate() {
                        h.store(&mut by_node[(k * per_span + q) * columns + column..]);
                    }
                }
            }
        }
        contract_second::<FUSED, COMPONENTS>(e.v(), span, columns, &by_node, &mut pending);
        let done = if span + 1 < spans { e.v().first[span + 1] } else { n_v };
        for j in e.v().first[span]..done {
            for dj in 0..n.min(n_v - j) {
                let length = 4 * COMPONENTS * columns;
                let from = &mut pending[((j % n) * n + dj) * length..][..length];
                let to = &mut rows[(j * n + dj) * n_u * width * COMPONENTS..][..n_u * width * COMPONENTS];
                match e.u().padded {
                    12 => contract_first::<FUSED, COMPONENTS, 12>(e.u(), columns, from, to),
                    16 => contract_first::<FUSED, COMPONENTS, 8>(e.u(), columns, from, to),
                    _ => contract_first::<FUSED, COMPONENTS, 4>(e.u(), columns, from, to),
                }
                from.fill(0.0);
            }
        }
    }
    (e.buffers.by_node, e.buffers.pending, e.buffers.rows) = (by_node, pending, rows);
}

/// Sum over the nodes of a span of the second direction, for every pair of its functions.
#[inline(always)]
fn contract_second<const FUSED: bool, const COMPONENTS: usize>(
    v: &Axis,
    span: usize,
    columns: usize,
    by_node: &[f64],
    pending: &mut [f64],
) {
    let (n, per_span, first) = (v.n, v.per_span, v.first[span]);
    let n_pairs = n * (n + 1) / 2;
    for kl in 0..4 {
        let weights = &v.pairs[(span * 4 + kl) * n_pairs * per_span..][..n_pairs * per_span];
        for cd in 0..COMPONENTS {
            let from =
                &by_node[coefficient::<COMPONENTS>(cd, kl) * per_span * columns..][..per_span * columns];
            let channel = (cd * 4 + kl) * columns;
            let (mut b, mut db) = (0, 0);
            for pair in (0..n_pairs).step_by(TOGETHER) {
                let count = TOGETHER.min(n_pairs - pair);
                let mut to = [0; TOGETHER];
                for slot in to.iter_mut().take(count) {
                    *slot = (((first + b) % n) * n + db) * 4 * COMPONENTS * columns + channel;
                    db += 1;
                    if b + db == n {
                        (b, db) = (b + 1, 0);
                    }
                }
                for column in (0..columns).step_by(WIDTH) {
                    if count == TOGETHER {
                        let mut sum = [Lanes::ZERO; TOGETHER];
                        for k in 0..TOGETHER {
                            sum[k] = Lanes::load(&pending[to[k] + column..]);
                        }
                        for q in 0..per_span {
                            let h = Lanes::load(&from[q * columns + column..]);
                            for k in 0..TOGETHER {
                                sum[k] = sum[k].add_product::<FUSED>(weights[(pair + k) * per_span + q], h);
                            }
                        }
                        for k in 0..TOGETHER {
                            sum[k].store(&mut pending[to[k] + column..]);
                        }
                    } else {
                        for (k, &at) in to.iter().enumerate().take(count) {
                            let mut sum = Lanes::load(&pending[at + column..]);
                            for q in 0..per_span {
                                let h = Lanes::load(&from[q * columns + column..]);
                                sum = sum.add_product::<FUSED>(weights[(pair + k) * per_span + q], h);
                            }
                            sum.store(&mut pending[at + column..]);
                        }
                    }
                }
            }
        }
    }
}

/// Sum over the nodes of the first direction, for every pair of its functions; `CHUNK` products at a time.
#[inline(always)]
fn contract_first<const FUSED: bool, const COMPONENTS: usize, const CHUNK: usize>(
    u: &Axis,
    columns: usize,
    from: &[f64],
    to: &mut [f64],
) {
    let (n, per_span, padded) = (u.n, u.per_span, u.padded);
    let width = 2 * n - 1;
    for (span, &first) in u.first.iter().enumerate() {
        for start in (0..padded).step_by(CHUNK) {
            let mut sum = [[0.0; CHUNK]; COMPONENTS];
            for node in span * per_span..(span + 1) * per_span {
                for kl in 0..4 {
                    let products = &u.products[(node * 4 + kl) * padded + start..];
                    let products = products.first_chunk::<CHUNK>().expect("padded");
                    for cd in 0..COMPONENTS {
                        let value = from[(cd * 4 + kl) * columns + node];
                        for k in 0..CHUNK {
                            sum[cd][k] = fused::<FUSED>(value, products[k], sum[cd][k]);
                        }
                    }
                }
            }
            for k in 0..CHUNK.min((n * n).saturating_sub(start)) {
                let (a, b) = ((start + k) / n, (start + k) % n);
                let at = ((first + a) * width + b + n - 1 - a) * COMPONENTS;
                for cd in 0..COMPONENTS {
                    to[at + cd] += sum[cd][k];
                }
            }
        }
    }
}
