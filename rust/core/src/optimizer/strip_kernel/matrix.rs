//! The matrix of one strip: Hessian of the energy, or the Laplacian.
//!
//! It is contracted row of functions by row of functions: what several spans of the second direction add to a pair of
//! rows is gathered before the first direction is touched, which a span at a time would do over and over.

use super::{PACKED, StripKernel, at_nodes, cleared, hessian, quotient};
use crate::distortion::HessianKind;
use crate::numeric::lanes::{Lanes, WIDTH, fused};
use crate::optimizer::axis::Axis;

/// Pairs of functions contracted together: few enough to stay in registers.
const TOGETHER: usize = 3;

/// Second derivatives by the Jacobian's entries at eight nodes, packed.
#[inline(always)]
fn second_derivatives<const FUSED: bool, const RATIONAL: bool>(
    e: &StripKernel,
    kind: HessianKind,
    row: usize,
    column: usize,
) -> [Lanes; 10] {
    let (t, w, a) = at_nodes::<FUSED, RATIONAL>(e, row, column);
    let h = hessian(&a, &e.parameters, kind);
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

/// Derivatives and value by which the weighted points' functions enter: the Jacobian's entries are `α ∂_k - β_k`. From
/// the coefficients of pairs of derivatives those of pairs of derivatives and values, rows of an upper triangle: of
/// `size` components 3 `size` entries each way.
#[inline(always)]
fn with_values<const STORED: usize>(
    e: &StripKernel,
    row: usize,
    column: usize,
    size: usize,
    h: impl Fn(usize, usize) -> Lanes,
) -> [Lanes; STORED] {
    let [alpha, beta_u, beta_v] = quotient(e, row, column);
    let beta = [beta_u, beta_v];
    let mut out = [Lanes::ZERO; STORED];
    let mut at = 0;
    for i in 0..3 * size {
        for j in i..3 * size {
            let ((c, k), (d, l)) = ((2 * (i / 3), i % 3), (2 * (j / 3), j % 3));
            out[at] = match (k, l) {
                (2, 2) => {
                    beta[0] * (beta[0] * h(c, d) + beta[1] * h(c, d + 1))
                        + beta[1] * (beta[0] * h(c + 1, d) + beta[1] * h(c + 1, d + 1))
                }
                (2, l) => Lanes::ZERO - alpha * (beta[0] * h(c, d + l) + beta[1] * h(c + 1, d + l)),
                (k, 2) => Lanes::ZERO - alpha * (beta[0] * h(c + k, d) + beta[1] * h(c + k, d + 1)),
                (k, l) => alpha * alpha * h(c + k, d + l),
            };
            at += 1;
        }
    }
    out
}

/// Where the coefficient of components `cd` and the kinds `k`, `l` of derivatives (and 2, the value, of a rational
/// strip) stands among those of a node.
#[inline(always)]
fn coefficient<const RATIONAL: bool, const COMPONENTS: usize>(cd: usize, k: usize, l: usize) -> usize {
    if !RATIONAL {
        return if COMPONENTS == 4 {
            PACKED[cd / 2 * 2 + k][cd % 2 * 2 + l]
        } else {
            [0, 1, 1, 2][2 * k + l]
        };
    }
    let (n, i, j) = if COMPONENTS == 4 { (6, cd / 2 * 3 + k, cd % 2 * 3 + l) } else { (3, k, l) };
    let (i, j) = (i.min(j), i.max(j));
    i * (2 * n - i - 1) / 2 + j
}

/// Matrix of the energy (`COMPONENTS` = 4) or of the Laplacian (1), into `buffers.rows`.
#[inline(always)]
pub(super) fn sweep_matrix<const FUSED: bool, const RATIONAL: bool, const COMPONENTS: usize>(
    e: &mut StripKernel,
    kind: HessianKind,
) {
    let (columns, [n_u, n_v]) = (e.nodes.columns, e.strip.shape);
    let (n, per_span, spans) = (e.v().n, e.v().per_span, e.v().first.len());
    let width = 2 * e.u().n - 1;
    let stored = match (COMPONENTS, RATIONAL) {
        (4, false) => 10,
        (4, true) => 21,
        (_, false) => 3,
        (_, true) => 6,
    };
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
                let mut store =
                    |k: usize, h: Lanes| h.store(&mut by_node[(k * per_span + q) * columns + column..]);
                if COMPONENTS == 4 {
                    let h = second_derivatives::<FUSED, RATIONAL>(e, kind, row, column);
                    if RATIONAL {
                        let all = with_values::<21>(e, row, column, 2, |i, j| h[PACKED[i][j]]);
                        all.into_iter().enumerate().for_each(|(k, h)| store(k, h));
                    } else {
                        h.into_iter().enumerate().for_each(|(k, h)| store(k, h));
                    }
                } else {
                    let h = metric(e, row, column);
                    if RATIONAL {
                        let all = with_values::<6>(e, row, column, 1, |i, j| h[i + j]);
                        all.into_iter().enumerate().for_each(|(k, h)| store(k, h));
                    } else {
                        h.into_iter().enumerate().for_each(|(k, h)| store(k, h));
                    }
                }
            }
        }
        contract_second::<FUSED, RATIONAL, COMPONENTS>(e.v(), span, columns, &by_node, &mut pending);
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
    if RATIONAL {
        weigh(e, COMPONENTS, &mut rows);
    }
    (e.buffers.by_node, e.buffers.pending, e.buffers.rows) = (by_node, pending, rows);
}

/// From weighted points to points: every pair of functions times both weights.
fn weigh(e: &StripKernel, components: usize, rows: &mut [f64]) {
    let ([n_u, n_v], n, back) = (e.strip.shape, e.v().n, e.u().n - 1);
    let weights = &e.strip.weights;
    for (at, block) in rows.chunks_exact_mut(components).enumerate() {
        let (line, di) = (at / (2 * back + 1), at % (2 * back + 1));
        let (i, j, dj) = (line % n_u, line / n_u / n, line / n_u % n);
        // Places beside the strip are empty.
        if i + di >= back && i + di - back < n_u && j + dj < n_v {
            let factor = weights[j * n_u + i] * weights[(j + dj) * n_u + i + di - back];
            block.iter_mut().for_each(|x| *x *= factor);
        }
    }
}

/// Sum over the nodes of a span of the second direction, for every pair of its functions.
#[inline(always)]
fn contract_second<const FUSED: bool, const RATIONAL: bool, const COMPONENTS: usize>(
    v: &Axis,
    span: usize,
    columns: usize,
    by_node: &[f64],
    pending: &mut [f64],
) {
    let (n, per_span, first) = (v.n, v.per_span, v.first[span]);
    let n_pairs = n * (n + 1) / 2;
    let kinds = if RATIONAL { 3 } else { 2 };
    for kind in 0..kinds * kinds {
        let (k, l) = (kind / kinds, kind % kinds);
        // The value is one in both directions: in the second like a derivative of the first, and the other way round.
        let (in_second, kl) = (2 * (k % 2) + l % 2, 2 * k.min(1) + l.min(1));
        let weights = &v.pairs[(span * 4 + in_second) * n_pairs * per_span..][..n_pairs * per_span];
        for cd in 0..COMPONENTS {
            let from = &by_node[coefficient::<RATIONAL, COMPONENTS>(cd, k, l) * per_span * columns..]
                [..per_span * columns];
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
