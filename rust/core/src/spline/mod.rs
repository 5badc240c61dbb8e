//! Univariate B-spline bases and Bézier extraction, the ground everything else stands on.

pub mod bernstein;
pub mod galerkin;
pub mod quality;
pub mod sampled_basis;
pub mod scattered;

/// A tensor-product spline patch of the plane, control points in C order: `[i, j]` is `points[i * shape[1] + j]`
/// with `i` along `u` and `j` along `v`.
#[derive(Clone, Debug, PartialEq)]
pub struct SplinePatch {
    /// Degrees `(p, q)` in `u` and `v`.
    pub degrees: [usize; 2],
    /// Clamped knot vectors in `u` and `v`.
    pub knots: [Vec<f64>; 2],
    /// Number of control points along `u` and `v`.
    pub shape: [usize; 2],
    /// Control points (Cartesian, not premultiplied by the weights).
    pub points: Vec<[f64; 2]>,
    /// Weights of a NURBS patch.
    pub weights: Option<Vec<f64>>,
}

/// A planar spline curve with clamped knots.
#[derive(Clone, Debug, PartialEq)]
pub struct SplineCurve {
    /// Degree.
    pub degree: usize,
    /// Clamped knot vector.
    pub knots: Vec<f64>,
    /// Control points (Cartesian).
    pub points: Vec<[f64; 2]>,
    /// Weights of a NURBS curve.
    pub weights: Option<Vec<f64>>,
}

/// Indices `k` of the non-empty knot spans `[knots[k], knots[k + 1])` of the domain, in increasing order.
pub fn spans(knots: &[f64], degree: usize) -> Vec<usize> {
    (degree..knots.len() - degree - 1).filter(|&k| knots[k] < knots[k + 1]).collect()
}

/// Values and first derivatives of the `degree + 1` basis functions that live on span `k`, at `t`.
///
/// `t` may be either end of the span, so one-sided values at knots of low continuity are well defined:
/// function `a` of the result is basis function `k - degree + a`. Cox–de Boor recursion.
pub fn basis_on_span(
    knots: &[f64],
    degree: usize,
    k: usize,
    t: f64,
    values: &mut [f64],
    derivatives: &mut [f64],
) {
    debug_assert!(values.len() == degree + 1 && derivatives.len() == degree + 1);
    values.fill(0.0);
    values[0] = 1.0;
    for d in 1..=degree {
        if d == degree {
            // The derivative is a difference of the functions of one degree less.
            for a in 0..=degree {
                let left = if a > 0 { values[a - 1] / (knots[k + a] - knots[k + a - degree]) } else { 0.0 };
                let right =
                    if a < degree { values[a] / (knots[k + a + 1] - knots[k + a + 1 - degree]) } else { 0.0 };
                derivatives[a] = degree as f64 * (left - right);
            }
        }
        let mut carried = 0.0;
        for a in 0..d {
            let (lo, hi) = (knots[k + a + 1 - d], knots[k + a + 1]);
            let scaled = values[a] / (hi - lo);
            values[a] = carried + (hi - t) * scaled;
            carried = (t - lo) * scaled;
        }
        values[d] = carried;
    }
    if degree == 0 {
        derivatives[0] = 0.0;
    }
}

/// Derivatives of `order` of the `degree + 1` basis functions that live on span `k`, at `t`, in the first
/// `degree + 1` numbers of `work`, which has room for twice as many.
///
/// Unlike `basis_on_span` for any order (zero above the degree), and in the order of operations of de Boor's BSPLVD that
/// other libraries have: they give the same bits. C. de Boor, A Practical Guide to Splines, 1978, chapter X.
pub fn derivatives_on_span(knots: &[f64], degree: usize, k: usize, t: f64, order: usize, work: &mut [f64]) {
    let (h, before) = work.split_at_mut(degree + 1);
    h.fill(0.0);
    if order > degree {
        return;
    }
    h[0] = 1.0;
    for j in 1..=degree - order {
        before[..j].copy_from_slice(&h[..j]);
        h[0] = 0.0;
        for n in 1..=j {
            let (hi, lo) = (knots[k + n], knots[k + n - j]);
            let w = before[n - 1] / (hi - lo);
            h[n - 1] += w * (hi - t);
            h[n] = w * (t - lo);
        }
    }
    for j in degree - order + 1..=degree {
        before[..j].copy_from_slice(&h[..j]);
        h[0] = 0.0;
        for n in 1..=j {
            let w = j as f64 * before[n - 1] / (knots[k + n] - knots[k + n - j]);
            h[n - 1] -= w;
            h[n] = w;
        }
    }
}

/// Derivatives of `order` of a spline with `width` numbers a coefficient, at all of `at`, one after the other.
///
/// The first and last polynomial continue beyond the ends; at a knot the piece after it counts.
pub fn evaluate(
    knots: &[f64],
    degree: usize,
    coefficients: &[f64],
    width: usize,
    at: &[f64],
    order: usize,
) -> Vec<f64> {
    let last = knots.len() - degree - 2;
    let mut work = vec![0.0; 2 * degree + 2];
    let mut out = vec![0.0; at.len() * width];
    for (&t, out) in at.iter().zip(out.chunks_exact_mut(width)) {
        if t.is_nan() {
            out.fill(f64::NAN);
            continue;
        }
        let k = knots.partition_point(|&x| x <= t).saturating_sub(1).clamp(degree, last);
        derivatives_on_span(knots, degree, k, t, order, &mut work);
        for (c, b) in coefficients[(k - degree) * width..].chunks_exact(width).zip(&work[..=degree]) {
            for (out, c) in out.iter_mut().zip(c) {
                *out += c * b;
            }
        }
    }
    out
}

/// Bézier control points of every non-empty span of a spline whose coefficients are vectors of `D` numbers.
///
/// Each interior knot is inserted until its multiplicity is the degree (Boehm); the result of span `s` is
/// `out[s * (degree + 1)..]`. Interior multiplicity above the degree (a jump) is not allowed.
pub fn bezier_extract<const D: usize>(
    knots: &[f64],
    degree: usize,
    coefficients: &[[f64; D]],
) -> Vec<[f64; D]> {
    let mut t = knots.to_vec();
    let mut c = coefficients.to_vec();
    let mut k = degree + 1;
    while k < t.len() - degree - 1 {
        let x = t[k];
        let multiplicity = t[k..].iter().take_while(|&&y| y == x).count();
        for already in multiplicity..degree {
            insert_knot(&mut t, degree, &mut c, k + already - 1, already, x);
        }
        k += degree.max(multiplicity);
    }
    let pieces = spans(&t, degree).len();
    let mut out = Vec::with_capacity(pieces * (degree + 1));
    for s in 0..pieces {
        out.extend_from_slice(&c[s * degree..=s * degree + degree]);
    }
    out
}

/// One step of Boehm's knot insertion of `x`, the last of whose `multiplicity` copies stands at `t[k]`.
fn insert_knot<const D: usize>(
    t: &mut Vec<f64>,
    degree: usize,
    c: &mut Vec<[f64; D]>,
    k: usize,
    multiplicity: usize,
    x: f64,
) {
    let (first, last) = (k + 1 - degree, k - multiplicity);
    let new: Vec<[f64; D]> = (first..=last)
        .map(|i| {
            let alpha = (x - t[i]) / (t[i + degree] - t[i]);
            std::array::from_fn(|d| (1.0 - alpha) * c[i - 1][d] + alpha * c[i][d])
        })
        .collect();
    c.splice(first..last, new);
    t.insert(k + 1, x);
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn evaluate(knots: &[f64], degree: usize, c: &[[f64; 1]], t: f64) -> f64 {
        let k = *spans(knots, degree).iter().rev().find(|&&k| knots[k] <= t).unwrap();
        let (mut v, mut d) = (vec![0.0; degree + 1], vec![0.0; degree + 1]);
        basis_on_span(knots, degree, k, t, &mut v, &mut d);
        (0..=degree).map(|a| v[a] * c[k - degree + a][0]).sum()
    }

    proptest! {
        #[test]
        fn bezier_pieces_reproduce_the_spline(degree in 1usize..5, inner in proptest::collection::vec((1u32..9, 1usize..4), 0..4), seed in proptest::collection::vec(-1.0f64..1.0, 40), s in 0.0f64..1.0) {
            let mut inner: Vec<(f64, usize)> = inner.iter().map(|&(x, m)| (x as f64 / 10.0, m.min(degree))).collect();
            inner.sort_by(|a, b| a.0.total_cmp(&b.0));
            inner.dedup_by(|a, b| a.0 == b.0);
            let mut knots = vec![0.0; degree + 1];
            for (x, m) in &inner { knots.extend(vec![*x; *m]); }
            knots.extend(vec![1.0; degree + 1]);
            let n = knots.len() - degree - 1;
            let c: Vec<[f64; 1]> = (0..n).map(|i| [seed[i]]).collect();
            let pieces = bezier_extract(&knots, degree, &c);
            let sp = spans(&knots, degree);
            prop_assert_eq!(pieces.len(), sp.len() * (degree + 1));
            for (i, &k) in sp.iter().enumerate() {
                let mut b: Vec<f64> = pieces[i * (degree + 1)..][..degree + 1].iter().map(|x| x[0]).collect();
                for level in 0..degree { for a in 0..degree - level { b[a] = (1.0 - s) * b[a] + s * b[a + 1]; } }
                let t = knots[k] + s * (knots[k + 1] - knots[k]);
                prop_assert!((b[0] - evaluate(&knots, degree, &c, t)).abs() < 1e-12);
            }
        }

        #[test]
        fn basis_sums_to_one_and_derivative_matches_difference(degree in 1usize..6, t in 0.01f64..0.49) {
            let mut knots = vec![0.0; degree + 1];
            knots.push(0.5);
            knots.extend(vec![1.0; degree + 1]);
            let n = degree + 1;
            let (mut v, mut d, mut v2, mut d2) = (vec![0.0; n], vec![0.0; n], vec![0.0; n], vec![0.0; n]);
            basis_on_span(&knots, degree, degree, t, &mut v, &mut d);
            prop_assert!((v.iter().sum::<f64>() - 1.0).abs() < 1e-14);
            prop_assert!(d.iter().sum::<f64>().abs() < 1e-12);
            let h = 1e-6;
            basis_on_span(&knots, degree, degree, t + h, &mut v2, &mut d2);
            for a in 0..n { prop_assert!(((v2[a] - v[a]) / h - 0.5 * (d[a] + d2[a])).abs() < 1e-6); }
        }
    }
}
