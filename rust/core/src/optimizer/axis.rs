//! One parameter direction: spline bases at given nodes, laid out for sum factorisation.

use crate::spline::basis_on_span;

/// Basis functions and derivatives at single nodes, each in the span named with it.
pub(crate) struct Sampling {
    /// Functions on a span: degree + 1.
    pub n: usize,
    /// First function of every node's span.
    pub first: Vec<usize>,
    /// `values[node * n + function]`.
    pub values: Vec<f64>,
    /// Derivatives, laid out like the values.
    pub slopes: Vec<f64>,
}

impl Sampling {
    /// At nodes `(t, span)`, the span as index into the knots.
    pub fn new(knots: &[f64], degree: usize, nodes: &[(f64, usize)]) -> Self {
        let (m, n) = (nodes.len(), degree + 1);
        let (mut values, mut slopes) = (vec![0.0; m * n], vec![0.0; m * n]);
        for (i, &(t, span)) in nodes.iter().enumerate() {
            basis_on_span(knots, degree, span, t, &mut values[i * n..][..n], &mut slopes[i * n..][..n]);
        }
        Self { n, first: nodes.iter().map(|&(_, span)| span - degree).collect(), values, slopes }
    }
}

/// Parametric derivatives `[x_u, x_v, y_u, y_v]` of a net (`[i * n_v + j]`) on a grid of nodes, `[j * m_u + i]`.
pub(crate) fn jacobians(u: &Sampling, v: &Sampling, net: &[[f64; 2]], n_v: usize) -> Vec<[f64; 4]> {
    let (m_u, m_v) = (u.first.len(), v.first.len());
    let mut out = vec![[0.0; 4]; m_u * m_v];
    let mut half = vec![[0.0; 4]; n_v];
    let (low, high) = (v.first.iter().min().copied(), v.first.iter().max().copied());
    let range = low.unwrap_or(0)..high.unwrap_or(0) + v.n;
    for i in 0..m_u {
        half[range.clone()].fill([0.0; 4]);
        for a in 0..u.n {
            let (value, slope) = (u.values[i * u.n + a], u.slopes[i * u.n + a]);
            let row = &net[(u.first[i] + a) * n_v..][..n_v];
            for (h, [x, y]) in half[range.clone()].iter_mut().zip(&row[range.clone()]) {
                h[0] += slope * x;
                h[1] += value * x;
                h[2] += slope * y;
                h[3] += value * y;
            }
        }
        for j in 0..m_v {
            let to = &mut out[j * m_u + i];
            for b in 0..v.n {
                let (value, slope) = (v.values[j * v.n + b], v.slopes[j * v.n + b]);
                let h = &half[v.first[j] + b];
                to[0] += value * h[0];
                to[1] += slope * h[1];
                to[2] += value * h[2];
                to[3] += slope * h[3];
            }
        }
    }
    out
}

/// Jacobian of a rational map as `[x_u, x_v, y_u, y_v]`, and how it comes from that of the weighted points: for a net
/// of weighted points with values `h` and derivatives `h_k`, `J_k = α h_k - β_k h`.
pub(crate) struct RationalPoint {
    pub jacobian: [f64; 4],
    /// `[α, β_u, β_v]`: 1 by the sum of weights, and its derivatives by its square.
    pub quotient: [f64; 3],
}

/// The same as [`jacobians`] with weights.
pub(crate) fn rational_jacobians(
    u: &Sampling,
    v: &Sampling,
    net: &[[f64; 2]],
    weights: &[f64],
    n_v: usize,
) -> Vec<RationalPoint> {
    let (m_u, m_v) = (u.first.len(), v.first.len());
    let mut out = Vec::with_capacity(m_u * m_v);
    for j in 0..m_v {
        for i in 0..m_u {
            // Weighted points and weights: values, derivatives by u, by v.
            let mut h = [[0.0; 3]; 3];
            for a in 0..u.n {
                for b in 0..v.n {
                    let at = (u.first[i] + a) * n_v + v.first[j] + b;
                    let (w, [x, y]) = (weights[at], net[at]);
                    let (value_u, slope_u) = (u.values[i * u.n + a], u.slopes[i * u.n + a]);
                    let (value_v, slope_v) = (v.values[j * v.n + b], v.slopes[j * v.n + b]);
                    let factors = [value_u * value_v, slope_u * value_v, value_u * slope_v];
                    for (h, factor) in h.iter_mut().zip(factors) {
                        *h = [h[0] + factor * w * x, h[1] + factor * w * y, h[2] + factor * w];
                    }
                }
            }
            let [[x, y, w], of_u, of_v] = h;
            let (alpha, beta) = (1.0 / w, [of_u[2] / (w * w), of_v[2] / (w * w)]);
            out.push(RationalPoint {
                jacobian: [
                    alpha * of_u[0] - beta[0] * x,
                    alpha * of_v[0] - beta[1] * x,
                    alpha * of_u[1] - beta[0] * y,
                    alpha * of_v[1] - beta[1] * y,
                ],
                quotient: [alpha, beta[0], beta[1]],
            });
        }
    }
    out
}

/// The span that sees `t` among all `spans` of the knots: the one that ends there for the last node of a span, else the
/// one that holds it.
pub(crate) fn span_of(knots: &[f64], spans: &[usize], t: f64, from_below: bool) -> usize {
    let before = spans.partition_point(|&s| if from_below { knots[s] < t } else { knots[s] <= t });
    spans[before.max(1) - 1]
}

/// What an axis is for: only the tables of its direction are made, which are most of it.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(crate) enum Direction {
    First,
    Second,
}

/// Some consecutive spans of a direction, with the same number of nodes each.
pub(crate) struct Axis {
    /// Functions on a span: degree + 1.
    pub n: usize,
    /// Nodes of a span.
    pub per_span: usize,
    /// First function of every span, counted from the first of the axis.
    pub first: Vec<usize>,
    /// Number of functions that live on the axis.
    pub functions: usize,
    /// `values[node * n + function]`.
    pub values: Vec<f64>,
    /// Derivatives, laid out like the values.
    pub slopes: Vec<f64>,
    /// Length of one product table: n² rounded up to a multiple of four.
    pub padded: usize,
    /// `products[(node * 4 + kl) * padded + a * n + b]`, k, l in {derivative = 0, value = 1}: first direction.
    pub products: Vec<f64>,
    /// `pairs[((span * 4 + kl) * n_pairs + pair) * per_span + q]`, k, l in {value = 0, derivative = 1}, pairs
    /// a ≤ b in order: second direction, where a derivative of the first is a value.
    pub pairs: Vec<f64>,
}

impl Axis {
    /// At the `nodes` of the `spans`, span after span.
    pub fn new(knots: &[f64], degree: usize, spans: &[usize], nodes: &[f64], direction: Direction) -> Self {
        let (n, per_span) = (degree + 1, nodes.len() / spans.len());
        let at: Vec<(f64, usize)> =
            nodes.iter().enumerate().map(|(i, &t)| (t, spans[i / per_span])).collect();
        let Sampling { values, slopes, .. } = Sampling::new(knots, degree, &at);
        let padded = (n * n).next_multiple_of(4);
        let first_direction = direction == Direction::First;
        let mut products = vec![0.0; if first_direction { nodes.len() * 4 * padded } else { 0 }];
        for node in (0..nodes.len()).filter(|_| first_direction) {
            let tables = [&slopes[node * n..][..n], &values[node * n..][..n]];
            for kl in 0..4 {
                for ab in 0..n * n {
                    products[(node * 4 + kl) * padded + ab] = tables[kl / 2][ab / n] * tables[kl % 2][ab % n];
                }
            }
        }
        let mut pairs = vec![];
        for span in (0..spans.len()).filter(|_| !first_direction) {
            for kl in 0..4 {
                for a in 0..n {
                    for b in a..n {
                        pairs.extend((span * per_span..(span + 1) * per_span).map(|node| {
                            let tables = [&values[node * n..][..n], &slopes[node * n..][..n]];
                            tables[kl / 2][a] * tables[kl % 2][b]
                        }));
                    }
                }
            }
        }
        let first: Vec<usize> = spans.iter().map(|s| s - spans[0]).collect();
        let functions = first[spans.len() - 1] + n;
        Self { n, per_span, first, functions, values, slopes, padded, products, pairs }
    }

    /// Number of nodes.
    pub fn nodes(&self) -> usize {
        self.first.len() * self.per_span
    }

    /// Whether functions `a` and `b` share a span.
    pub fn overlap(&self, a: usize, b: usize) -> bool {
        let (low, high) = (a.min(b), a.max(b));
        // The last span that `low` lives on is the one that reaches farthest.
        self.first.iter().rev().find(|&&f| f <= low).is_some_and(|&f| high < f + self.n)
    }
}
