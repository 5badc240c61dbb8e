//! Orthogonal distance fit of all boundary sides together: the steps of an iteration whose schedule is the caller's.
//!
//! Every side is fitted by itself, but at a smooth joint the legs of both sides lie on one line through the joint, whose
//! angle is found together with those of all others.

use crate::fitting::side_fit::{NOTHING, SideFit, Turning};
use crate::numeric::tridiagonal::solve_cyclic;
use crate::outline::Outline;
use crate::spline::sampled_basis::SampledBasis;
use rayon::prelude::*;

/// Fewer sides than this are not worth a second thread.
pub const FEW_SIDES: usize = 64;
/// Sides handed to a thread at once.
const SIDES_PER_TASK: usize = 16;
/// Lift of the stiffness against turning, relative to its mean: straight sides have none.
const LIFT: f64 = 1e-9;

/// Sides that are fitted together.
pub struct BoundaryFit<'a> {
    outlines: Vec<&'a Outline>,
    bases: &'a [SampledBasis],
    sides: &'a mut [SideFit],
    joints: &'a [[usize; 2]],
}

impl<'a> BoundaryFit<'a> {
    /// Sides of [`SideFit::new`] with what they refer to, and the smooth joints: the sides `[before, after]`, in the order
    /// of the loops.
    pub fn new(
        outlines: Vec<&'a Outline>,
        bases: &'a [SampledBasis],
        sides: &'a mut [SideFit],
        joints: &'a [[usize; 2]],
    ) -> Self {
        Self { outlines, bases, sides, joints }
    }

    fn each(&mut self, work: impl Fn(&mut SideFit, &SampledBasis, &Outline) + Sync) {
        let (outlines, bases) = (&self.outlines, self.bases);
        let one = |side: &mut SideFit| {
            let [basis, outline] = side.refers_to();
            work(side, &bases[basis], outlines[outline]);
        };
        if self.sides.len() < FEW_SIDES {
            self.sides.iter_mut().for_each(one);
        } else {
            self.sides.par_iter_mut().with_min_len(SIDES_PER_TASK).for_each(one);
        }
    }

    /// First fit, with the arc lengths as given (paper Eq. 6).
    pub fn start(&mut self) {
        self.each(|side, basis, outline| {
            side.sample(outline);
            side.linearise(basis, true);
            side.solve(basis);
        });
    }

    /// Slide the samples, after weighting by their residuals if `level`, and set up the normal equations.
    pub fn linearise(&mut self, level: bool) {
        self.each(|side, basis, outline| {
            if level {
                side.level();
            }
            side.slide();
            side.sample(outline);
            side.linearise(basis, false);
        });
    }

    /// Control points of the normal equations' solution.
    pub fn solve(&mut self) {
        self.each(|side, basis, _| side.solve(basis));
    }

    /// See the method of a side.
    pub fn hold_ends(&mut self, most: f64, back: f64) {
        self.each(|side, basis, _| side.hold_ends(basis, most, back));
    }

    /// See the method of a side.
    pub fn errors(&self, whole: bool) -> Vec<f64> {
        self.sides.iter().map(|side| side.error(whole)).collect()
    }

    /// Way that every side backs up against the target; where there is any it has loops or cusps.
    pub fn backwards(&self) -> Vec<f64> {
        self.sides.iter().map(SideFit::backwards).collect()
    }

    /// Put both legs of every smooth joint on the mean of their directions.
    pub fn align(&mut self) {
        for &[before, after] in self.joints {
            // Turning a leg by an angle moves its control point by length * angle: weigh by the squared length.
            let (a, b) = (self.sides[before].legs()[1], self.sides[after].legs()[0]);
            let (length_a, length_b) = (a[0].hypot(a[1]), b[0].hypot(b[1]));
            let mean: [f64; 2] = std::array::from_fn(|d| length_a * a[d] + length_b * b[d]);
            let size = mean[0].hypot(mean[1]);
            let line = if size > 0.0 { mean.map(|x| x / size) } else { self.sides[after].line(0) };
            self.set_line([before, after], line);
        }
    }

    /// Turn the lines at smooth joints, by at most `most`, to the minimiser of the sides' quadratic models, each
    /// counted with its share.
    pub fn turn(&mut self, shares: &[f64], most: f64) {
        let models = self.turning();
        let m = self.joints.len();
        let (mut diagonal, mut right, mut next) = (vec![0.0; m], vec![0.0; m], vec![0.0; m]);
        let size: f64 = models
            .iter()
            .zip(shares)
            .map(|((stiffness, _), share)| {
                share * stiffness.as_flattened().iter().map(|x| x.abs()).sum::<f64>()
            })
            .sum();
        // Joints follow one another along a loop where a side lies between them; a corner or the loop's end is a gap.
        let mut first = 0;
        let mut rings = vec![];
        for (j, &[before, after]) in self.joints.iter().enumerate() {
            let of_before = &models[before];
            let of_after = &models[after];
            diagonal[j] = shares[before] * of_before.0[1][1] + shares[after] * of_after.0[0][0];
            diagonal[j] += LIFT * size / m as f64 + NOTHING;
            right[j] = shares[before] * of_before.1[1] + shares[after] * of_after.1[0];
            let last = j + 1 == m || self.joints[j + 1][0] != after;
            let following = if last { first } else { j + 1 };
            if self.joints[following][0] == after {
                // The model is symmetric up to rounding.
                next[j] = 0.5 * shares[after] * (of_after.0[0][1] + of_after.0[1][0]);
            }
            if last {
                rings.push(first..j + 1);
                first = j + 1;
            }
        }
        for ring in rings {
            solve_cyclic(&diagonal[ring.clone()], &next[ring.clone()], &mut right[ring]);
        }
        for (joint, angle) in right.into_iter().enumerate() {
            let [before, after] = self.joints[joint];
            let (sin, cos) = angle.clamp(-most, most).sin_cos();
            let [x, y] = self.sides[after].line(0);
            let turned = [cos * x - sin * y, cos * y + sin * x];
            let size = turned[0].hypot(turned[1]);
            self.set_line([before, after], turned.map(|x| x / size));
        }
    }

    fn turning(&self) -> Vec<Turning> {
        if self.sides.len() < FEW_SIDES {
            self.sides.iter().map(SideFit::turning).collect()
        } else {
            self.sides.par_iter().with_min_len(SIDES_PER_TASK).map(SideFit::turning).collect()
        }
    }

    /// Put the legs at a joint on the line through it along a unit vector.
    fn set_line(&mut self, [before, after]: [usize; 2], direction: [f64; 2]) {
        self.sides[before].set_line(1, direction);
        self.sides[after].set_line(0, direction);
    }

    /// Control points of all sides, one after the other.
    pub fn control_points(&self) -> Vec<[f64; 2]> {
        self.sides.iter().flat_map(|side| side.control().iter().copied()).collect()
    }
}
