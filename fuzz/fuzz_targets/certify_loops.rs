//! Loops that are proved simple and disjoint do not cross clearly, and nothing panics.
#![no_main]

use libfuzzer_sys::fuzz_target;
use patchtransfer_core::proof::simple_loops::check_loops;
use patchtransfer_core::spline::{SplineCurve, spans};
use patchtransfer_fuzz::{Bytes, basis};

/// Chords of a knot span.
const CHORDS: usize = 8;

fuzz_target!(|data: &[u8]| {
    let mut bytes = Bytes::new(data);
    let loops: Vec<Vec<SplineCurve>> =
        (1..=bytes.between(1, 2)).map(|k| closed(&mut bytes, 12.0 / k as f64)).collect();
    let proof = check_loops(&loops);
    if proof.meetings.is_empty() {
        let chains: Vec<Vec<Chord>> =
            loops.iter().map(|curves| curves.iter().flat_map(chords).collect()).collect();
        let all: Vec<&Chord> = chains.iter().flatten().collect();
        for (i, a) in all.iter().enumerate() {
            for b in &all[..i] {
                assert!(!cross(a, b), "proved simple, but {a:?} crosses {b:?}: {loops:?}");
            }
        }
    }
});

/// A loop of one to four curves around a circle, so that some are simple.
fn closed(bytes: &mut Bytes<'_>, radius: f64) -> Vec<SplineCurve> {
    let count = bytes.between(1, 4);
    let point = |turn: f64, bytes: &mut Bytes<'_>| {
        let (sine, cosine) = (turn * std::f64::consts::TAU).sin_cos();
        [radius * cosine + bytes.coordinate(), radius * sine + bytes.coordinate()]
    };
    let first = point(0.0, bytes);
    let mut start = first;
    (0..count)
        .map(|k| {
            let degree = bytes.between(1, 4);
            let knots = bytes.knots(degree, 2);
            let n = knots.len() - degree - 1;
            let mut points: Vec<[f64; 2]> =
                (0..n).map(|i| point((k as f64 + i as f64 / (n - 1) as f64) / count as f64, bytes)).collect();
            points[0] = start;
            if k + 1 == count {
                points[n - 1] = first;
            }
            start = points[n - 1];
            let weights = (bytes.byte() % 4 == 0).then(|| (0..n).map(|_| bytes.weight()).collect());
            SplineCurve { degree, knots, points, weights }
        })
        .collect()
}

/// A chord, and how far the curve may be from it.
#[derive(Debug)]
struct Chord {
    ends: [[f64; 2]; 2],
    off: f64,
}

fn chords(curve: &SplineCurve) -> Vec<Chord> {
    // A bound on how far a rational curve strays from a chord is not worth the trouble here.
    if curve.weights.is_some() {
        return Vec::new();
    }
    let (t, p) = (&curve.knots, curve.degree);
    let mut found = Vec::new();
    for k in spans(t, p) {
        let at = |s: f64| {
            let (values, _) = basis(t, p, k, t[k] + s * (t[k + 1] - t[k]));
            let sum = |c: usize| (0..=p).map(|a| values[a] * curve.points[k - p + a][c]).sum();
            [sum(0), sum(1)]
        };
        let samples: Vec<[f64; 2]> = (0..=CHORDS).map(|s| at(s as f64 / CHORDS as f64)).collect();
        let local = &curve.points[k - p..=k];
        let size = local.iter().flatten().fold(0.0, |m: f64, x| m.max(x.abs()));
        // |c''| h² / 8 with |c''| at most 4 p² times the size over the span squared, knots of the neighbours being
        // nearer than the span is long; widened for rounding.
        let ratio = ((t[k + 1] - t[k]) / shortest(t, k, p)).max(1.0);
        let bound = 4.0 * (p * p) as f64 * size * ratio * ratio / (8.0 * (CHORDS * CHORDS) as f64);
        let off = if p == 1 { 1e-12 * size } else { bound };
        found.extend(samples.windows(2).map(|w| Chord { ends: [w[0], w[1]], off }));
    }
    found
}

/// Shortest distance of knots that the second derivative on span `k` is divided by.
fn shortest(t: &[f64], k: usize, p: usize) -> f64 {
    let differences = (1..p.max(2)).flat_map(|d| (k + 1 - d.min(k)..=k).map(move |i| (i, i + d)));
    differences
        .filter(|&(i, j)| j < t.len() && i <= k && j > k)
        .map(|(i, j)| t[j] - t[i])
        .filter(|&d| d > 0.0)
        .fold(t[k + 1] - t[k], f64::min)
}

/// Whether the curves of two chords surely cross: every end is farther from the other chord's line than both stray.
fn cross(a: &Chord, b: &Chord) -> bool {
    let off = 2.0 * (a.off + b.off);
    let sides = |c: &Chord, d: &Chord| -> Option<[f64; 2]> {
        let along = [c.ends[1][0] - c.ends[0][0], c.ends[1][1] - c.ends[0][1]];
        let length = along[0].hypot(along[1]);
        let distance =
            |p: [f64; 2]| ((p[1] - c.ends[0][1]) * along[0] - (p[0] - c.ends[0][0]) * along[1]) / length;
        let both = [distance(d.ends[0]), distance(d.ends[1])];
        both.iter().all(|x| x.abs() > off).then_some(both)
    };
    match (sides(a, b), sides(b, a)) {
        (Some([p, q]), Some([r, s])) => p.signum() != q.signum() && r.signum() != s.signum(),
        _ => false,
    }
}
