//! The matrix of one strip: Hessian of the energy, or the Laplacian.
//!
//! It is contracted row of functions by row of functions: what several spans of the second direction add to a pair of
//! rows is gathered before the first direction is touched, which a span at a time would do over and over.

use super::{PACKED, StripKernel, at_nodes, cleared};
use crate::distortion::{self, HessianKind};
use crate::numeric::lanes::{Lanes, WIDTH, fused};
use crate::optimizer::axis::Axis;

/// Pairs of functions contracted together: few enough to stay in registers.
const TOGETHER: usize = 3;

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
pub(super) fn sweep_matrix<const FUSED: bool, const COMPONENTS: usize>(
    e: &mut StripKernel,
    kind: HessianKind,
) {
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
