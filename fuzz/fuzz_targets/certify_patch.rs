//! A patch that is proved regular has no clearly negative determinant at sampled points, and nothing panics.
#![no_main]

use libfuzzer_sys::fuzz_target;
use patchtransfer_core::proof::injectivity::{CellKind, Limits, certify_patch};
use patchtransfer_core::spline::{SplinePatch, spans};
use patchtransfer_fuzz::{Bytes, basis};

/// Samples of a knot span in each direction, its ends among them.
const SAMPLES: usize = 5;
/// A determinant is clearly negative below minus this part of the products that it is the difference of.
const CLEAR: f64 = 1e-9;

fuzz_target!(|data: &[u8]| {
    let mut bytes = Bytes::new(data);
    let degrees = [bytes.between(1, 3), bytes.between(1, 3)];
    let knots: [Vec<f64>; 2] = std::array::from_fn(|d| bytes.knots(degrees[d], 2));
    let shape: [usize; 2] = std::array::from_fn(|d| knots[d].len() - degrees[d] - 1);
    let rational = bytes.byte() % 4 == 0;
    let points: Vec<[f64; 2]> = (0..shape[0] * shape[1])
        .map(|k| {
            // Around a regular grid, so that some patches are regular.
            let at = [(k / shape[1]) as f64 * 8.0, (k % shape[1]) as f64 * 8.0];
            [at[0] + bytes.coordinate(), at[1] + bytes.coordinate()]
        })
        .collect();
    let weights = rational.then(|| points.iter().map(|_| bytes.weight()).collect());
    let patch = SplinePatch { degrees, knots, shape, points, weights };
    let proof = certify_patch(&patch, 1.0, &Limits { max_depth: 12, max_cells: 2_000 });
    let smallest = clearest(&patch);
    if !proof.cells.iter().any(|cell| cell.kind != CellKind::Degenerate) {
        let sign = if proof.sign_agrees { 1.0 } else { -1.0 };
        for (det, size, at) in smallest {
            assert!(
                sign * det >= -CLEAR * size,
                "proved, but det J = {det:e} of {size:e} at {at:?}: {patch:?}"
            );
        }
    }
});

/// det J (its numerator on a rational patch), the size of its terms and where, at points of every span.
fn clearest(patch: &SplinePatch) -> Vec<(f64, f64, [f64; 2])> {
    let mut found = Vec::new();
    let samples = |d: usize| {
        let (t, p) = (&patch.knots[d], patch.degrees[d]);
        let on = |k: usize| (0..SAMPLES).map(move |s| (k, s as f64 / (SAMPLES - 1) as f64));
        spans(t, p)
            .into_iter()
            .flat_map(on)
            .map(|(k, s)| (k, t[k] + s * (t[k + 1] - t[k])))
            .collect::<Vec<_>>()
    };
    for (ku, u) in samples(0) {
        let (nu, du) = basis(&patch.knots[0], patch.degrees[0], ku, u);
        for (kv, v) in samples(1) {
            let (nv, dv) = basis(&patch.knots[1], patch.degrees[1], kv, v);
            let mut sums = [[0.0; 3]; 3];
            let mut largest = 0.0f64;
            let origin = patch.points[(ku - patch.degrees[0]) * patch.shape[1] + kv - patch.degrees[1]];
            for a in 0..nu.len() {
                for b in 0..nv.len() {
                    let k = (ku - patch.degrees[0] + a) * patch.shape[1] + kv - patch.degrees[1] + b;
                    let w = patch.weights.as_ref().map_or(1.0, |w| w[k]);
                    let h = [w * (patch.points[k][0] - origin[0]), w * (patch.points[k][1] - origin[1]), w];
                    for c in 0..3 {
                        let factors = [nu[a] * nv[b], du[a] * nv[b], nu[a] * dv[b]];
                        for (row, f) in factors.iter().enumerate() {
                            sums[row][c] += f * h[c];
                            largest = largest.max((f * h[c]).abs());
                        }
                    }
                }
            }
            let [x, xu, xv] = sums;
            let minors =
                [xu[1] * xv[2] - xu[2] * xv[1], xu[2] * xv[0] - xu[0] * xv[2], xu[0] * xv[1] - xu[1] * xv[0]];
            let det: f64 = (0..3).map(|c| x[c] * minors[c]).sum();
            let size = largest.powi(3).max(largest.powi(2));
            if det.is_finite() && size.is_finite() {
                found.push((det, size, [u, v]));
            }
        }
    }
    found
}
