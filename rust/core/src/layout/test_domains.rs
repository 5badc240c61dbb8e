//! Domains that the tests of all stages share.

use std::f64::consts::TAU;

use super::mesh::{Corner, LayoutMesh};

/// Nodes, index loops and corners of a domain.
pub(super) struct Domain {
    pub points: Vec<[f64; 2]>,
    pub loops: Vec<Vec<usize>>,
    pub corners: Vec<Corner>,
}

impl Domain {
    /// From loops with the domain on their left; corners by their ranks in a loop.
    pub(super) fn new(loops: &[Vec<[f64; 2]>], corners: &[(usize, usize, usize)]) -> Self {
        let starts: Vec<usize> = loops
            .iter()
            .scan(0, |next, l| {
                *next += l.len();
                Some(*next - l.len())
            })
            .collect();
        Self {
            points: loops.concat(),
            loops: loops.iter().zip(&starts).map(|(l, s)| (*s..s + l.len()).collect()).collect(),
            corners: corners
                .iter()
                .map(|&(l, rank, quads)| Corner { vertex: starts[l] + rank, quads })
                .collect(),
        }
    }

    pub(super) fn turned(&self, angle: f64, scale: f64) -> Self {
        let (s, c) = angle.sin_cos();
        let points = self
            .points
            .iter()
            .map(|[x, y]| [scale * (c * x - s * y) + 3.0 * scale, scale * (s * x + c * y) - scale]);
        Self { points: points.collect(), loops: self.loops.clone(), corners: self.corners.clone() }
    }

    pub(super) fn mesh(&self, max_area: f64) -> LayoutMesh {
        LayoutMesh::generate(&self.points, &self.loops, &self.corners, max_area).unwrap()
    }
}

/// A polygon with `steps` edges a side.
pub(super) fn polygon(corners: &[[f64; 2]], steps: usize) -> Vec<[f64; 2]> {
    let n = corners.len();
    (0..n * steps)
        .map(|k| {
            let (a, b, t) =
                (corners[k / steps], corners[(k / steps + 1) % n], (k % steps) as f64 / steps as f64);
            [a[0] + t * (b[0] - a[0]), a[1] + t * (b[1] - a[1])]
        })
        .collect()
}

/// A circle of `n` nodes, clockwise for a hole.
pub(super) fn circle(centre: [f64; 2], radius: f64, n: usize, hole: bool) -> Vec<[f64; 2]> {
    let sense = if hole { -TAU } else { TAU };
    (0..n)
        .map(|k| {
            let (s, c) = (sense * k as f64 / n as f64).sin_cos();
            [centre[0] + radius * c, centre[1] + radius * s]
        })
        .collect()
}

const SQUARE: [[f64; 2]; 4] = [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]];

pub(super) fn square() -> Domain {
    Domain::new(&[polygon(&SQUARE, 8)], &[(0, 0, 1), (0, 8, 1), (0, 16, 1), (0, 24, 1)])
}

pub(super) fn l_shape() -> Domain {
    let corners = [[0.0, 0.0], [2.0, 0.0], [2.0, 1.0], [1.0, 1.0], [1.0, 2.0], [0.0, 2.0]];
    let quads = [1, 1, 1, 3, 1, 1];
    let quads: Vec<_> = quads.iter().enumerate().map(|(i, &k)| (0, 8 * i, k)).collect();
    Domain::new(&[polygon(&corners, 8)], &quads)
}

pub(super) fn disk() -> Domain {
    Domain::new(&[circle([0.0, 0.0], 1.0, 60, false)], &[])
}

pub(super) fn annulus() -> Domain {
    let loops = [circle([0.0, 0.0], 1.0, 60, false), circle([0.1, 0.0], 0.4, 45, true)];
    Domain::new(&loops, &[])
}

/// A square with a square hole that is turned by an angle: crosses turn from the one to the other.
pub(super) fn twisted(angle: f64) -> Domain {
    let hole: Vec<[f64; 2]> = (0..4)
        .map(|k| {
            let (s, c) = (angle - TAU * k as f64 / 4.0).sin_cos();
            [0.5 + 0.25 * c, 0.5 + 0.25 * s]
        })
        .collect();
    let corners: Vec<_> = (0..4).map(|k| (0, 16 * k, 1)).chain((0..4).map(|k| (1, 8 * k, 3))).collect();
    Domain::new(&[polygon(&SQUARE, 16), polygon(&hole, 8)], &corners)
}
