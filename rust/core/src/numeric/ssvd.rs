//! Signed singular values of 2×2 matrices and the projection onto bounded conformal distortion, in closed form.
//!
//! A matrix [[a, b], [c, d]], read as a map of the complex plane, is ζ ↦ zζ + w ζ̄ with z = ((a+d) + i(c−b))/2 and
//! w = ((a−d) + i(c+b))/2. Its signed singular values are σ₁ = |z| + |w| and σ₂ = |z| − |w| (negative when it
//! reverses orientation), and its squared Frobenius norm is 2(|z|² + |w|²). Hence 1 ≤ σ₁/σ₂ ≤ k is the cone
//! |w| ≤ μ|z|, μ = (k−1)/(k+1). The nearest point keeps both arguments and, for a matrix outside, moves
//! (|z|, |w|) to its foot on the ray (1, μ): |z|' = (|z| + μ|w|)/(1 + μ²), |w|' = μ|z|'.

use rayon::prelude::*;

use crate::numeric::lanes::{Vectorizable, vectorized};

/// Faces of a task: some 2 µs of work, which costs no time to split (measured) from inside the pool; meshes of
/// control points, of up to 1500 faces on the samples, are split.
const CHUNK: usize = 512;
/// Matrices whose factors are kept between two loops.
const TILE: usize = 128;

/// Signed singular values σ₁ ≥ |σ₂| of a row-major matrix; σ₂ has the sign of its determinant.
#[inline]
pub fn signed_singular_values(j: [f64; 4]) -> [f64; 2] {
    let [a, b, c, d] = j;
    let z = f64::hypot(a + d, c - b) / 2.0;
    let w = f64::hypot(a - d, c + b) / 2.0;
    [z + w, z - w]
}

/// The matrix of conformal distortion at most `k` (finite, at least 1) that is nearest in the Frobenius norm.
///
/// At z = 0 the nearest matrices form a circle; the one with a positive real z is taken.
#[inline]
pub fn project(j: [f64; 4], k: f64) -> [f64; 4] {
    let factors = factors(j, k);
    if factors.outside > 0.0 && factors.product == 0.0 {
        let [a, b, c, d] = j;
        return project_anticonformal(a - d, c + b, k);
    }
    apply(j, factors)
}

/// What [`project`] multiplies z and w by.
#[derive(Clone, Copy)]
struct Factors {
    /// |z|'/2|z|.
    z: f64,
    /// |w|'/2|w|.
    w: f64,
    /// Positive outside the cone.
    outside: f64,
    /// 4|z||w|; if this vanishes outside the cone, the factors do not hold.
    product: f64,
}

/// Without a branch, for matrices inside as well: nobody can predict which ones are, and several can go at a time.
#[inline(always)]
fn factors([a, b, c, d]: [f64; 4], k: f64) -> Factors {
    // Twice z and w: the factors depend on ratios only.
    let (zr, zi, wr, wi) = (a + d, c - b, a - d, c + b);
    let (s2, t2) = (zr * zr + zi * zi, wr * wr + wi * wi);
    let (more, less) = (k + 1.0, k - 1.0);
    let st = (s2 * t2).sqrt();
    // Over a common denominator, one root and one division in all.
    let q = 0.25 / ((k * k + 1.0) * st);
    Factors {
        z: q * more * (more * st + less * t2),
        w: q * less * (more * s2 + less * st),
        outside: more * more * t2 - less * less * s2,
        product: st,
    }
}

#[inline(always)]
fn apply([a, b, c, d]: [f64; 4], factors: Factors) -> [f64; 4] {
    let (zr, zi) = (factors.z * (a + d), factors.z * (c - b));
    let (wr, wi) = (factors.w * (a - d), factors.w * (c + b));
    if factors.outside > 0.0 { [zr + wr, wi - zi, zi + wi, zr - wr] } else { [a, b, c, d] }
}

/// The case z = 0 (or so small that its square vanishes), of 2w = (wr, wi).
#[cold]
fn project_anticonformal(wr: f64, wi: f64, k: f64) -> [f64; 4] {
    let norm = 0.25 * (k - 1.0) / (k * k + 1.0);
    let z = norm * (k + 1.0) * wr.hypot(wi);
    let (wr, wi) = (norm * (k - 1.0) * wr, norm * (k - 1.0) * wi);
    [z + wr, wi, wi, z - wr]
}

/// Project every matrix with its own bound. The slices must be equally long.
pub fn project_all(j: &[[f64; 4]], k: &[f64], out: &mut [[f64; 4]]) {
    assert!(j.len() == k.len() && j.len() == out.len(), "one bound and one output for each matrix");
    out.par_chunks_mut(CHUNK).zip(j.par_chunks(CHUNK).zip(k.par_chunks(CHUNK))).for_each(|(out, (j, k))| {
        vectorized(Projection { j, k, out });
    });
}

/// Projection of a slice.
struct Projection<'a> {
    j: &'a [[f64; 4]],
    k: &'a [f64],
    out: &'a mut [[f64; 4]],
}

impl Vectorizable for Projection<'_> {
    type Output = ();

    #[inline(always)]
    fn run<const FUSED: bool>(self) {
        let (tiles, rest) = self.out.as_chunks_mut::<TILE>();
        let ((j, j_rest), (k, k_rest)) = (self.j.as_chunks::<TILE>(), self.k.as_chunks::<TILE>());
        for ((j, k), out) in j.iter().zip(k).zip(tiles) {
            project_tile(j, k, out);
        }
        for ((j, &k), out) in j_rest.iter().zip(k_rest).zip(rest) {
            *out = project(*j, k);
        }
    }
}

/// The factors of all first: in one loop with what they are for, they are not computed several at a time.
#[inline(always)]
fn project_tile(j: &[[f64; 4]; TILE], k: &[f64; TILE], out: &mut [[f64; 4]; TILE]) {
    let (mut z, mut w, mut outside, mut product) = ([0.0; TILE], [0.0; TILE], [0.0; TILE], [0.0; TILE]);
    for i in 0..TILE {
        let f = factors(j[i], k[i]);
        (z[i], w[i], outside[i], product[i]) = (f.z, f.w, f.outside, f.product);
    }
    let mut irregular = false;
    for i in 0..TILE {
        irregular |= (outside[i] > 0.0) & (product[i] == 0.0);
        out[i] = apply(j[i], Factors { z: z[i], w: w[i], outside: outside[i], product: product[i] });
    }
    if irregular {
        for i in 0..TILE {
            out[i] = project(j[i], k[i]);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn distance(p: [f64; 4], q: [f64; 4]) -> f64 {
        (0..4).map(|i| (p[i] - q[i]).powi(2)).sum::<f64>().sqrt()
    }

    proptest! {
        #[test]
        fn is_the_nearest_point(j in prop::array::uniform4(-2.0..2.0f64), k in 1.0..20.0f64,
                                others in prop::collection::vec(prop::array::uniform4(-2.0..2.0f64), 20)) {
            let h = project(j, k);
            let [s1, s2] = signed_singular_values(h);
            prop_assert!(s2 >= 0.0 && s1 <= k * s2 * (1.0 + 1e-9) + 1e-12);
            for other in others {
                // Any member of the set is at least as far away.
                prop_assert!(distance(j, project(other, k)) >= distance(j, h) - 1e-12);
            }
            prop_assert!(distance(project(h, k), h) < 1e-12);
            let det = j[0] * j[3] - j[1] * j[2];
            let [s1, s2] = signed_singular_values(j);
            prop_assert!((s1 * s2 - det).abs() < 1e-12);
        }
    }

    #[test]
    fn anticonformal_and_zero() {
        let h = project([1.0, 0.0, 0.0, -1.0], 3.0);
        let [s1, s2] = signed_singular_values(h);
        assert!((s1 - 3.0 * s2).abs() < 1e-15 && s2 > 0.0);
        // |w| = 1, μ = 1/2: the distance is |w|/√(1+μ²) in (z, w), √2 times that in the Frobenius norm.
        assert!((distance(h, [1.0, 0.0, 0.0, -1.0]) - (2.0f64 / 1.25).sqrt()).abs() < 1e-15);
        assert_eq!(project([0.0; 4], 3.0), [0.0; 4]);
    }

    #[test]
    fn in_bulk() {
        let mut j: Vec<[f64; 4]> =
            (0..20_003).map(|i| [0, 1, 2, 3].map(|c| f64::sin((4 * i + c) as f64))).collect();
        // Some at z = 0 among the others, one of them nothing but zeros.
        j[9] = [1.0, 0.5, 0.5, -1.0];
        j[8_200] = [0.0; 4];
        j[20_001] = [0.0, 2.0, 2.0, 0.0];
        let k: Vec<f64> = (0..j.len()).map(|i| 1.0 + (i % 7) as f64).collect();
        let mut out = vec![[0.0; 4]; j.len()];
        project_all(&j, &k, &mut out);
        assert!((0..j.len()).all(|i| out[i] == project(j[i], k[i])));
    }
}
