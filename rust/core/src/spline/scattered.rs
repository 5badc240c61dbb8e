//! Tensor-product splines at points that are no grid.

use crate::spline::derivatives_on_span;
use rayon::prelude::*;

/// Points that a thread takes at once.
const CHUNK: usize = 1024;

/// A bivariate spline whose coefficients `[i, j]` are `width` numbers each, in C order.
#[derive(Clone, Copy, Debug)]
pub struct TensorSpline<'a> {
    /// Degrees in u and v.
    pub degrees: [usize; 2],
    /// Clamped knot vectors.
    pub knots: [&'a [f64]; 2],
    /// Coefficients.
    pub coefficients: &'a [f64],
    /// Numbers a coefficient.
    pub width: usize,
}

impl TensorSpline<'_> {
    /// Derivatives of `orders` at the points `(u[k], v[k])`, one after the other, in parallel.
    ///
    /// The polynomial pieces at the ends continue beyond them; at a knot the piece after it counts.
    pub fn at_points(&self, u: &[f64], v: &[f64], orders: [usize; 2]) -> Vec<f64> {
        let mut out = vec![0.0; u.len() * self.width];
        let chunks = out.par_chunks_mut(CHUNK * self.width);
        chunks.zip(u.par_chunks(CHUNK).zip(v.par_chunks(CHUNK))).for_each(|(out, (u, v))| {
            let mut work = self.degrees.map(|p| vec![0.0; 2 * p + 2]);
            let mut row = vec![0.0; self.width];
            for (out, at) in out.chunks_exact_mut(self.width).zip(u.iter().zip(v)) {
                self.add([*at.0, *at.1], orders, &mut work, &mut row, out);
            }
        });
        out
    }

    fn add(
        &self,
        at: [f64; 2],
        orders: [usize; 2],
        work: &mut [Vec<f64>; 2],
        row: &mut [f64],
        out: &mut [f64],
    ) {
        let mut first = [0; 2];
        for d in 0..2 {
            let (knots, p) = (self.knots[d], self.degrees[d]);
            let k = knots.partition_point(|&x| x <= at[d]).saturating_sub(1).clamp(p, knots.len() - p - 2);
            derivatives_on_span(knots, p, k, at[d], orders[d], &mut work[d]);
            first[d] = k - p;
        }
        let [along_u, along_v] = [0, 1].map(|d| &work[d][..=self.degrees[d]]);
        let columns = self.knots[1].len() - self.degrees[1] - 1;
        for (a, b) in along_u.iter().enumerate() {
            row.fill(0.0);
            let from = ((first[0] + a) * columns + first[1]) * self.width;
            for (c, b) in self.coefficients[from..].chunks_exact(self.width).zip(along_v) {
                row.iter_mut().zip(c).for_each(|(sum, c)| *sum += c * b);
            }
            out.iter_mut().zip(&*row).for_each(|(sum, x)| *sum += b * x);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::spline::evaluate;

    /// Σ f_i(u) g_j(v) c_ij for c_ij = a_i b_j is a product of curves.
    #[test]
    fn derivatives_of_products_are_products_of_derivatives() {
        let (ku, kv) = ([0.0, 0.0, 0.0, 0.4, 1.0, 1.0, 1.0], [2.0, 2.0, 2.5, 2.5, 3.0, 3.0]);
        let (a, b) = ([1.0, -2.0, 0.5, 3.0], [2.0, 1.0, -1.0, 4.0]);
        // The second curve is linear with a jump of the value, which the core allows here.
        let c: Vec<f64> = a.iter().flat_map(|x| b.iter().flat_map(move |y| [x * y, -x * y])).collect();
        let spline = TensorSpline { degrees: [2, 1], knots: [&ku, &kv], coefficients: &c, width: 2 };
        let u: Vec<f64> = (0..=5000).map(|k| f64::from(k) / 5000.0).collect();
        let v: Vec<f64> = u.iter().map(|t| 3.0 - t).collect();
        for orders in [[0, 0], [1, 0], [0, 1], [2, 1], [3, 0]] {
            let found = spline.at_points(&u, &v, orders);
            let (f, g) = (evaluate(&ku, 2, &a, 1, &u, orders[0]), evaluate(&kv, 1, &b, 1, &v, orders[1]));
            for (k, x) in found.chunks_exact(2).enumerate() {
                let wanted = f[k] * g[k];
                assert!((x[0] - wanted).abs() <= 1e-13 * (1.0 + wanted.abs()) && x[1] == -x[0]);
            }
        }
    }
}
