//! Knot spans of a multi-patch as elements: sum-factorised Jacobians, gradients and Hessians at their nodes.
//!
//! The tensor structure is used inside every element: interpolation and its transpose run one direction after the
//! other, which costs a third of the plain triple loop for bicubic patches.

use crate::quadrature::lobatto;
use crate::spline::{SplinePatch, basis_on_span, spans};
use rayon::prelude::*;
use thiserror::Error;

/// Why elements cannot be built.
#[derive(Debug, Error, Clone, PartialEq)]
pub enum ElementError {
    /// The reference map is singular or folded at a node, so distortion relative to it is undefined.
    #[error("the reference map of patch {patch} is singular at (u, v) = ({u}, {v}): det J = {det:e}")]
    SingularReference {
        /// Patch index.
        patch: usize,
        /// First parameter.
        u: f64,
        /// Second parameter.
        v: f64,
        /// Determinant found there.
        det: f64,
    },
}

/// Basis functions and derivatives at the nodes of one span (or at one extra node) in one direction.
struct Table {
    /// Number of nodes.
    m: usize,
    /// Functions that live on the span: degree + 1.
    n: usize,
    /// `values[node * n + function]`.
    values: Vec<f64>,
    /// Derivatives, laid out like the values.
    slopes: Vec<f64>,
    /// `products[kl][node * n * n + a * n + b]` with k, l in {derivative = 0, value = 1} for functions a, b.
    products: [Vec<f64>; 4],
}

impl Table {
    fn new(knots: &[f64], degree: usize, span: usize, nodes: &[f64]) -> Self {
        let (m, n) = (nodes.len(), degree + 1);
        let (mut values, mut slopes) = (vec![0.0; m * n], vec![0.0; m * n]);
        for (i, &t) in nodes.iter().enumerate() {
            basis_on_span(knots, degree, span, t, &mut values[i * n..][..n], &mut slopes[i * n..][..n]);
        }
        let product = |x: &[f64], y: &[f64]| -> Vec<f64> {
            (0..m * n * n).map(|k| x[k / (n * n) * n + k / n % n] * y[k / (n * n) * n + k % n]).collect()
        };
        let products = [
            product(&slopes, &slopes),
            product(&slopes, &values),
            product(&values, &slopes),
            product(&values, &values),
        ];
        Self { m, n, values, slopes, products }
    }
}

/// One knot span (or one extra node) of a patch.
struct Element {
    table_u: usize,
    table_v: usize,
    /// Offset of its `n_u * n_v` point indices.
    points: usize,
    /// Offset of its nodes, `[j * m_u + i]`.
    nodes: usize,
}

/// Reference data of a node: the inverse of the reference Jacobian, row-major, and the weight (0: left out).
#[derive(Clone, Copy, Default)]
struct Node {
    inverse: [f64; 4],
    weight: f64,
}

/// An additional node, (patch, u, v).
pub type ExtraNode = (usize, f64, f64);

/// All elements of a multi-patch.
pub struct Elements {
    tables: Vec<Table>,
    elements: Vec<Element>,
    points: Vec<u32>,
    nodes: Vec<Node>,
}

/// Memory for the evaluation of one element.
#[derive(Default)]
pub struct Scratch {
    half: Vec<f64>,
    jacobians: Vec<[f64; 4]>,
    stage: Vec<f64>,
}

impl Elements {
    /// Elements on Gauss–Lobatto nodes, `nodes_per_span(degree)` a direction.
    ///
    /// `reference` gives knots and the map that distortion is measured against; `indices[k]` the index of every
    /// control point of patch k among the shared points. Nodes at the patch corners listed in `excluded`, pairs
    /// (patch, corner) with corner 0..4 = (0,0), (1,0), (0,1), (1,1), are left out: the map is degenerate there.
    pub fn new(
        reference: &[SplinePatch],
        indices: &[Vec<u32>],
        nodes_per_span: impl Fn(usize) -> usize,
        extra: &[ExtraNode],
        excluded: &[(usize, usize)],
    ) -> Result<Self, ElementError> {
        let mut out = Self { tables: vec![], elements: vec![], points: vec![], nodes: vec![] };
        for (k, patch) in reference.iter().enumerate() {
            let mut directions = vec![];
            for axis in 0..2 {
                let (knots, degree) = (&patch.knots[axis], patch.degrees[axis]);
                let (x, w) = lobatto(nodes_per_span(degree));
                let mut list = vec![];
                for s in spans(knots, degree) {
                    let (a, b) = (knots[s], knots[s + 1]);
                    // End nodes are the knots themselves, to the bit.
                    let mut t: Vec<f64> = x.iter().map(|x| 0.5 * ((a + b) + (b - a) * x)).collect();
                    (t[0], *t.last_mut().expect("two nodes")) = (a, b);
                    let weights: Vec<f64> = w.iter().map(|w| 0.5 * (b - a) * w).collect();
                    out.tables.push(Table::new(knots, degree, s, &t));
                    list.push((s, out.tables.len() - 1, t, weights));
                }
                directions.push(list);
            }
            for (su, table_u, tu, wu) in &directions[0] {
                for (sv, table_v, tv, wv) in &directions[1] {
                    let skip = |u: f64, v: f64| {
                        let end = |axis: usize, t: f64| {
                            let (a, b) =
                                (patch.knots[axis][0], patch.knots[axis][patch.knots[axis].len() - 1]);
                            if t == a { Some(0) } else { (t == b).then_some(1) }
                        };
                        end(0, u).zip(end(1, v)).is_some_and(|(cu, cv)| excluded.contains(&(k, cu + 2 * cv)))
                    };
                    let weight = |i: usize, j: usize| wu[i] * wv[j];
                    out.push(patch, k, &indices[k], (*su, *table_u, tu), (*sv, *table_v, tv), weight, skip)?;
                }
            }
        }
        let used = out.nodes.iter().filter(|n| n.weight > 0.0).count().max(1);
        let extra_weight = 0.3 * out.nodes.iter().map(|n| n.weight).sum::<f64>() / used as f64;
        for &(k, u, v) in extra {
            let patch = &reference[k];
            let place = |axis: usize, t: f64| {
                let (knots, degree) = (&patch.knots[axis], patch.degrees[axis]);
                *spans(knots, degree).iter().rev().find(|&&s| knots[s] <= t).unwrap_or(&degree)
            };
            let (su, sv) = (place(0, u), place(1, v));
            let tables = out.tables.len();
            out.tables.push(Table::new(&patch.knots[0], patch.degrees[0], su, &[u]));
            out.tables.push(Table::new(&patch.knots[1], patch.degrees[1], sv, &[v]));
            out.push(
                patch,
                k,
                &indices[k],
                (su, tables, &[u]),
                (sv, tables + 1, &[v]),
                |_, _| 1.0,
                |_, _| false,
            )?;
            out.nodes.last_mut().expect("just pushed").weight = extra_weight;
        }
        let total: f64 = out.nodes.iter().map(|n| n.weight).sum();
        out.nodes.iter_mut().for_each(|n| n.weight /= total);
        Ok(out)
    }

    #[allow(clippy::too_many_arguments)]
    fn push(
        &mut self,
        patch: &SplinePatch,
        k: usize,
        indices: &[u32],
        (su, table_u, tu): (usize, usize, &[f64]),
        (sv, table_v, tv): (usize, usize, &[f64]),
        weight: impl Fn(usize, usize) -> f64,
        skip: impl Fn(f64, f64) -> bool,
    ) -> Result<(), ElementError> {
        let (points, nodes) = (self.points.len(), self.nodes.len());
        let [p, q] = patch.degrees;
        let mut coefficients = Vec::with_capacity((p + 1) * (q + 1));
        for a in su - p..=su {
            for b in sv - q..=sv {
                self.points.push(indices[a * patch.shape[1] + b]);
                coefficients.push(patch.points[a * patch.shape[1] + b]);
            }
        }
        let element = Element { table_u, table_v, points, nodes };
        self.nodes.resize(nodes + tu.len() * tv.len(), Node::default());
        let mut scratch = Scratch::default();
        self.jacobians(&element, &coefficients, &mut scratch);
        for (j, &v) in tv.iter().enumerate() {
            for (i, &u) in tu.iter().enumerate() {
                if skip(u, v) {
                    continue;
                }
                let [a, b, c, d] = scratch.jacobians[j * tu.len() + i];
                let det = a * d - b * c;
                if det.abs() <= 1e-14 * ((a * a + c * c) * (b * b + d * d)).sqrt() {
                    return Err(ElementError::SingularReference { patch: k, u, v, det });
                }
                self.nodes[nodes + j * tu.len() + i] = Node {
                    inverse: [d / det, -b / det, -c / det, a / det],
                    weight: weight(i, j) * det.abs(),
                };
            }
        }
        self.elements.push(element);
        Ok(())
    }

    /// Number of elements.
    pub fn len(&self) -> usize {
        self.elements.len()
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.elements.is_empty()
    }

    /// Point indices of element `e`, functions in u slowest.
    pub fn points_of(&self, e: usize) -> &[u32] {
        let element = &self.elements[e];
        &self.points[element.points..][..self.size(element)]
    }

    /// Largest number of functions on an element.
    pub fn max_functions(&self) -> usize {
        self.elements.iter().map(|e| self.size(e)).max().unwrap_or(0)
    }

    fn size(&self, e: &Element) -> usize {
        self.tables[e.table_u].n * self.tables[e.table_v].n
    }

    /// Parametric derivatives `[x_u, x_v, y_u, y_v]` at the nodes, `[j * m_u + i]`.
    fn jacobians(&self, e: &Element, coefficients: &[[f64; 2]], scratch: &mut Scratch) {
        let (u, v) = (&self.tables[e.table_u], &self.tables[e.table_v]);
        scratch.half.clear();
        scratch.half.resize(u.m * v.n * 4, 0.0);
        for i in 0..u.m {
            for a in 0..u.n {
                let (value, slope) = (u.values[i * u.n + a], u.slopes[i * u.n + a]);
                for b in 0..v.n {
                    let [x, y] = coefficients[a * v.n + b];
                    let h = &mut scratch.half[(i * v.n + b) * 4..][..4];
                    h[0] += slope * x;
                    h[1] += value * x;
                    h[2] += slope * y;
                    h[3] += value * y;
                }
            }
        }
        scratch.jacobians.clear();
        scratch.jacobians.resize(u.m * v.m, [0.0; 4]);
        for j in 0..v.m {
            for i in 0..u.m {
                let out = &mut scratch.jacobians[j * u.m + i];
                for b in 0..v.n {
                    let (value, slope) = (v.values[j * v.n + b], v.slopes[j * v.n + b]);
                    let h = &scratch.half[(i * v.n + b) * 4..][..4];
                    out[0] += value * h[0];
                    out[1] += slope * h[1];
                    out[2] += value * h[2];
                    out[3] += slope * h[3];
                }
            }
        }
    }

    /// Call `visit(node, A, weight)` for the nodes of element `e` with `A = scale · J(x) J_reference⁻¹`.
    pub fn for_each_node(
        &self,
        e: usize,
        x: &[[f64; 2]],
        scale: f64,
        scratch: &mut Scratch,
        mut visit: impl FnMut(usize, [f64; 4], f64),
    ) {
        let element = &self.elements[e];
        let local: Vec<[f64; 2]> = self.points_of(e).iter().map(|&g| x[g as usize]).collect();
        self.jacobians(element, &local, scratch);
        for (k, j) in scratch.jacobians.iter().enumerate() {
            let node = &self.nodes[element.nodes + k];
            if node.weight > 0.0 {
                let t = node.inverse.map(|v| v * scale);
                let a = [
                    j[0] * t[0] + j[1] * t[2],
                    j[0] * t[1] + j[1] * t[3],
                    j[2] * t[0] + j[3] * t[2],
                    j[2] * t[1] + j[3] * t[3],
                ];
                visit(k, a, node.weight);
            }
        }
    }

    /// Number of nodes of element `e`, left-out ones included.
    pub fn nodes_of(&self, e: usize) -> usize {
        let element = &self.elements[e];
        self.tables[element.table_u].m * self.tables[element.table_v].m
    }

    /// Add to `out[function]` the transpose of the interpolation applied to `dE/dA` at the nodes.
    pub fn scatter_gradient(
        &self,
        e: usize,
        by_a: &[[f64; 4]],
        scale: f64,
        scratch: &mut Scratch,
        out: &mut [[f64; 2]],
    ) {
        let element = &self.elements[e];
        let (u, v) = (&self.tables[element.table_u], &self.tables[element.table_v]);
        scratch.half.clear();
        scratch.half.resize(u.m * v.n * 4, 0.0);
        for j in 0..v.m {
            for i in 0..u.m {
                let t = &self.nodes[element.nodes + j * u.m + i].inverse;
                let g = &by_a[j * u.m + i];
                // dE/dJ = dE/dA T^T.
                let d = [
                    scale * (g[0] * t[0] + g[1] * t[1]),
                    scale * (g[0] * t[2] + g[1] * t[3]),
                    scale * (g[2] * t[0] + g[3] * t[1]),
                    scale * (g[2] * t[2] + g[3] * t[3]),
                ];
                for b in 0..v.n {
                    let (value, slope) = (v.values[j * v.n + b], v.slopes[j * v.n + b]);
                    let h = &mut scratch.half[(i * v.n + b) * 4..][..4];
                    h[0] += value * d[0];
                    h[1] += slope * d[1];
                    h[2] += value * d[2];
                    h[3] += slope * d[3];
                }
            }
        }
        for i in 0..u.m {
            for a in 0..u.n {
                let (value, slope) = (u.values[i * u.n + a], u.slopes[i * u.n + a]);
                for b in 0..v.n {
                    let h = &scratch.half[(i * v.n + b) * 4..][..4];
                    out[a * v.n + b][0] += slope * h[0] + value * h[1];
                    out[a * v.n + b][1] += slope * h[2] + value * h[3];
                }
            }
        }
    }

    /// Element matrix of the Hessian from `d²E/dA²` (packed) at the nodes.
    ///
    /// `out[((b * n_v + b2) * 4 + c * 2 + d) * n_u² + a * n_u + a2]` is the entry of component c of function (a, b)
    /// with component d of function (a2, b2), filled for `b <= b2`.
    pub fn contract_hessian(
        &self,
        e: usize,
        by_aa: &[[f64; 10]],
        scale: f64,
        scratch: &mut Scratch,
        out: &mut [f64],
    ) {
        let element = &self.elements[e];
        let (u, v) = (&self.tables[element.table_u], &self.tables[element.table_v]);
        let (mu, nu2, channels) = (u.m, u.n * u.n, 16);
        // Per node: d²E/dJ² for component pairs cd and derivative pairs kl, nodes in u contiguous.
        let pairs = v.n * (v.n + 1) / 2;
        scratch.stage.clear();
        scratch.stage.resize((v.m + pairs) * channels * mu, 0.0);
        let (by_jj, stage) = scratch.stage.split_at_mut(v.m * channels * mu);
        for j in 0..v.m {
            for i in 0..mu {
                let t = self.nodes[element.nodes + j * mu + i].inverse.map(|x| x * scale);
                let h = &by_aa[j * mu + i];
                for (cd, [h00, h01, h10, h11]) in
                    [[0, 1, 1, 4], [2, 3, 5, 6], [2, 5, 3, 6], [7, 8, 8, 9]].into_iter().enumerate()
                {
                    let (h00, h01, h10, h11) = (h[h00], h[h01], h[h10], h[h11]);
                    let (r00, r01) = (t[0] * h00 + t[1] * h10, t[0] * h01 + t[1] * h11);
                    let (r10, r11) = (t[2] * h00 + t[3] * h10, t[2] * h01 + t[3] * h11);
                    let kl = [
                        r00 * t[0] + r01 * t[1],
                        r00 * t[2] + r01 * t[3],
                        r10 * t[0] + r11 * t[1],
                        r10 * t[2] + r11 * t[3],
                    ];
                    for (k, value) in kl.into_iter().enumerate() {
                        by_jj[(j * channels + cd * 4 + k) * mu + i] = value;
                    }
                }
            }
        }
        // Contract the nodes in v for every pair of functions in v ...
        let mut pair = 0;
        for b in 0..v.n {
            for b2 in b..v.n {
                for cd in 0..4 {
                    for kl in 0..4 {
                        // A derivative in u is a value in v and the other way round.
                        let weights = &v.products[3 - kl];
                        let to = &mut stage[(pair * channels + cd * 4 + kl) * mu..][..mu];
                        for j in 0..v.m {
                            let w = weights[(j * v.n + b) * v.n + b2];
                            let from = &by_jj[(j * channels + cd * 4 + kl) * mu..][..mu];
                            for i in 0..mu {
                                to[i] += w * from[i];
                            }
                        }
                    }
                }
                // ... then those in u for every pair of functions in u.
                for cd in 0..4 {
                    let to = &mut out[((b * v.n + b2) * 4 + cd) * nu2..][..nu2];
                    to.fill(0.0);
                    for kl in 0..4 {
                        let from = &stage[(pair * channels + cd * 4 + kl) * mu..][..mu];
                        for i in 0..mu {
                            let weights = &u.products[kl][i * nu2..][..nu2];
                            let s = from[i];
                            for k in 0..nu2 {
                                to[k] += s * weights[k];
                            }
                        }
                    }
                }
                pair += 1;
            }
        }
    }

    /// Number of functions (in u, in v) of element `e`.
    pub fn functions_of(&self, e: usize) -> (usize, usize) {
        let element = &self.elements[e];
        (self.tables[element.table_u].n, self.tables[element.table_v].n)
    }

    /// Smallest `det A` over all nodes, and the mean weighted like the energy.
    pub fn determinants(&self, x: &[[f64; 2]], scale: f64) -> (f64, f64) {
        let per_element: Vec<(f64, f64)> = (0..self.len())
            .into_par_iter()
            .with_min_len(16)
            .map_init(Scratch::default, |scratch, e| {
                let mut out = (f64::INFINITY, 0.0);
                self.for_each_node(e, x, scale, scratch, |_, a, w| {
                    let det = a[0] * a[3] - a[1] * a[2];
                    out = (out.0.min(det), out.1 + w * det);
                });
                out
            })
            .collect();
        per_element.into_iter().fold((f64::INFINITY, 0.0), |s, r| (s.0.min(r.0), s.1 + r.1))
    }

    /// Scalar stiffness matrix of an element, `[f * n + g]`: `Σ w ∇φ_f · ∇φ_g` on the reference map.
    pub fn stiffness(&self, e: usize, out: &mut [f64]) {
        let element = &self.elements[e];
        let (u, v) = (&self.tables[element.table_u], &self.tables[element.table_v]);
        let n = u.n * v.n;
        out[..n * n].fill(0.0);
        let mut gradients = vec![[0.0; 2]; n];
        for j in 0..v.m {
            for i in 0..u.m {
                let node = &self.nodes[element.nodes + j * u.m + i];
                if node.weight == 0.0 {
                    continue;
                }
                let t = &node.inverse;
                for a in 0..u.n {
                    for b in 0..v.n {
                        let du = u.slopes[i * u.n + a] * v.values[j * v.n + b];
                        let dv = u.values[i * u.n + a] * v.slopes[j * v.n + b];
                        gradients[a * v.n + b] = [du * t[0] + dv * t[2], du * t[1] + dv * t[3]];
                    }
                }
                for f in 0..n {
                    for g in 0..n {
                        out[f * n + g] += node.weight
                            * (gradients[f][0] * gradients[g][0] + gradients[f][1] * gradients[g][1]);
                    }
                }
            }
        }
    }
}
