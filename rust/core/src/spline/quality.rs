//! Scaled Jacobian and condition number on a uniform grid of every knot span (Eq. 19–21 of the paper).
//!
//! Row by row: control points are contracted with the bases along u once for a row, and the curves that this gives
//! are sampled along v, a knot span at a time. Both ends of every span belong to the grid, each seen from inside.

use crate::numeric::lanes::{Lanes, Vectorizable, WIDTH, fused, vectorized};
use crate::spline::{SplinePatch, basis_on_span, spans};
use rayon::prelude::*;

/// Samples a span that are asked for by default.
const USUAL: usize = 10;

/// Minimum, maximum and sum of a quantity.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Range {
    /// Smallest value.
    pub min: f64,
    /// Largest value.
    pub max: f64,
    /// Sum of the finite values.
    pub sum: f64,
}

impl Range {
    const EMPTY: Self = Self { min: f64::INFINITY, max: f64::NEG_INFINITY, sum: 0.0 };

    #[inline(always)]
    fn add(&mut self, x: f64) {
        self.min = if x < self.min { x } else { self.min };
        self.max = if x > self.max { x } else { self.max };
        self.sum += if x < f64::INFINITY { x } else { 0.0 };
    }

    /// Of both; sums are added.
    pub fn join(self, other: Self) -> Self {
        Self { min: self.min.min(other.min), max: self.max.max(other.max), sum: self.sum + other.sum }
    }
}

/// Quality of one patch over its samples.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PatchQuality {
    /// det J / (|B_u| |B_v|) with the orientation's sign, 0 where a tangent vanishes.
    pub scaled_jacobian: Range,
    /// ‖J‖_F ‖J⁻¹‖_F, infinite where the scaled Jacobian is not positive.
    pub condition_number: Range,
    /// Samples in all, and those with a scaled Jacobian above zero.
    pub samples: usize,
    /// See `samples`.
    pub positive: usize,
    /// Parameters of the sample with the smallest scaled Jacobian.
    pub worst: [f64; 2],
}

/// Points and scaled Jacobians of a grid, row by row.
#[derive(Clone, Debug, PartialEq)]
pub struct Grid {
    /// Number of samples along u and v.
    pub shape: [usize; 2],
    /// Points.
    pub points: Vec<[f64; 2]>,
    /// Scaled Jacobians.
    pub scaled: Vec<f64>,
}

/// Measure all patches: with the signs of their orientations, without the corners (bits 1 and 2: at the end of u, of v).
///
/// At least 2 samples a span and direction, 3 where corners are left out.
pub fn measure(
    patches: &[SplinePatch],
    signs: &[f64],
    samples: usize,
    excluded: &[Vec<usize>],
) -> Vec<PatchQuality> {
    (0..patches.len())
        .into_par_iter()
        .map(|k| {
            let sheet = Sheet::new(&patches[k], samples);
            vectorized(Measurement { sheet: &sheet, sign: signs[k], excluded: &excluded[k] })
        })
        .collect()
}

/// Points and scaled Jacobians of a patch.
pub fn grid(patch: &SplinePatch, sign: f64, samples: usize) -> Grid {
    let sheet = Sheet::new(patch, samples);
    vectorized(GridSampling { sheet: &sheet, sign })
}

/// Basis functions at the samples of one direction.
struct GridAxis {
    degree: usize,
    samples: usize,
    /// First control point of every span.
    first: Vec<usize>,
    /// Parameters.
    t: Vec<f64>,
    /// Values and slopes: a span after the other, in it a function after the other, at all samples of the span.
    values: Vec<f64>,
    slopes: Vec<f64>,
}

impl GridAxis {
    fn new(knots: &[f64], degree: usize, samples: usize) -> Self {
        let spans = spans(knots, degree);
        let size = spans.len() * (degree + 1) * samples;
        let (mut t, mut values, mut slopes) = (vec![], vec![0.0; size], vec![0.0; size]);
        let (mut b, mut d) = (vec![0.0; degree + 1], vec![0.0; degree + 1]);
        // In units of the domain, so that no power of its length appears.
        let unit = knots[knots.len() - 1] - knots[0];
        for (s, &k) in spans.iter().enumerate() {
            for i in 0..samples {
                let x = if i + 1 == samples {
                    knots[k + 1]
                } else {
                    knots[k] + (knots[k + 1] - knots[k]) * (i as f64 / (samples - 1) as f64)
                };
                basis_on_span(knots, degree, k, x, &mut b, &mut d);
                for a in 0..=degree {
                    let at = (s * (degree + 1) + a) * samples + i;
                    (values[at], slopes[at]) = (b[a], unit * d[a]);
                }
                t.push(x);
            }
        }
        Self { degree, samples, first: spans.iter().map(|k| k - degree).collect(), t, values, slopes }
    }

    fn len(&self) -> usize {
        self.t.len()
    }

    /// Value and slope of function `a` on the span of sample `i`, there.
    #[inline(always)]
    fn at(&self, i: usize, a: usize) -> (f64, f64) {
        let at = (i / self.samples * (self.degree + 1) + a) * self.samples + i % self.samples;
        (self.values[at], self.slopes[at])
    }
}

/// A patch with the bases of its grid, its homogeneous coordinates one after the other, about its first control point.
struct Sheet {
    axes: [GridAxis; 2],
    coordinates: Vec<Vec<f64>>,
    origin: [f64; 2],
    unit: f64,
    /// Length of the domain in u over that in v.
    aspect: f64,
}

impl Sheet {
    fn new(patch: &SplinePatch, samples: usize) -> Self {
        let origin = patch.points[0];
        let offset = |p: &[f64; 2], d: usize| p[d] - origin[d];
        let size =
            patch.points.iter().flat_map(|p| [offset(p, 0).abs(), offset(p, 1).abs()]).fold(0.0, f64::max);
        // A power of two rounds nothing, and squares of lengths neither overflow nor vanish, whatever the units.
        let unit = if size > 0.0 { size.log2().ceil().clamp(-1000.0, 1000.0).exp2() } else { 1.0 };
        let weight = |k: usize| patch.weights.as_ref().map_or(1.0, |w| w[k]);
        let coordinate = |d: usize| {
            patch.points.iter().enumerate().map(|(k, p)| weight(k) * (offset(p, d) / unit)).collect()
        };
        let mut coordinates: Vec<Vec<f64>> = vec![coordinate(0), coordinate(1)];
        coordinates.extend(patch.weights.clone());
        let length = |d: usize| patch.knots[d][patch.knots[d].len() - 1] - patch.knots[d][0];
        let axes = [0, 1].map(|d| GridAxis::new(&patch.knots[d], patch.degrees[d], samples));
        Self { axes, coordinates, origin, unit, aspect: length(0) / length(1) }
    }
}

/// Buffers of a row of the grid, one array a coordinate.
struct Row<'a> {
    sheet: &'a Sheet,
    /// Coefficients along v: values and slopes along u.
    along: [Vec<Vec<f64>>; 2],
    point: Vec<Vec<f64>>,
    by_u: Vec<Vec<f64>>,
    by_v: Vec<Vec<f64>>,
    scaled: Vec<f64>,
    condition: Vec<f64>,
}

impl<'a> Row<'a> {
    fn new(sheet: &'a Sheet) -> Self {
        let (n, m) = (sheet.coordinates[0].len() / sheet.control_rows(), sheet.axes[1].len());
        let zeros = |n| vec![vec![0.0; n]; sheet.coordinates.len()];
        Self {
            sheet,
            along: [zeros(n), zeros(n)],
            point: zeros(m),
            by_u: zeros(m),
            by_v: zeros(m),
            scaled: vec![0.0; m],
            condition: vec![0.0; m],
        }
    }

    /// Derivatives of row `i`, and its points if they are wanted or need be known.
    #[inline(always)]
    fn evaluate<const FUSED: bool>(&mut self, i: usize, points: bool) {
        let [u, v] = &self.sheet.axes;
        let rational = self.sheet.coordinates.len() > 2;
        let first = u.first[i / u.samples];
        for (c, coordinates) in self.sheet.coordinates.iter().enumerate() {
            let n = self.along[0][c].len();
            self.along.iter_mut().for_each(|a| a[c].fill(0.0));
            for a in 0..=u.degree {
                let (value, slope) = u.at(i, a);
                let row = &coordinates[(first + a) * n..][..n];
                accumulate::<FUSED>(&mut self.along[0][c], value, row);
                accumulate::<FUSED>(&mut self.along[1][c], slope, row);
            }
            let targets = [(&mut self.by_u[c], 1, &v.values), (&mut self.by_v[c], 0, &v.slopes)];
            for (out, k, basis) in targets {
                along_v::<FUSED>(v, &self.along[k][c], basis, out);
            }
            if points || rational {
                along_v::<FUSED>(v, &self.along[0][c], &v.values, &mut self.point[c]);
            }
        }
        if rational {
            self.project();
        }
    }

    /// From homogeneous to plane coordinates.
    #[inline(always)]
    fn project(&mut self) {
        for j in 0..self.scaled.len() {
            let w = self.point[2][j];
            for c in 0..2 {
                let x = self.point[c][j] / w;
                self.point[c][j] = x;
                self.by_u[c][j] = (self.by_u[c][j] - self.by_u[2][j] * x) / w;
                self.by_v[c][j] = (self.by_v[c][j] - self.by_v[2][j] * x) / w;
            }
        }
    }

    /// Scaled Jacobians and condition numbers of the row.
    #[inline(always)]
    fn judge(&mut self, sign: f64) {
        let m = self.scaled.len();
        let [ux, uy] = [&self.by_u[0][..m], &self.by_u[1][..m]];
        let [vx, vy] = [&self.by_v[0][..m], &self.by_v[1][..m]];
        let (scaled, condition) = (&mut self.scaled[..m], &mut self.condition[..m]);
        for j in 0..m {
            let a = (ux[j] * ux[j] + uy[j] * uy[j]).sqrt();
            let b = (vx[j] * vx[j] + vy[j] * vy[j]).sqrt();
            let (one_over_a, one_over_b) = (1.0 / a, 1.0 / b);
            let cross =
                (ux[j] * one_over_a) * (vy[j] * one_over_b) - (uy[j] * one_over_a) * (vx[j] * one_over_b);
            let s = if cross.is_nan() { 0.0 } else { (sign * cross).clamp(-1.0, 1.0) };
            // Slopes are per domain: B_u / B_v is this ratio over that of the domains' lengths.
            let ratio = a * one_over_b / self.sheet.aspect;
            scaled[j] = s;
            condition[j] = if s > 0.0 { (ratio + 1.0 / ratio) / s } else { f64::INFINITY };
        }
    }
}

#[inline(always)]
fn accumulate<const FUSED: bool>(out: &mut [f64], factor: f64, row: &[f64]) {
    out.iter_mut().zip(row).for_each(|(o, &x)| *o = fused::<FUSED>(factor, x, *o));
}

/// Sum over the basis functions along v, at all samples.
#[inline(always)]
fn along_v<const FUSED: bool>(v: &GridAxis, coefficients: &[f64], basis: &[f64], out: &mut [f64]) {
    // A loop over ten numbers that is not known to be ten is too short to be made vector instructions of.
    match v.samples {
        USUAL => along_v_in::<FUSED, USUAL>(v, coefficients, basis, out),
        _ => {
            let (order, samples) = (v.degree + 1, v.samples);
            let blocks = basis.chunks_exact(order * samples).zip(out.chunks_exact_mut(samples));
            for ((block, out), &first) in blocks.zip(&v.first) {
                out.fill(0.0);
                for (functions, &c) in block.chunks_exact(samples).zip(&coefficients[first..first + order]) {
                    accumulate::<FUSED>(out, c, functions);
                }
            }
        }
    }
}

/// [`along_v`] for a number of samples known beforehand.
#[inline(always)]
fn along_v_in<const FUSED: bool, const SAMPLES: usize>(
    v: &GridAxis,
    coefficients: &[f64],
    basis: &[f64],
    out: &mut [f64],
) {
    let order = v.degree + 1;
    let (basis, out) = (basis.as_chunks::<SAMPLES>().0, out.as_chunks_mut::<SAMPLES>().0);
    for ((block, out), &first) in basis.chunks_exact(order).zip(out).zip(&v.first) {
        let mut sum = [0.0; SAMPLES];
        for (functions, &c) in block.iter().zip(&coefficients[first..first + order]) {
            for k in 0..SAMPLES {
                sum[k] = fused::<FUSED>(c, functions[k], sum[k]);
            }
        }
        *out = sum;
    }
}

/// [`Range`]s of eight interleaved parts of a row.
struct Ranges {
    min: Lanes,
    max: Lanes,
    sum: Lanes,
}

impl Ranges {
    /// Of a row's numbers.
    #[inline(always)]
    fn of(row: &[f64]) -> Range {
        let infinite = Lanes::splat(f64::INFINITY);
        let mut found = Self { min: infinite, max: -infinite, sum: Lanes::ZERO };
        let (eights, rest) = row.as_chunks::<WIDTH>();
        for &eight in eights {
            let x = Lanes(eight);
            found.min = x.min(found.min);
            found.max = x.max(found.max);
            found.sum = found.sum + x.map(|x| if x < f64::INFINITY { x } else { 0.0 });
        }
        let mut out = Range { min: found.min.least(), max: -(-found.max).least(), sum: found.sum.sum() };
        rest.iter().for_each(|&x| out.add(x));
        out
    }
}

struct Measurement<'a> {
    sheet: &'a Sheet,
    sign: f64,
    excluded: &'a [usize],
}

impl Vectorizable for Measurement<'_> {
    type Output = PatchQuality;

    #[inline(always)]
    fn run<const FUSED: bool>(self) -> PatchQuality {
        let [u, v] = &self.sheet.axes;
        let (rows, columns) = (u.len(), v.len());
        let mut row = Row::new(self.sheet);
        let (mut scaled, mut condition, mut positive) = (Range::EMPTY, Range::EMPTY, 0);
        let (mut worst, mut left_out) = ([u.t[0], v.t[0]], 0);
        for i in 0..rows {
            row.evaluate::<FUSED>(i, false);
            row.judge(self.sign);
            let skip = |corner: usize| {
                let at = (
                    if corner & 1 == 0 { 0 } else { rows - 1 },
                    if corner & 2 == 0 { 0 } else { columns - 1 },
                );
                (at.0 == i).then_some(at.1)
            };
            let mut skipped: Vec<usize> = self.excluded.iter().filter_map(|&c| skip(c)).collect();
            skipped.dedup();
            left_out += skipped.len();
            let (from, to) =
                (usize::from(skipped.contains(&0)), columns - usize::from(skipped.contains(&(columns - 1))));
            let least = scaled.min;
            // A row's own sums: added up one by one, millions of numbers would lose digits.
            let (s, c) = (Ranges::of(&row.scaled[from..to]), Ranges::of(&row.condition[from..to]));
            let count = row.scaled[from..to].iter().filter(|&&x| x > 0.0).count();
            (scaled, condition, positive) = (scaled.join(s), condition.join(c), positive + count);
            if s.min < least {
                let j = (from..to).find(|&j| row.scaled[j] == s.min).unwrap_or(from);
                worst = [u.t[i], v.t[j]];
            }
        }
        let samples = rows * columns - left_out;
        PatchQuality { scaled_jacobian: scaled, condition_number: condition, samples, positive, worst }
    }
}

struct GridSampling<'a> {
    sheet: &'a Sheet,
    sign: f64,
}

impl Vectorizable for GridSampling<'_> {
    type Output = Grid;

    #[inline(always)]
    fn run<const FUSED: bool>(self) -> Grid {
        let shape = [0, 1].map(|d| self.sheet.axes[d].len());
        let mut row = Row::new(self.sheet);
        let (mut points, mut scaled) = (Vec::with_capacity(shape[0] * shape[1]), vec![]);
        let Sheet { origin, unit, .. } = self.sheet;
        for i in 0..shape[0] {
            row.evaluate::<FUSED>(i, true);
            row.judge(self.sign);
            points.extend((0..shape[1]).map(|j| [0, 1].map(|c| origin[c] + unit * row.point[c][j])));
            scaled.extend_from_slice(&row.scaled);
        }
        Grid { shape, points, scaled }
    }
}

impl Sheet {
    /// Number of control points along u.
    fn control_rows(&self) -> usize {
        let u = &self.axes[0];
        u.first[u.first.len() - 1] + u.degree + 1
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn square(points: [[f64; 2]; 4], weights: Option<Vec<f64>>) -> SplinePatch {
        let knots = || vec![0.0, 0.0, 1.0, 1.0];
        SplinePatch {
            degrees: [1, 1],
            knots: [knots(), knots()],
            shape: [2, 2],
            points: points.into(),
            weights,
        }
    }

    #[test]
    fn a_rectangle_has_the_quality_of_its_sides_in_any_unit() {
        for unit in [1.0, 1e-150, 1e150] {
            let x = |x: f64, y: f64| [x * unit, y * unit];
            let patch = square([x(5.0, 5.0), x(5.0, 6.0), x(7.0, 5.0), x(7.0, 6.0)], None);
            let q = measure(&[patch], &[1.0], 5, &[vec![]])[0];
            assert_eq!((q.samples, q.positive), (25, 25));
            for (range, wanted) in [(q.scaled_jacobian, 1.0), (q.condition_number, 2.5)] {
                assert!((range.min - wanted).abs() < 1e-14 && (range.max - wanted).abs() < 1e-14);
                assert!((range.sum - 25.0 * wanted).abs() < 1e-12);
            }
        }
    }

    #[test]
    fn a_degenerate_corner_counts_unless_it_is_left_out() {
        // The corner at the end of u and v lies on the line between its neighbours.
        let patch = square([[0.0, 0.0], [0.0, 1.0], [1.0, 0.0], [0.5, 0.5]], Some(vec![1.0; 4]));
        let with = measure(std::slice::from_ref(&patch), &[1.0], 3, &[vec![]])[0];
        assert_eq!((with.samples, with.positive, with.worst), (9, 8, [1.0, 1.0]));
        assert_eq!(with.condition_number.max, f64::INFINITY);
        let without = measure(&[patch], &[1.0], 3, &[vec![3, 3]])[0];
        assert_eq!((without.samples, without.positive), (8, 8));
        assert!(without.condition_number.max.is_finite() && without.scaled_jacobian.min > 0.1);
    }

    #[test]
    fn the_grid_holds_the_patch_and_mirroring_changes_the_sign() {
        let patch = square([[0.0, 0.0], [0.0, 1.0], [1.0, 0.0], [2.0, 2.0]], None);
        let found = grid(&patch, 1.0, 3);
        assert_eq!(found.shape, [3, 3]);
        assert_eq!(found.points[4], [0.75, 0.75]);
        let mirrored = grid(&patch, -1.0, 3);
        assert!(found.scaled.iter().zip(&mirrored.scaled).all(|(a, b)| *a > 0.0 && *a == -b));
    }
}
