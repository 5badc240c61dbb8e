//! All points in terms of fixed points and unknowns.

use super::sparse_rows::{SparseRows, Sum};
use crate::numeric::sparse::NOWHERE;

/// From [fixed points, unknowns] to all points: columns below [`Lift::points`] are points, unknowns come after them.
pub(super) struct Lift {
    /// Column of a point that is fixed or an unknown itself.
    own: Vec<usize>,
    /// Row of `others` for every point that is neither, [`NOWHERE`] for those that are.
    place: Vec<u32>,
    others: SparseRows,
    width: usize,
}

/// What eliminating the first rows leaves to be solved.
pub(super) struct Reduced {
    pub lift: Lift,
    /// Equations between the columns of the lift; of the points only fixed ones occur.
    pub equations: SparseRows,
    /// The row that an equation stands for.
    pub stands_for: Vec<usize>,
}

impl Lift {
    /// All points fixed or unknown themselves; the unknown ones are `masters`, sorted. Up to `width` columns in all.
    pub fn new(points: usize, masters: impl Iterator<Item = usize>) -> Self {
        let mut own: Vec<usize> = (0..points).collect();
        let mut width = points;
        for point in masters {
            own[point] = width;
            width += 1;
        }
        Self { own, place: vec![NOWHERE; points], others: SparseRows::new(usize::MAX), width }
    }

    pub fn points(&self) -> usize {
        self.own.len()
    }

    /// Columns: points and unknowns.
    pub fn width(&self) -> usize {
        self.width
    }

    /// New unknowns that are no points of those given so far.
    pub fn add_unknowns(&mut self, count: usize) -> std::ops::Range<usize> {
        self.width += count;
        self.width - count..self.width
    }

    /// Column of a point that is fixed or an unknown itself.
    pub fn column(&self, point: usize) -> usize {
        self.own[point]
    }

    /// Express a point by a sum.
    pub fn express(&mut self, point: usize, sum: &mut Sum) {
        self.place[point] = self.others.len() as u32;
        sum.finish(&mut self.others);
    }

    /// Columns and coefficients that give a point.
    pub fn of(&self, point: usize) -> (&[usize], &[f64]) {
        match self.place[point] {
            NOWHERE => (std::slice::from_ref(&self.own[point]), &[1.0]),
            place => self.others.row(place as usize),
        }
    }
}
