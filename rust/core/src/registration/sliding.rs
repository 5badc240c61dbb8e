//! Matched points slide along the target's boundary until inner distances are kept best.
//!
//! Metric multidimensional scaling (least squares on distances) with the points confined to the boundary, by
//! Gauss–Newton steps. Unlike turning, uneven stretch and, if wanted, bending cost as well.

use crate::numeric::dense::Definite;
use crate::outline::{Outline, Scratch};
use crate::registration::inner_distance::{Position, compare_distances};
use crate::registration::thin_plate::add_bending;

/// Gauss–Newton steps at most, and the part of the energy that a step must win.
const STEPS: usize = 16;
const GAIN: f64 = 1e-3;
/// With bending steps go on while they move a point by more than this part of its loop, and are halved so many times
/// when they raise the energy: that slide gives the result, others only rank matchings.
const SHORT: f64 = 1e-4;
const HALVINGS: usize = 3;
/// Added to the diagonal, relative to its mean.
const DAMPING: f64 = 1e-6;
/// Step, in parts of the loop, of the differences that give the turning's slope: a tenth of its smallest window.
const DIFFERENCE: f64 = 0.002;

/// Angles between the chords that arrive at and leave the points at `s`, in parts of half a turn: row-major, one row
/// a point, one column a window. Windows are parts of the loop's length.
pub fn turning(outline: &Outline, s: &[f64], windows: &[f64]) -> Vec<f64> {
    // Points of one shift are near each other.
    let places = |shift: f64| {
        let mut scratch = Scratch::default();
        s.iter().map(|s| outline.at(s + shift * outline.length(), false, &mut scratch)).collect::<Vec<_>>()
    };
    let (here, mut out) = (places(0.0), vec![0.0; s.len() * windows.len()]);
    for (k, &window) in windows.iter().enumerate() {
        let (before, after) = (places(-window), places(window));
        for (i, p) in here.iter().enumerate() {
            let a = [p[0] - before[i][0], p[1] - before[i][1]];
            let b = [after[i][0] - p[0], after[i][1] - p[1]];
            let angle = (a[0] * b[1] - a[1] * b[0]).atan2(a[0] * b[0] + a[1] * b[1]);
            out[i * windows.len() + k] = angle / std::f64::consts::PI;
        }
    }
    out
}

/// A loop of points that slide along a loop of the target.
pub struct SlidingLoop {
    /// Increasing arc lengths of the target's nodes, less than a turn.
    pub nodes: Vec<f64>,
    /// Number of the first of them among those of all loops.
    pub first: usize,
    /// Turning that is wanted at every point, row-major, one column a window, and its weight.
    pub turning: Vec<f64>,
    /// See `turning`.
    pub turning_weight: Vec<f64>,
    /// Parts of the target loop's length from every point to the next one without stretch.
    pub part: Vec<f64>,
    /// Weight of stretch.
    pub stretch: f64,
}

/// Bending energy of a map from the plane.
pub struct Plate {
    /// See [`super::thin_plate::bending_matrix`].
    pub matrix: Vec<f64>,
    /// Orthonormal functions of the points that cost nothing.
    pub affine: Vec<Vec<f64>>,
    /// Size of the target.
    pub size: f64,
    /// Weight of the energy.
    pub weight: f64,
}

/// What positions of all points on the target cost.
pub struct Sliding {
    /// The loops, points counted on from one to the next.
    pub loops: Vec<SlidingLoop>,
    /// Row-major inner distances between all nodes of the target.
    pub distances: Vec<f64>,
    /// Row-major distances wanted between the points, and their weights; both symmetric.
    pub wanted: Vec<f64>,
    /// See `wanted`.
    pub weight: Vec<f64>,
    /// Windows of the turning, in parts of a loop.
    pub windows: Vec<f64>,
    /// Bending, if it counts.
    pub plate: Option<Plate>,
}

/// Energy, gradient and row-major Gauss–Newton matrix in the target's arc lengths.
pub struct Model {
    /// Sum of all parts.
    pub energy: f64,
    /// By the positions.
    pub gradient: Vec<f64>,
    /// Positive semidefinite.
    pub hessian: Vec<f64>,
}

impl Sliding {
    /// Number of points.
    pub fn size(&self) -> usize {
        self.loops.iter().map(|l| l.part.len()).sum()
    }

    /// Loops with their target outlines and the range of their points.
    fn parts<'a>(
        &'a self,
        outlines: &'a [&'a Outline],
    ) -> impl Iterator<Item = (&'a SlidingLoop, &'a Outline, std::ops::Range<usize>)> {
        let mut first = 0;
        self.loops.iter().zip(outlines).map(move |(l, outline)| {
            let range = first..first + l.part.len();
            first = range.end;
            (l, *outline, range)
        })
    }

    /// Energy and derivatives at arc lengths `x` on the target loops `outlines`.
    pub fn model(&self, outlines: &[&Outline], x: &[f64]) -> Model {
        let mut positions = Vec::with_capacity(x.len());
        for (l, outline, range) in self.parts(outlines) {
            positions.extend(x[range].iter().map(|&y| position(l, outline.length(), y)));
        }
        let nodes = self.distances.len().isqrt();
        let found = compare_distances(&self.distances, nodes, &positions, &self.wanted, &self.weight);
        let mut model = Model { energy: found.energy, gradient: found.gradient, hessian: found.hessian };
        for (l, outline, range) in self.parts(outlines) {
            add_stretch(l, outline.length(), x, range.clone(), &mut model);
            self.add_turning(l, outline, x, range, &mut model);
        }
        if let Some(plate) = &self.plate {
            let mut at = Vec::with_capacity(x.len());
            for (_, outline, range) in self.parts(outlines) {
                at.extend(outline.evaluate(&x[range], false));
            }
            plate.add(&at, &mut model);
        }
        model
    }

    /// Energy of unlike turning at the points.
    fn add_turning(
        &self,
        l: &SlidingLoop,
        outline: &Outline,
        x: &[f64],
        range: std::ops::Range<usize>,
        model: &mut Model,
    ) {
        let (h, n) = (DIFFERENCE * outline.length(), x.len());
        let shifted = |h: f64| x[range.clone()].iter().map(|y| y + h).collect::<Vec<_>>();
        let [low, here, high] = [-h, 0.0, h].map(|h| turning(outline, &shifted(h), &self.windows));
        let windows = self.windows.len();
        for (i, at) in range.enumerate() {
            let weight = l.turning_weight[i];
            for k in i * windows..(i + 1) * windows {
                let (residual, slope) = (here[k] - l.turning[k], (high[k] - low[k]) / (2.0 * h));
                model.energy += weight * residual * residual;
                model.gradient[at] += 2.0 * weight * residual * slope;
                model.hessian[at * n + at] += 2.0 * weight * slope * slope;
            }
        }
    }

    /// Positions after a slide from `x` with the `held` points where they are, and their energy: never above what the
    /// given ones have.
    pub fn slide(&self, outlines: &[&Outline], x: &[f64], held: &[bool]) -> (Vec<f64>, f64) {
        let (mut x, mut model) = (x.to_vec(), self.model(outlines, x));
        let halvings = if self.plate.is_some() { HALVINGS } else { 0 };
        for _ in 0..if held.iter().all(|&held| held) { 0 } else { STEPS } {
            let mut step = newton_step(&mut model, held);
            let better = (0..=halvings).find_map(|_| {
                let trial = self.moved(outlines, &x, &step);
                let found = self.model(outlines, &trial);
                step.iter_mut().for_each(|s| *s *= 0.5);
                (found.energy < model.energy).then_some((trial, found))
            });
            let Some((trial, found)) = better else { break };
            let gained = model.energy - found.energy;
            let long = self.parts(outlines).any(|(_, outline, range)| {
                range.into_iter().any(|k| (trial[k] - x[k]).abs() > SHORT * outline.length())
            });
            (x, model) = (trial, found);
            if gained <= GAIN * model.energy && !(self.plate.is_some() && long) {
                break;
            }
        }
        (x, model.energy)
    }

    /// The longest part of the step that leaves half of every gap between neighbours.
    fn moved(&self, outlines: &[&Outline], x: &[f64], step: &[f64]) -> Vec<f64> {
        let mut most: f64 = 0.5;
        for (_, outline, range) in self.parts(outlines) {
            for k in range.clone() {
                let last = k + 1 == range.end;
                let next = if last { range.start } else { k + 1 };
                let gap = x[next] + if last { outline.length() } else { 0.0 } - x[k];
                most = most.max((step[k] - step[next]) / gap);
            }
        }
        x.iter().zip(step).map(|(x, s)| x + 0.5 / most * s).collect()
    }
}

/// Where an arc length lies between the target's nodes.
fn position(l: &SlidingLoop, length: f64, y: f64) -> Position {
    let (nodes, n) = (&l.nodes, l.nodes.len());
    let y = nodes[0] + (y - nodes[0]).rem_euclid(length);
    let k = nodes.partition_point(|&s| s <= y).clamp(1, n) - 1;
    let gap = if k + 1 < n { nodes[k + 1] } else { nodes[0] + length } - nodes[k];
    let fraction = ((y - nodes[k]) / gap).clamp(0.0, 1.0);
    Position { before: l.first + k, after: l.first + (k + 1) % n, fraction, gap }
}

/// Energy of uneven stretch along a loop.
fn add_stretch(l: &SlidingLoop, length: f64, x: &[f64], range: std::ops::Range<usize>, model: &mut Model) {
    let n = x.len();
    for (i, here) in range.clone().enumerate() {
        let last = here + 1 == range.end;
        let there = if last { range.start } else { here + 1 };
        let step = x[there] + if last { length } else { 0.0 } - x[here];
        let stretch = step / (l.part[i] * length) - 1.0;
        let force = 2.0 * l.stretch * stretch / length;
        let stiffness = 2.0 * l.stretch / (l.part[i] * length * length);
        model.energy += l.stretch * l.part[i] * stretch * stretch;
        model.gradient[there] += force;
        model.gradient[here] -= force;
        model.hessian[there * n + there] += stiffness;
        model.hessian[here * n + here] += stiffness;
        model.hessian[here * n + there] -= stiffness;
        model.hessian[there * n + here] -= stiffness;
    }
}

/// Gauss–Newton step that moves no `held` point. Damps the matrix.
fn newton_step(model: &mut Model, held: &[bool]) -> Vec<f64> {
    let (n, hessian) = (held.len(), &mut model.hessian);
    let damping = DAMPING * (0..n).map(|k| hessian[k * n + k]).sum::<f64>() / n as f64;
    for (i, row) in hessian.chunks_exact_mut(n).enumerate() {
        row[i] += damping;
        for (j, entry) in row.iter_mut().enumerate() {
            if held[i] || held[j] {
                *entry = if i == j { 1.0 } else { 0.0 };
            }
        }
    }
    let down = model.gradient.iter().zip(held).map(|(g, &held)| if held { 0.0 } else { -g });
    let mut step: Vec<f64> = down.collect();
    Definite::new(hessian, n).solve(&mut step);
    step
}

impl Plate {
    /// Energy at points and unit tangents `[x, y, tx, ty]`.
    fn add(&self, at: &[[f64; 4]], model: &mut Model) {
        let n = at.len() as f64;
        let mean: [f64; 2] = std::array::from_fn(|c| at.iter().map(|p| p[c]).sum::<f64>() / n);
        let mut points: Vec<[f64; 2]> =
            at.iter().map(|p| std::array::from_fn(|c| (p[c] - mean[c]) / self.size)).collect();
        let tangents: Vec<[f64; 2]> = at.iter().map(|p| [p[2] / self.size, p[3] / self.size]).collect();
        // The energy is blind to affine maps; small numbers round less.
        for function in &self.affine {
            for c in 0..2 {
                let along: f64 = function.iter().zip(&points).map(|(f, p)| f * p[c]).sum();
                points.iter_mut().zip(function).for_each(|(p, f)| p[c] -= along * f);
            }
        }
        let Model { gradient, hessian, .. } = model;
        model.energy += add_bending(&self.matrix, &points, &tangents, self.weight, gradient, hessian);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::registration::inner_distance::inner_distances;
    use crate::registration::thin_plate::bending_matrix;
    use crate::spline::SplineCurve;

    /// Four quadratic arcs.
    fn loop_of_arcs() -> Outline {
        let arc = |a: [f64; 2], b: [f64; 2], c: [f64; 2]| SplineCurve {
            degree: 2,
            knots: vec![0.0, 0.0, 0.0, 1.0, 1.0, 1.0],
            points: vec![a, b, c],
            weights: None,
        };
        Outline::new(&[
            arc([2.0, 0.0], [2.0, 1.0], [0.0, 1.0]),
            arc([0.0, 1.0], [-2.0, 1.2], [-2.0, 0.0]),
            arc([-2.0, 0.0], [-2.0, -1.0], [0.0, -1.0]),
            arc([0.0, -1.0], [1.7, -1.0], [2.0, 0.0]),
        ])
    }

    fn sliding(outline: &Outline, n: usize, bending: bool) -> (Sliding, Vec<f64>) {
        let windows = vec![1.0 / 24.0, 1.0 / 8.0];
        let s: Vec<f64> = (0..n).map(|k| k as f64 / n as f64 * outline.length()).collect();
        let points: Vec<[f64; 2]> = outline.evaluate(&s, false).iter().map(|p| [p[0], p[1]]).collect();
        let distances = inner_distances(&points, &[n]);
        let weight = (0..n * n).map(|k| if k / n == k % n { 0.0 } else { 1.0 / (n * n) as f64 }).collect();
        let part = vec![1.0 / n as f64; n];
        let plate = bending.then(|| Plate {
            matrix: bending_matrix(&points, 1e-4),
            affine: vec![vec![1.0 / (n as f64).sqrt(); n]],
            size: 1.3,
            weight: 0.01,
        });
        let turning = turning(outline, &s, &windows);
        let weights = vec![0.1 / n as f64; n];
        let of_loop =
            SlidingLoop { nodes: s.clone(), first: 0, turning, turning_weight: weights, part, stretch: 0.03 };
        let loops = vec![of_loop];
        (Sliding { loops, wanted: distances.clone(), distances, weight, windows, plate }, s)
    }

    #[test]
    fn points_slide_back_to_their_places() {
        let outline = loop_of_arcs();
        for bending in [false, true] {
            let (sliding, truth) = sliding(&outline, 40, bending);
            let step = outline.length() / 40.0;
            let x: Vec<f64> =
                truth.iter().enumerate().map(|(k, s)| s + 0.3 * step * (k as f64 * 0.7).sin()).collect();
            let mut held = vec![false; 40];
            held[0] = true;
            let before = sliding.model(&[&outline], &x).energy;
            let (found, energy) = sliding.slide(&[&outline], &x, &held);
            assert_eq!(found[0], x[0]);
            assert!(energy < 0.05 * before, "{energy} {before}");
            assert!(found.iter().zip(&truth).all(|(a, b)| (a - b).abs() < 0.15 * step));
            assert_eq!(sliding.slide(&[&outline], &x, &[true; 40]), (x, before));
        }
    }

    #[test]
    fn gradient_is_the_derivative() {
        let outline = loop_of_arcs();
        let (sliding, truth) = sliding(&outline, 24, true);
        let step = outline.length() / 24.0;
        let x: Vec<f64> =
            truth.iter().enumerate().map(|(k, s)| s + step * (0.4 + 0.2 * (k as f64).sin())).collect();
        let model = sliding.model(&[&outline], &x);
        // Within the steps that the turning's slope is made with.
        let h = DIFFERENCE * outline.length();
        for i in 0..24 {
            let at = |h: f64| {
                let mut x = x.clone();
                x[i] += h;
                sliding.model(&[&outline], &x).energy
            };
            let slope = (at(0.1 * h) - at(-0.1 * h)) / (0.2 * h);
            assert!(
                (slope - model.gradient[i]).abs() < 2e-2 * (0.1 + slope.abs()),
                "{slope} {}",
                model.gradient[i]
            );
            assert!(model.hessian[i * 24 + i] > 0.0);
        }
    }
}
