//! Polynomials in Bernstein form that carry a rigorous bound on their rounding error.
//!
//! Every operation adds an a-priori bound (unit roundoff [`U`], constants stated where they are used), so that
//! `|computed coefficient - true coefficient| <= err` always holds. Bounds are a few times larger than needed;
//! [`SLACK`] covers products of errors and the rounding of the bounds themselves.
//!
//! A sum or difference of floating-point numbers has a relative error of at most `U` even where it is subnormal; a
//! product or quotient may lose another 2⁻¹⁰⁷⁵ to underflow. Data are scaled once to magnitude one (a power of two,
//! see [`power_of_two_above`]), so that what follows a loss multiplies it by little; [`TINY`], 10³² times larger, covers
//! all losses of an operation, times one plus what the operation multiplies by. Overflow makes the bound infinite or
//! NaN, and no comparison `> err` holds against either: it counts against the proof. Knots are taken as they are
//! stored, however close: their differences are as exact as any. The page `docs/rounding.md` lists every bound.

use std::cmp::Ordering;

use crate::spline::spans;

/// Unit roundoff of `f64`.
pub const U: f64 = f64::EPSILON / 2.0;
/// Factor on first-order bounds that covers all higher-order terms.
pub const SLACK: f64 = 1.01;
/// Absolute error that covers underflow, of numbers up to about one.
pub const TINY: f64 = 1e-290;
/// Largest degree of a product: up to here all binomial coefficients are exact in `f64`.
pub const MAX_DEGREE: usize = 56;

static BINOMIALS: [[f64; MAX_DEGREE + 1]; MAX_DEGREE + 1] = pascal();

const fn pascal() -> [[f64; MAX_DEGREE + 1]; MAX_DEGREE + 1] {
    let mut c = [[0.0; MAX_DEGREE + 1]; MAX_DEGREE + 1];
    let mut n = 0;
    while n <= MAX_DEGREE {
        c[n][0] = 1.0;
        let mut k = 1;
        while k <= n {
            c[n][k] = c[n - 1][k - 1] + c[n - 1][k];
            k += 1;
        }
        n += 1;
    }
    c
}

/// Coefficients from here on might overflow in what follows: nothing is known of them.
const HUGE: f64 = 1e300;

/// A power of two not below `x` and at most twice as large: division by it is exact unless the result is subnormal.
///
/// Limited to 2^±1000, so that neither it nor its reciprocal overflows; 1 for zero, infinity and NaN.
pub fn power_of_two_above(x: f64) -> f64 {
    if !(x > 0.0 && x.is_finite()) {
        return 1.0;
    }
    let limit = 2f64.powi(1000);
    if x >= limit {
        return limit;
    }
    let power = f64::from_bits(x.max(limit.recip()).to_bits() & (0x7ff << 52));
    if power < x { 2.0 * power } else { power }
}

/// The larger number, NaN if any is.
pub fn larger(a: f64, b: f64) -> f64 {
    if b > a || b.is_nan() { b } else { a }
}

/// A bivariate polynomial on the unit square, `coefs[i * (degrees[1] + 1) + j]` with `i` along the first variable.
#[derive(Clone, Debug, PartialEq)]
pub struct BoundedBernstein {
    /// Degrees in the two variables.
    pub degrees: [usize; 2],
    /// Bernstein coefficients.
    pub coefs: Vec<f64>,
    /// No coefficient is farther than this from its true value.
    pub err: f64,
}

impl BoundedBernstein {
    fn new(degrees: [usize; 2], coefs: Vec<f64>, err: f64) -> Self {
        let mut new = Self { degrees, coefs, err };
        if !matches!(new.magnitude().partial_cmp(&HUGE), Some(Ordering::Less)) {
            new.err = f64::INFINITY;
        }
        new
    }

    /// Largest absolute coefficient, NaN if any is.
    pub fn magnitude(&self) -> f64 {
        self.coefs.iter().fold(0.0, |m, c| larger(m, c.abs()))
    }

    /// `Σ sign · a · b` over terms whose products all have the same degrees.
    ///
    /// A product's coefficient is a convex combination of products `a_i b_j`. Rounding: one operation for each
    /// of the two binomial weights and the product, one an addition, two for the division. Underflow: binomials below
    /// 10²¹ multiply what a factor has lost, in at most 1444 terms.
    pub fn sum_of_products(terms: &[(f64, &Self, &Self)]) -> Self {
        let degrees: [usize; 2] = std::array::from_fn(|d| terms[0].1.degrees[d] + terms[0].2.degrees[d]);
        let [m, n] = degrees;
        let (wu, wv) = (&BINOMIALS[m], &BINOMIALS[n]);
        let mut coefs = vec![0.0; (m + 1) * (n + 1)];
        let (mut carried, mut scale, mut lost, mut count) = (0.0, 0.0, 1.0, 0);
        let mut weighted = Vec::new();
        for &(sign, a, b) in terms {
            debug_assert!((0..2).all(|d| a.degrees[d] + b.degrees[d] == degrees[d]));
            b.weighted_into(&mut weighted);
            let (width_a, width_b) = (a.degrees[1] + 1, b.degrees[1] + 1);
            let (au, av) = (&BINOMIALS[a.degrees[0]], &BINOMIALS[a.degrees[1]]);
            for i in 0..=a.degrees[0] {
                for j in 0..width_a {
                    let factor = sign * (au[i] * av[j]) * a.coefs[i * width_a + j];
                    for (k, row) in weighted.chunks_exact(width_b).enumerate() {
                        let out = &mut coefs[(i + k) * (n + 1) + j..][..width_b];
                        for (o, w) in out.iter_mut().zip(row) {
                            *o += factor * w;
                        }
                    }
                }
            }
            let (ma, mb) = (a.magnitude(), b.magnitude());
            carried += a.err * mb + b.err * ma + a.err * b.err;
            scale += ma * mb;
            lost += ma + mb;
            count += (0..2).map(|d| a.degrees[d].min(b.degrees[d]) + 1).product::<usize>();
        }
        for i in 0..=m {
            for j in 0..=n {
                coefs[i * (n + 1) + j] /= wu[i] * wv[j];
            }
        }
        Self::new(degrees, coefs, SLACK * (carried + (count + 8) as f64 * U * scale) + TINY * lost)
    }

    fn weighted_into(&self, out: &mut Vec<f64>) {
        let (wu, wv) = (&BINOMIALS[self.degrees[0]], &BINOMIALS[self.degrees[1]]);
        let width = self.degrees[1] + 1;
        out.clear();
        out.extend(self.coefs.iter().enumerate().map(|(i, c)| wu[i / width] * wv[i % width] * c));
    }

    /// Derivative along `axis`, of a polynomial whose variable runs over an interval of length `h`.
    ///
    /// `relative` bounds the relative error of `h`.
    pub fn derivative(&self, axis: usize, h: f64, relative: f64) -> Self {
        let n = self.degrees[axis];
        let mut degrees = self.degrees;
        degrees[axis] -= 1;
        let (width, step) = (self.degrees[1] + 1, if axis == 0 { self.degrees[1] + 1 } else { 1 });
        let factor = n as f64 / h;
        let mut coefs = Vec::with_capacity((degrees[0] + 1) * (degrees[1] + 1));
        for i in 0..=degrees[0] {
            for j in 0..=degrees[1] {
                let at = i * width + j;
                coefs.push(factor * (self.coefs[at + step] - self.coefs[at]));
            }
        }
        let magnitude = coefs.iter().fold(0.0, |m, c| larger(m, c.abs()));
        Self::new(degrees, coefs, SLACK * (2.0 * factor * self.err + (3.0 * U + relative) * magnitude) + TINY)
    }

    /// The two halves along `axis` (de Casteljau), each on the unit square again.
    ///
    /// Each of the `n` averages rounds once, relative to the largest coefficient.
    pub fn halve(&self, axis: usize) -> [Self; 2] {
        self.cut(axis, 1.0, |a, b| 0.5 * (a + b))
    }

    /// The parts before and after `t` along `axis`.
    ///
    /// Each of the `n` averages takes the roundings of 1 - t, of two products and of a sum.
    pub fn split(&self, axis: usize, t: f64) -> [Self; 2] {
        self.cut(axis, 4.0, |a, b| (1.0 - t) * a + t * b)
    }

    fn cut(&self, axis: usize, roundings: f64, average: impl Fn(f64, f64) -> f64) -> [Self; 2] {
        let n = self.degrees[axis];
        let width = self.degrees[1] + 1;
        let (step, lines, stride) =
            if axis == 0 { (width, width, 1) } else { (1, self.degrees[0] + 1, width) };
        let (mut low, mut high) = (self.clone(), self.clone());
        for line in 0..lines {
            let at = |i: usize| line * stride + i * step;
            for level in 1..=n {
                for i in 0..=n - level {
                    high.coefs[at(i)] = average(high.coefs[at(i)], high.coefs[at(i + 1)]);
                }
                low.coefs[at(level)] = high.coefs[at(0)];
            }
        }
        let err = self.err + SLACK * roundings * n as f64 * U * (self.magnitude() + self.err) + TINY;
        low.err = err;
        high.err = err;
        [low, high]
    }

    /// The polynomial that is one, in a form of these degrees.
    pub fn one(degrees: [usize; 2]) -> Self {
        Self { degrees, coefs: vec![1.0; (degrees[0] + 1) * (degrees[1] + 1)], err: 0.0 }
    }

    /// Times a power of two, which rounds nothing but what becomes subnormal.
    pub fn times_power(&self, power: f64) -> Self {
        let coefs = self.coefs.iter().map(|c| power * c).collect();
        Self::new(self.degrees, coefs, power * self.err + TINY)
    }

    /// Value at the centre, and a bound on its error: weights are exact, a sum has as many roundings as terms.
    pub fn centre(&self) -> (f64, f64) {
        let [m, n] = self.degrees;
        let rows = self.coefs.chunks_exact(n + 1);
        let value: f64 = rows.zip(&BINOMIALS[m]).map(|(row, b)| b * dot(row, &BINOMIALS[n])).sum();
        let err = SLACK * (m + n + 6) as f64 * U * self.magnitude() + self.err + TINY;
        (value * 0.5f64.powi((m + n) as i32), err)
    }

    /// Value at `(s, t)` in the unit square, without a bound.
    pub fn value(&self, s: f64, t: f64) -> f64 {
        let (bu, bv) = (basis(self.degrees[0], s), basis(self.degrees[1], t));
        self.coefs.chunks_exact(bv.len()).zip(&bu).map(|(row, b)| b * dot(row, &bv)).sum()
    }

    /// Values on a grid, without bounds: `bu` and `bv` hold the basis at its nodes, a row a node.
    pub fn grid(&self, bu: &[Vec<f64>], bv: &[Vec<f64>]) -> Vec<f64> {
        let n = bv.len();
        let rows = self.coefs.chunks_exact(self.degrees[1] + 1);
        let along: Vec<f64> = rows.flat_map(|row| bv.iter().map(|b| dot(row, b))).collect();
        let mut values = vec![0.0; bu.len() * n];
        for (out, b) in values.chunks_exact_mut(n).zip(bu) {
            for (row, b) in along.chunks_exact(n).zip(b) {
                out.iter_mut().zip(row).for_each(|(o, x)| *o += b * x);
            }
        }
        values
    }
}

/// Bernstein polynomials of degree `n` at `x`.
pub fn basis(n: usize, x: f64) -> Vec<f64> {
    (0..=n).map(|i| BINOMIALS[n][i] * x.powi(i as i32) * (1.0 - x).powi((n - i) as i32)).collect()
}

/// Dot product of equally long slices.
fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(x, y)| x * y).sum()
}

/// Bézier extraction of a univariate spline space, span by span.
///
/// On span `s`, Bézier coefficient `b` is `Σ_a matrix(s)[b][a] c[first[s] + a]`; all entries are non-negative
/// and rows sum to one. Entries are sums of products of quotients of knot differences, without cancellation, so
/// that each has a relative error of at most `relative` (which includes the rounding of a row's dot product), however
/// close knots are.
#[derive(Clone, Debug)]
pub struct Extraction {
    /// Degree.
    pub degree: usize,
    /// First coefficient that lives on each non-empty span.
    pub first: Vec<usize>,
    /// End points of each non-empty span.
    pub ends: Vec<[f64; 2]>,
    /// Bound on the relative error of the entries.
    pub relative: f64,
    matrices: Vec<f64>,
}

impl Extraction {
    /// Extraction for `degree` (0 allowed) on `knots`; interior knots may have any multiplicity up to
    /// `degree + 1`, a jump, as derivatives of continuous splines have.
    pub fn new(knots: &[f64], degree: usize) -> Self {
        let d = degree;
        let indices = spans(knots, d);
        let mut matrices = Vec::with_capacity(indices.len() * (d + 1) * (d + 1));
        let mut c = vec![0.0; (d + 1) * (d + 1)];
        for &k in &indices {
            for b in 0..=d {
                // The blossom at (t_k, ..., t_{k+1}, ...), b copies of the right end, of the unit vectors.
                c.fill(0.0);
                for i in 0..=d {
                    c[i * (d + 1) + i] = 1.0;
                }
                for r in 1..=d {
                    let x = if r <= b { knots[k + 1] } else { knots[k] };
                    for i in (r..=d).rev() {
                        let (lo, hi) = (knots[k + i - d], knots[k + 1 + i - r]);
                        let (right, left) = ((x - lo) / (hi - lo), (hi - x) / (hi - lo));
                        for a in 0..=d {
                            c[i * (d + 1) + a] = left * c[(i - 1) * (d + 1) + a] + right * c[i * (d + 1) + a];
                        }
                    }
                }
                matrices.extend_from_slice(&c[d * (d + 1)..]);
            }
        }
        let steps = d as f64;
        // A step: 3 roundings in the quotient, one product, one sum.
        let mut relative = SLACK * (steps * 6.0 * U + (steps + 2.0) * U);
        if !(knots[knots.len() - 1] - knots[0]).is_finite() {
            relative = f64::INFINITY;
        }
        Self {
            degree,
            first: indices.iter().map(|k| k - d).collect(),
            ends: indices.iter().map(|&k| [knots[k], knots[k + 1]]).collect(),
            relative,
            matrices,
        }
    }

    /// Extraction matrix of a span, row after row.
    pub fn matrix(&self, span: usize) -> &[f64] {
        let size = (self.degree + 1) * (self.degree + 1);
        &self.matrices[span * size..][..size]
    }
}

/// Apply two extractions to the coefficients `local(a, b)` of a tensor-product spline on the span pair `at`.
///
/// `relative` bounds the relative error of the local coefficients themselves, `absolute` what else they are off by.
pub fn extract(
    eu: &Extraction,
    ev: &Extraction,
    at: [usize; 2],
    [relative, absolute]: [f64; 2],
    local: impl Fn(usize, usize) -> f64,
) -> BoundedBernstein {
    let (m, n) = (eu.degree + 1, ev.degree + 1);
    let (mu, mv) = (eu.matrix(at[0]), ev.matrix(at[1]));
    let mut half = vec![0.0; m * n];
    let mut largest: f64 = 0.0;
    let mut row = vec![0.0; n];
    for a in 0..m {
        for (b, r) in row.iter_mut().enumerate() {
            *r = local(a, b);
            largest = larger(largest, r.abs());
        }
        for j in 0..n {
            half[a * n + j] = dot(&mv[j * n..][..n], &row);
        }
    }
    let mut coefs = vec![0.0; m * n];
    for i in 0..m {
        for a in 0..m {
            let weight = mu[i * m + a];
            for j in 0..n {
                coefs[i * n + j] += weight * half[a * n + j];
            }
        }
    }
    let err = SLACK * ((relative + eu.relative + ev.relative) * largest + absolute) + TINY * (1.0 + largest);
    BoundedBernstein::new([m - 1, n - 1], coefs, err)
}
