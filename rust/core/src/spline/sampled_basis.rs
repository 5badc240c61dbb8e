//! Basis functions of a curve at samples, function by function, with the products that normal equations need.

/// A row of numbers over the samples `from..from + values.len()`, zero elsewhere.
#[derive(Clone, Debug)]
struct Column {
    from: usize,
    values: Vec<f64>,
}

impl Column {
    /// Without the zeros at both ends.
    fn trimmed(values: &[f64]) -> Self {
        let from = values.iter().position(|&b| b != 0.0).unwrap_or(0);
        let to = values.iter().rposition(|&b| b != 0.0).map_or(from, |last| last + 1);
        Self { from, values: values[from..to].to_vec() }
    }

    fn times(&self, other: &Self) -> Self {
        let from = self.from.max(other.from);
        let to = (self.from + self.values.len()).min(other.from + other.values.len()).max(from);
        let pairs = (from..to).map(|k| self.values[k - self.from] * other.values[k - other.from]);
        Self { from, values: pairs.collect() }
    }

    /// Sum of products with numbers at all samples, in four sums at once: that makes vector instructions.
    fn dot(&self, numbers: &[f64]) -> f64 {
        let numbers = &numbers[self.from..][..self.values.len()];
        let (fours, others) = (self.values.chunks_exact(4), numbers.chunks_exact(4));
        let rest: f64 = fours.remainder().iter().zip(others.remainder()).map(|(a, b)| a * b).sum();
        let mut sums = [0.0; 4];
        for (a, b) in fours.zip(others) {
            for lane in 0..4 {
                sums[lane] += a[lane] * b[lane];
            }
        }
        (sums[0] + sums[1]) + (sums[2] + sums[3]) + rest
    }
}

/// Basis functions at samples of a curve, from its start to its end.
#[derive(Clone, Debug)]
pub struct SampledBasis {
    /// Number of samples.
    pub samples: usize,
    functions: Vec<Column>,
    /// Products of inner functions `[i, j]`, `j <= i`, counted without the first, where any sample needs them.
    products: Vec<([usize; 2], Column)>,
}

impl SampledBasis {
    /// From row-major values, a row a sample, for `n` control points.
    pub fn new(n: usize, values: &[f64]) -> Self {
        let functions: Vec<Column> = (0..n)
            .map(|i| Column::trimmed(&values.iter().skip(i).step_by(n).copied().collect::<Vec<_>>()))
            .collect();
        let inner = &functions[1..n - 1];
        let products = (0..inner.len())
            .flat_map(|i| (0..=i).map(move |j| ([i, j], inner[i].times(&inner[j]))))
            .filter(|(_, product)| !product.values.is_empty())
            .collect();
        Self { samples: values.len() / n, functions, products }
    }

    /// Number of control points.
    pub fn control_points(&self) -> usize {
        self.functions.len()
    }

    /// Add `c` times function `i` to points at the samples.
    pub fn add(&self, i: usize, c: [f64; 2], points: &mut [[f64; 2]]) {
        let column = &self.functions[i];
        for (p, b) in points[column.from..].iter_mut().zip(&column.values) {
            p[0] += b * c[0];
            p[1] += b * c[1];
        }
    }

    /// Normal matrix (row-major, inner control points' coordinates interleaved) for `metric` = xx, xy, yy at all samples.
    pub fn normal_matrix(&self, metric: [&[f64]; 3], out: &mut Vec<f64>) {
        let size = 2 * (self.functions.len() - 2);
        out.clear();
        out.resize(size * size, 0.0);
        for ([i, j], product) in &self.products {
            let [xx, xy, yy] = metric.map(|numbers| product.dot(numbers));
            for (a, b, x) in [(0, 0, xx), (0, 1, xy), (1, 0, xy), (1, 1, yy)] {
                out[(2 * i + a) * size + 2 * j + b] = x;
                out[(2 * j + b) * size + 2 * i + a] = x;
            }
        }
    }

    /// Sums of inner functions with x and y at all samples, coordinates interleaved.
    pub fn moments(&self, x: &[f64], y: &[f64], out: &mut Vec<f64>) {
        out.clear();
        let inner = &self.functions[1..self.functions.len() - 1];
        out.extend(inner.iter().flat_map(|function| [function.dot(x), function.dot(y)]));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn sums_are_those_over_all_samples(
            values in prop::collection::vec(prop_oneof![Just(0.0), -1.0f64..1.0], 5 * 13),
            metric in prop::collection::vec(-1.0f64..1.0, 3 * 13),
        ) {
            let (n, m) = (5, 13);
            let basis = SampledBasis::new(n, &values);
            let at = |k: usize, i: usize| values[k * n + i];
            let rows: Vec<&[f64]> = metric.chunks_exact(m).collect();
            let (mut matrix, mut moments) = (vec![], vec![]);
            basis.normal_matrix([rows[0], rows[1], rows[2]], &mut matrix);
            basis.moments(rows[0], rows[1], &mut moments);
            for i in 0..n - 2 {
                for a in 0..2 {
                    let sum: f64 = (0..m).map(|k| at(k, i + 1) * rows[a][k]).sum();
                    prop_assert!((moments[2 * i + a] - sum).abs() < 1e-13);
                    for j in 0..n - 2 {
                        for b in 0..2 {
                            let sum: f64 = (0..m).map(|k| at(k, i + 1) * at(k, j + 1) * rows[a + b][k]).sum();
                            prop_assert!((matrix[(2 * i + a) * 6 + 2 * j + b] - sum).abs() < 1e-13);
                        }
                    }
                }
            }
            let mut points = vec![[0.0; 2]; m];
            (0..n).for_each(|i| basis.add(i, [1.0, 2.0], &mut points));
            for (k, p) in points.iter().enumerate() {
                let sum: f64 = (0..n).map(|i| at(k, i)).sum();
                prop_assert!((p[0] - sum).abs() < 1e-14 && (p[1] - 2.0 * sum).abs() < 1e-14);
            }
        }
    }
}
