//! Knot spans of a multi-patch gathered in strips, with the reference map at their nodes.
//!
//! A strip is a few spans of a patch in the first direction by all its spans in the second (or a single additional
//! node): wide enough for vector units, small enough for the cache, and the unit of parallel work.

use crate::numeric::lanes::WIDTH;
use crate::numeric::quadrature::{gauss, lobatto};
use crate::optimizer::axis::{Axis, Direction, Sampling, jacobians, rational_jacobians, span_of};
use crate::spline::{SplinePatch, spans};
use thiserror::Error;

/// Spans of a strip in the first direction at most.
const STRIP: usize = 8;

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

/// An additional node, (patch, u, v).
pub type ExtraNode = (usize, f64, f64);

/// Part of a patch: which points its functions belong to.
pub(crate) struct Strip {
    pub patch: usize,
    /// Functions in the first and second direction.
    pub shape: [usize; 2],
    /// Point of function (i, j), `[j * shape[0] + i]`.
    pub points: Vec<u32>,
    /// Weight of function (i, j), relative to the patch's largest; empty for a polynomial patch.
    pub weights: Vec<f64>,
}

/// Nodes of a strip under one quadrature rule.
#[derive(Clone)]
pub(crate) struct Nodes {
    /// Index of the axes, of which strips of a patch share the second.
    pub u: usize,
    pub v: usize,
    /// Nodes in a row, rounded up to whole [`crate::numeric::lanes::Lanes`].
    pub columns: usize,
    /// `[(row * 5 + k) * columns + column]`: k < 4 the inverse of the reference Jacobian row by row, k = 4 the
    /// weight; all zero where a node is left out or only fills up.
    pub planes: Vec<f64>,
    /// `[(row * 3 + k) * columns + column]`: α, β_u, β_v of the quotient rule, see [`crate::optimizer::axis::RationalPoint`]; empty for a
    /// polynomial patch.
    pub quotient: Vec<f64>,
    /// `[(row * 4 + k) * columns + column]`: Jacobian of the map that is added to; empty for none.
    pub base: Vec<f64>,
}

/// A spline space to move points in: the knots of every patch and the points its functions belong to.
pub(crate) struct Space<'a> {
    pub knots: &'a [[Vec<f64>; 2]],
    /// Per patch, function (i, j) at `[i * n_v + j]`.
    pub indices: &'a [Vec<u32>],
}

/// All strips of a multi-patch.
pub struct Elements {
    pub(crate) axes: Vec<Axis>,
    pub(crate) strips: Vec<Strip>,
    /// Gauss–Lobatto nodes of the strips: energy, gradient, determinants, and by default the Hessian.
    pub(crate) nodes: Vec<Nodes>,
    /// Other nodes for the Hessian.
    pub(crate) hessian_nodes: Option<Vec<Nodes>>,
    /// Nodes of the axes in the spline space of the reference map.
    samplings: Vec<Sampling>,
}

/// Quadrature of one direction: nodes and weights on [-1, 1].
type Rule = (Vec<f64>, Vec<f64>);

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
        let knots: Vec<[Vec<f64>; 2]> = reference.iter().map(|p| p.knots.clone()).collect();
        let space = Space { knots: &knots, indices };
        Self::on_space(reference, &space, nodes_per_span, extra, excluded)
    }

    /// Like [`Self::new`] for movements in a coarser spline space.
    pub(crate) fn on_space(
        reference: &[SplinePatch],
        space: &Space,
        nodes_per_span: impl Fn(usize) -> usize,
        extra: &[ExtraNode],
        excluded: &[(usize, usize)],
    ) -> Result<Self, ElementError> {
        let mut out = Self::empty();
        for (k, patch) in reference.iter().enumerate() {
            let rule = |degree: usize| lobatto(nodes_per_span(degree));
            let ends: [[f64; 2]; 2] =
                std::array::from_fn(|a| [patch.knots[a][0], patch.knots[a][patch.knots[a].len() - 1]]);
            let skip = |u: f64, v: f64| {
                let end = |axis: usize, t: f64| ends[axis].iter().position(|&e| e == t);
                end(0, u).zip(end(1, v)).is_some_and(|(cu, cv)| excluded.contains(&(k, cu + 2 * cv)))
            };
            out.push_patch(patch, k, space, rule, skip)?;
        }
        let weights = |nodes: &[Nodes]| -> (f64, usize) {
            let rows =
                nodes.iter().flat_map(|n| n.planes.chunks_exact(5 * n.columns).map(|r| &r[4 * n.columns..]));
            rows.flatten().fold((0.0, 0), |(sum, count), &w| (sum + w, count + usize::from(w > 0.0)))
        };
        let (total, used) = weights(&out.nodes);
        let extra_weight = 0.3 * total / used.max(1) as f64;
        for &(k, u, v) in extra {
            let patch = &reference[k];
            let span = |axis: usize, t: f64| {
                let knots = &space.knots[k][axis];
                span_of(knots, &spans(knots, patch.degrees[axis]), t, false)
            };
            let second = out.push_axis(patch, k, space, Direction::Second, &[span(1, v)], &[v]);
            out.push(patch, k, space, [&[span(0, u)], &[span(1, v)]], [&[u], &[v]], second, |_, _, _| {
                extra_weight
            })?;
        }
        let (total, _) = weights(&out.nodes);
        out.nodes.iter_mut().for_each(|n| n.scale_weights(1.0 / total));
        Ok(out)
    }

    /// Integrate the Hessian on fewer, Gauss–Legendre nodes: `degree + 1` a span and direction.
    pub(crate) fn use_gauss_hessian(&mut self, reference: &[SplinePatch], space: &Space) {
        let mut other = Self::empty();
        for (k, patch) in reference.iter().enumerate() {
            // Singular where no Lobatto node is: such a node is left out, the energy decides.
            let rule = |degree: usize| gauss(degree + 1);
            if other.push_patch(patch, k, space, rule, |_, _| false).is_err() {
                return;
            }
        }
        let sum = |nodes: &[Nodes]| -> f64 {
            nodes
                .iter()
                .flat_map(|n| n.planes.chunks_exact(5 * n.columns).map(|r| &r[4 * n.columns..]))
                .flatten()
                .sum()
        };
        let factor = sum(&self.nodes[..other.nodes.len()]) / sum(&other.nodes);
        let shift = self.axes.len();
        let mut nodes = other.nodes;
        for n in &mut nodes {
            n.scale_weights(factor);
            (n.u, n.v) = (n.u + shift, n.v + shift);
        }
        nodes.extend_from_slice(&self.nodes[nodes.len()..]);
        self.axes.extend(other.axes);
        self.hessian_nodes = Some(nodes);
        self.samplings.extend(other.samplings);
    }

    fn empty() -> Self {
        Self { axes: vec![], strips: vec![], nodes: vec![], hessian_nodes: None, samplings: vec![] }
    }

    fn push_patch(
        &mut self,
        patch: &SplinePatch,
        k: usize,
        space: &Space,
        rule: impl Fn(usize) -> Rule,
        skip: impl Fn(f64, f64) -> bool,
    ) -> Result<(), ElementError> {
        let [(spans_u, u, wu), (spans_v, v, wv)] = std::array::from_fn(|axis| {
            let (knots, degree) = (&space.knots[k][axis], patch.degrees[axis]);
            let (x, w) = rule(degree);
            let list = spans(knots, degree);
            let (mut nodes, mut weights) = (vec![], vec![]);
            for &s in &list {
                let (a, b) = (knots[s], knots[s + 1]);
                // End nodes are the knots themselves, to the bit.
                let place = |&x: &f64| match x {
                    -1.0 => a,
                    1.0 => b,
                    _ => 0.5 * ((a + b) + (b - a) * x),
                };
                nodes.extend(x.iter().map(place));
                weights.extend(w.iter().map(|w| 0.5 * (b - a) * w));
            }
            (list, nodes, weights)
        });
        let second = self.push_axis(patch, k, space, Direction::Second, &spans_v, &v);
        let (per_u, strips) = (u.len() / spans_u.len(), spans_u.len().div_ceil(STRIP));
        for s in 0..strips {
            let (from, to) = (s * spans_u.len() / strips, (s + 1) * spans_u.len() / strips);
            let (nodes, offset) = (&u[from * per_u..to * per_u], from * per_u);
            let weight = |i: usize, j: usize, det: f64| {
                if skip(nodes[i], v[j]) { 0.0 } else { wu[offset + i] * wv[j] * det.abs() }
            };
            self.push(patch, k, space, [&spans_u[from..to], &spans_v], [nodes, &v], second, weight)?;
        }
        Ok(())
    }

    /// Add an axis with its nodes, for as many strips as use it.
    fn push_axis(
        &mut self,
        patch: &SplinePatch,
        k: usize,
        space: &Space,
        direction: Direction,
        on: &[usize],
        nodes: &[f64],
    ) -> usize {
        let axis = usize::from(direction == Direction::Second);
        let (knots, degree, per_span) = (&space.knots[k][axis], patch.degrees[axis], nodes.len() / on.len());
        let all = spans(&patch.knots[axis], degree);
        let place = |(i, &t): (usize, &f64)| {
            let from_below = t == knots[on[i / per_span] + 1] && per_span > 1;
            (t, span_of(&patch.knots[axis], &all, t, from_below))
        };
        let at: Vec<(f64, usize)> = nodes.iter().enumerate().map(place).collect();
        self.samplings.push(Sampling::new(&patch.knots[axis], degree, &at));
        self.axes.push(Axis::new(knots, degree, on, nodes, direction));
        self.axes.len() - 1
    }

    /// Add a strip with its nodes and its second axis; `weight(i, j, det J)` is 0 for nodes to be left out.
    #[allow(clippy::too_many_arguments)]
    fn push(
        &mut self,
        patch: &SplinePatch,
        k: usize,
        space: &Space,
        spans: [&[usize]; 2],
        nodes: [&[f64]; 2],
        second: usize,
        weight: impl Fn(usize, usize, f64) -> f64,
    ) -> Result<(), ElementError> {
        let first = self.push_axis(patch, k, space, Direction::First, spans[0], nodes[0]);
        let samplings = [first, second].map(|axis| &self.samplings[axis]);
        let (m, columns) = (nodes[0].len(), nodes[0].len().next_multiple_of(WIDTH));
        let relative = relative_weights(patch);
        let mut quotient = vec![0.0; if relative.is_empty() { 0 } else { nodes[1].len() * 3 * columns }];
        let reference = if relative.is_empty() {
            jacobians(samplings[0], samplings[1], &patch.points, patch.shape[1])
        } else {
            let found =
                rational_jacobians(samplings[0], samplings[1], &patch.points, &relative, patch.shape[1]);
            for (at, point) in found.iter().enumerate() {
                for plane in 0..3 {
                    quotient[((at / m) * 3 + plane) * columns + at % m] = point.quotient[plane];
                }
            }
            found.into_iter().map(|point| point.jacobian).collect()
        };
        let mut planes = vec![0.0; nodes[1].len() * 5 * columns];
        for (at, &[a, b, c, d]) in reference.iter().enumerate() {
            let (i, j) = (at % m, at / m);
            let det = a * d - b * c;
            let w = weight(i, j, det);
            let singular = det.abs() <= 1e-14 * ((a * a + c * c) * (b * b + d * d)).sqrt();
            if singular && weight(i, j, 1.0) > 0.0 {
                let (u, v) = (nodes[0][i], nodes[1][j]);
                return Err(ElementError::SingularReference { patch: k, u, v, det });
            }
            if w > 0.0 {
                for (plane, value) in [d / det, -b / det, -c / det, a / det, w].into_iter().enumerate() {
                    planes[(j * 5 + plane) * columns + i] = value;
                }
            }
        }
        let (u, v) = (&self.axes[first], &self.axes[second]);
        let n_v = space.knots[k][1].len() - patch.degrees[1] - 1;
        let corner = [spans[0][0] - patch.degrees[0], spans[1][0] - patch.degrees[1]];
        let mut points = Vec::with_capacity(u.functions * v.functions);
        let mut weights = vec![];
        for j in 0..v.functions {
            let at = |i: usize| (corner[0] + i) * n_v + corner[1] + j;
            points.extend((0..u.functions).map(|i| space.indices[k][at(i)]));
            if !relative.is_empty() {
                weights.extend((0..u.functions).map(|i| relative[at(i)]));
            }
        }
        self.strips.push(Strip { patch: k, shape: [u.functions, v.functions], points, weights });
        self.nodes.push(Nodes { u: first, v: second, columns, planes, quotient, base: vec![] });
        Ok(())
    }

    /// Move on top of the map with the points `x` of the reference's own space (`indices` per patch).
    pub(crate) fn set_base(&mut self, reference: &[SplinePatch], indices: &[Vec<u32>], x: &[[f64; 2]]) {
        let nets: Vec<Vec<[f64; 2]>> =
            indices.iter().map(|list| list.iter().map(|&i| x[i as usize]).collect()).collect();
        let (strips, samplings) = (&self.strips, &self.samplings);
        for list in [Some(&mut self.nodes), self.hessian_nodes.as_mut()].into_iter().flatten() {
            for (strip, nodes) in strips.iter().zip(list) {
                let (u, v) = (&samplings[nodes.u], &samplings[nodes.v]);
                let (m, k) = (u.first.len(), strip.patch);
                nodes.base.clear();
                nodes.base.resize(v.first.len() * 4 * nodes.columns, 0.0);
                for (at, j) in jacobians(u, v, &nets[k], reference[k].shape[1]).iter().enumerate() {
                    for plane in 0..4 {
                        nodes.base[((at / m) * 4 + plane) * nodes.columns + at % m] = j[plane];
                    }
                }
            }
        }
    }

    /// Give the memory of [`Self::set_base`] back until it is called again.
    pub(crate) fn drop_base(&mut self) {
        for nodes in [Some(&mut self.nodes), self.hessian_nodes.as_mut()].into_iter().flatten().flatten() {
            nodes.base = vec![];
        }
    }

    /// Number of strips.
    pub(crate) fn len(&self) -> usize {
        self.strips.len()
    }
}

/// Weights of a patch by the largest, which leaves the map as it is; none for a polynomial patch.
fn relative_weights(patch: &SplinePatch) -> Vec<f64> {
    let weights = patch.weights.as_deref().unwrap_or_default();
    let largest = weights.iter().fold(0.0, |m: f64, &w| m.max(w));
    weights.iter().map(|w| w / largest).collect()
}

impl Nodes {
    fn scale_weights(&mut self, factor: f64) {
        let columns = self.columns;
        for row in self.planes.chunks_exact_mut(5 * columns) {
            row[4 * columns..].iter_mut().for_each(|w| *w *= factor);
        }
    }
}
