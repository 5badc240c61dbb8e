//! The distortion energy of a 2×2 Jacobian and its derivatives, with the fold-over regularisation.
//!
//! `f(A) = (‖A‖² + λ (det² A + 1)) / χ(det A)` with `χ(D) = (D + √(ε² + D²)) / 2`, after Garanzha, Kaporin,
//! Kudryavtseva, Protais, Ray, Sokolov: *Foldover-free maps in 50 lines of code*, ACM TOG 40(4), 2021
//! (doi:10.1145/3450626.3459847). With ε → 0 it is infinite for det A ≤ 0 and keeps feasible maps feasible.

use crate::numeric::lanes::Lanes;

/// `χ` below this is held there: it only guards the division for far folded Jacobians.
const CHI_MIN: f64 = 1e-14;

/// Index of the symmetric 4×4 entry (i, j) in packed order.
pub const PACKED: [[usize; 4]; 4] = [[0, 1, 2, 3], [1, 4, 5, 6], [2, 5, 7, 8], [3, 6, 8, 9]];

/// Added to divisors that may vanish together with their dividend.
const TINY: f64 = 1e-200;

/// Newton decrement, relative to the energy, below which the exact Hessian is tried: steps along it then gain digits by
/// the square, and it is seldom indefinite so near a minimum.
pub(crate) const EXACT_BELOW: f64 = 1e-2;

/// How the Hessian of a non-convex energy is used.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum HessianKind {
    /// Projected to the positive semidefinite cone, so that every step descends.
    Projected,
    /// As it is: faster near a minimum, not always definite.
    Exact,
}

/// `χ(D)`, `χ'(D)`, `χ''(D)`.
#[inline(always)]
fn chi(eps: f64, det: Lanes) -> (Lanes, Lanes, Lanes) {
    let square = Lanes::splat(eps * eps);
    let root = (square + det * det).sqrt();
    // The second form avoids cancellation for negative determinants.
    let below = 0.5 * square / det.where_positive(Lanes::splat(1.0), root - det);
    let value = det.where_positive(0.5 * (det + root), below).max(Lanes::splat(CHI_MIN));
    (value, value / root, 0.5 * square / (root * root * root))
}

#[inline(always)]
fn invariants(a: &[Lanes; 4]) -> (Lanes, Lanes) {
    (a[0] * a[3] - a[1] * a[2], a[0] * a[0] + a[1] * a[1] + a[2] * a[2] + a[3] * a[3])
}

/// Energy of `A = [a11, a12, a21, a22]` and `det A`.
#[inline(always)]
pub(crate) fn energy(a: &[Lanes; 4], eps: f64, lambda: f64) -> (Lanes, Lanes) {
    let (det, norm) = invariants(a);
    ((norm + lambda * (det * det + Lanes::splat(1.0))) / chi(eps, det).0, det)
}

/// Energy, determinant and gradient with respect to the entries of `A`.
#[inline(always)]
pub(crate) fn gradient(a: &[Lanes; 4], eps: f64, lambda: f64) -> (Lanes, Lanes, [Lanes; 4]) {
    let (det, norm) = invariants(a);
    let (c, c1, _) = chi(eps, det);
    let h = 1.0 / c;
    let e = (norm + lambda * (det * det + Lanes::splat(1.0))) * h;
    let by_det = (2.0 * lambda * det - e * c1) * h;
    let h2 = h + h;
    let by_a = [
        h2 * a[0] + by_det * a[3],
        h2 * a[1] - by_det * a[2],
        h2 * a[2] - by_det * a[1],
        h2 * a[3] + by_det * a[0],
    ];
    (e, det, by_a)
}

/// Hessian with respect to the entries of `A`, packed symmetric.
///
/// In the conformal part `p = ((a11 + a22), (a21 − a12)) / 2` and the anticonformal part
/// `q = ((a11 − a22), (a12 + a21)) / 2` the energy depends on `P = |p|²` and `Q = |q|²` only
/// (`‖A‖² = 2(P + Q)`, `det A = P − Q`), so the eigenvectors are known: the tangential directions of p and of q,
/// with eigenvalues `2 f_P` and `2 f_Q`, and a 2×2 problem in the two radial directions.
#[inline(always)]
pub(crate) fn hessian(a: &[Lanes; 4], eps: f64, lambda: f64, kind: HessianKind) -> [Lanes; 10] {
    let (p1, p2) = (0.5 * (a[0] + a[3]), 0.5 * (a[2] - a[1]));
    let (q1, q2) = (0.5 * (a[0] - a[3]), 0.5 * (a[1] + a[2]));
    let (pp, qq) = (p1 * p1 + p2 * p2, q1 * q1 + q2 * q2);
    let det = pp - qq;
    let (c, c1, c2) = chi(eps, det);
    let h = 1.0 / c;
    let h1 = -(c1 * h * h);
    let h2 = (2.0 * c1 * c1 * h - c2) * h * h;
    let numerator = 2.0 * (pp + qq) + lambda * (det * det + Lanes::splat(1.0));
    // Derivatives of f as a function of g = ‖A‖² (linear) and D = det A.
    let by_d = numerator * h1 + 2.0 * lambda * det * h;
    let by_gd = h1;
    let by_dd = numerator * h2 + lambda * (4.0 * det * h1 + 2.0 * h);
    let (f_p, f_q) = (2.0 * h + by_d, 2.0 * h - by_d);
    let (f_pp, f_pq, f_qq) = (by_dd + 4.0 * by_gd, -by_dd, by_dd - 4.0 * by_gd);

    let (mut tangent_p, mut tangent_q) = (2.0 * f_p, 2.0 * f_q);
    let cross = (pp * qq).sqrt();
    let mut radial = [2.0 * f_p + 4.0 * f_pp * pp, 4.0 * f_pq * cross, 2.0 * f_q + 4.0 * f_qq * qq];
    if kind == HessianKind::Projected {
        let largest;
        (radial, largest) = project_2x2(radial);
        // A relative floor instead of zero keeps the assembled matrix definite.
        let floor = 1e-9 * largest.max(tangent_p).max(tangent_q);
        (tangent_p, tangent_q) = (tangent_p.max(floor), tangent_q.max(floor));
    }
    // Back to p and q: tangential value on the whole plane plus the radial excess along p, q.
    let tiny = Lanes::splat(TINY);
    let along_p = (radial[0] - tangent_p) / (pp + tiny);
    let along_q = (radial[2] - tangent_q) / (qq + tiny);
    let mixed = radial[1] / (cross + tiny);
    let (hp11, hp12, hp22) =
        (tangent_p + along_p * p1 * p1, along_p * p1 * p2, tangent_p + along_p * p2 * p2);
    let (hq11, hq12, hq22) =
        (tangent_q + along_q * q1 * q1, along_q * q1 * q2, tangent_q + along_q * q2 * q2);
    let (m11, m12, m21, m22) = (mixed * p1 * q1, mixed * p1 * q2, mixed * p2 * q1, mixed * p2 * q2);
    // a11 = p1 + q1, a12 = q2 − p2, a21 = p2 + q2, a22 = p1 − q1.
    [
        0.25 * (hp11 + 2.0 * m11 + hq11),
        0.25 * (m12 - hp12 - m21 + hq12),
        0.25 * (hp12 + m12 + m21 + hq12),
        0.25 * (hp11 - hq11),
        0.25 * (hp22 - 2.0 * m22 + hq22),
        0.25 * (hq22 - hp22),
        0.25 * (m12 - hp12 + m21 - hq12),
        0.25 * (hp22 + 2.0 * m22 + hq22),
        0.25 * (hp12 + m12 - m21 - hq12),
        0.25 * (hp11 - 2.0 * m11 + hq11),
    ]
}

/// Positive semidefinite part of `[a b; b c]` (with a relative floor) and its largest absolute eigenvalue.
#[inline(always)]
fn project_2x2([a, b, c]: [Lanes; 3]) -> ([Lanes; 3], Lanes) {
    let (mean, half) = (0.5 * (a + c), 0.5 * (a - c));
    let root = (half * half + b * b).sqrt();
    let (high, low) = (mean + root, mean - root);
    let largest = high.abs().max(low.abs());
    let floor = 1e-9 * largest;
    let (new_high, new_low) = (high.max(floor), low.max(floor));
    // With equal eigenvalues the matrix is a multiple of the identity: no slope is needed.
    let apart = root - 1e-15 * largest;
    let slope = apart.where_positive((new_high - new_low) / (2.0 * root + Lanes::splat(TINY)), Lanes::ZERO);
    let shift = 0.5 * (new_high + new_low) - slope * mean;
    let definite = low - floor;
    let pick = |old: Lanes, new: Lanes| definite.where_positive(old, new);
    ([pick(a, slope * a + shift), pick(b, slope * b), pick(c, slope * c + shift)], largest)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn lanes(a: [f64; 4]) -> [Lanes; 4] {
        a.map(Lanes::splat)
    }

    fn energy_of(a: [f64; 4], eps: f64, lambda: f64) -> f64 {
        energy(&lanes(a), eps, lambda).0.0[3]
    }

    fn gradient_of(a: [f64; 4], eps: f64, lambda: f64) -> (f64, f64, [f64; 4]) {
        let (e, det, g) = gradient(&lanes(a), eps, lambda);
        (e.0[3], det.0[3], g.map(|v| v.0[3]))
    }

    fn hessian_of(a: [f64; 4], eps: f64, lambda: f64, kind: HessianKind) -> [[f64; 4]; 4] {
        unpack(hessian(&lanes(a), eps, lambda, kind).map(|v| v.0[3]))
    }

    fn unpack(h: [f64; 10]) -> [[f64; 4]; 4] {
        std::array::from_fn(|i| std::array::from_fn(|j| h[PACKED[i][j]]))
    }

    proptest! {
        #[test]
        fn derivatives_match_differences(a in prop::array::uniform4(-2.0f64..2.0), eps in 0.05f64..1.0, lambda in 0.0f64..1.0) {
            let (_, _, g) = gradient_of(a, eps, lambda);
            let h = hessian_of(a, eps, lambda, HessianKind::Exact);
            let step = 1e-5;
            for i in 0..4 {
                let (mut up, mut down) = (a, a);
                up[i] += step;
                down[i] -= step;
                let scale = 1.0 + g.iter().fold(0.0f64, |m, x| m.max(x.abs())) + h[i].iter().fold(0.0f64, |m, x| m.max(x.abs()));
                let difference = (energy_of(up, eps, lambda) - energy_of(down, eps, lambda)) / (2.0 * step);
                prop_assert!((difference - g[i]).abs() < 1e-4 * scale / eps);
                let (gu, gd) = (gradient_of(up, eps, lambda).2, gradient_of(down, eps, lambda).2);
                for j in 0..4 {
                    prop_assert!(((gu[j] - gd[j]) / (2.0 * step) - h[i][j]).abs() < 1e-3 * scale / eps);
                }
            }
        }

        #[test]
        fn projection_is_definite_and_keeps_definite_hessians(a in prop::array::uniform4(-2.0f64..2.0), x in prop::array::uniform4(-1.0f64..1.0), eps in 1e-9f64..1.0) {
            let quadratic = |h: [[f64; 4]; 4]| -> f64 { (0..4).map(|i| (0..4).map(|j| x[i] * h[i][j] * x[j]).sum::<f64>()).sum() };
            let exact = hessian_of(a, eps, 0.3, HessianKind::Exact);
            let projected = hessian_of(a, eps, 0.3, HessianKind::Projected);
            let size = projected.iter().flatten().fold(0.0f64, |m, v| m.max(v.abs()));
            prop_assert!(quadratic(projected) >= -1e-12 * size);
            // The projection only lifts: it is an upper bound of the exact form.
            prop_assert!(quadratic(projected) >= quadratic(exact) - 1e-7 * size);
        }
    }

    #[test]
    fn similarities_and_singular_matrices_have_finite_hessians() {
        for a in [
            [1.0, 0.0, 0.0, 1.0],
            [1.0, 0.0, 0.0, -1.0],
            [0.0; 4],
            [1.0, 1.0, 1.0, 1.0],
            [-2.0, 0.0, 0.0, -2.0],
        ] {
            for kind in [HessianKind::Exact, HessianKind::Projected] {
                assert!(hessian_of(a, 1e-3, 0.3, kind).iter().flatten().all(|v| v.is_finite()), "{a:?}");
            }
        }
    }

    #[test]
    fn rotations_minimise_the_energy() {
        for k in 0..8 {
            let (s, c) = (f64::from(k) * 0.7).sin_cos();
            let (e, det, g) = gradient_of([c, -s, s, c], 1e-9, 0.3);
            assert!((e - 2.6).abs() < 1e-12 && (det - 1.0).abs() < 1e-15);
            assert!(g.iter().all(|v| v.abs() < 1e-12));
        }
    }
}
