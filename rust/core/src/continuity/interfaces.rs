//! Rows that couple a whole interface, solved for the points that no other interface touches.

use super::Rows;
use super::echelon::echelon;
use super::lift::{Lift, Reduced};
use super::sparse_rows::{SparseRows, Sum};
use crate::numeric::dense::{NoConvergence, product, svd};
use rayon::prelude::*;

/// An interface's own points are solved for where singular values exceed this.
const STRONG: f64 = 1e-2;

/// An interface's rows solved for the points of its own.
struct Solution {
    rows: Vec<usize>,
    /// Points that no other interface touches, and the others.
    own: Vec<usize>,
    rest: Vec<usize>,
    /// How many rows were solved; combinations of the rows are left as equations.
    strong: usize,
    /// (own, rest): own points from the others.
    from_rest: Vec<f64>,
    /// (own, own - strong): own points from new unknowns, which are some of the points themselves.
    null: Vec<f64>,
    /// (rows - strong, rest) and (rows - strong, own - strong): the equations on the others and on the new unknowns.
    at_rest: Vec<f64>,
    at_new: Vec<f64>,
}

/// Solve every interface's rows.
///
/// Unknowns that remain are the points that interfaces share or that have no rows, and those of an interface's own that
/// its rows leave free or determine weakly. Equations are combinations of an interface's rows, and any of them stands
/// for all.
pub(super) fn solved(rows: &Rows, free: &[bool]) -> Result<Reduced, NoConvergence> {
    let n = free.len();
    let owned = owned(rows, free);
    let mut of_interface = vec![vec![]; rows.interface.iter().max().map_or(0, |&i| i + 1)];
    rows.interface.iter().enumerate().for_each(|(row, &i)| of_interface[i].push(row));
    of_interface.retain(|r| !r.is_empty());
    let solutions: Vec<Solution> =
        of_interface.into_par_iter().map(|r| solve(rows, r, &owned)).collect::<Result<_, _>>()?;
    let mut lift = Lift::new(n, (0..n).filter(|&i| free[i] && !owned[i]));
    let new: Vec<_> = solutions.iter().map(|s| lift.add_unknowns(s.own.len() - s.strong)).collect();
    let mut equations = SparseRows::new(lift.width());
    let mut stands_for = vec![];
    let mut sum = Sum::new(lift.width());
    for (solution, new) in solutions.iter().zip(new) {
        let columns: Vec<usize> =
            solution.rest.iter().map(|&point| lift.column(point)).chain(new.clone()).collect();
        let (wide, count) = (solution.rest.len(), new.len());
        let line = |of_rest: &[f64], of_new: &[f64], k: usize| -> Vec<f64> {
            [&of_rest[k * wide..(k + 1) * wide], &of_new[k * count..(k + 1) * count]].concat()
        };
        for (k, &point) in solution.own.iter().enumerate() {
            sum.add_row(1.0, (&columns, &line(&solution.from_rest, &solution.null, k)));
            lift.express(point, &mut sum);
        }
        for (k, &row) in solution.rows[solution.strong..].iter().enumerate() {
            sum.add_row(1.0, (&columns, &line(&solution.at_rest, &solution.at_new, k)));
            sum.finish(&mut equations);
            stands_for.push(row);
        }
    }
    Ok(Reduced { lift, equations, stands_for })
}

/// Free points that the rows of exactly one interface touch.
fn owned(rows: &Rows, free: &[bool]) -> Vec<bool> {
    let mut owner = vec![None; free.len()];
    let mut owned = free.to_vec();
    for (row, &interface) in rows.interface.iter().enumerate() {
        for (point, _) in rows.matrix.entries(row) {
            owned[point] &= *owner[point].get_or_insert(interface) == interface;
        }
    }
    owned.iter().zip(owner).map(|(&owned, owner)| owned && owner.is_some()).collect()
}

fn solve(all: &Rows, rows: Vec<usize>, owned: &[bool]) -> Result<Solution, NoConvergence> {
    let mut used: Vec<usize> = rows.iter().flat_map(|&r| all.matrix.row(r).0).copied().collect();
    used.sort_unstable();
    used.dedup();
    let (own, rest): (Vec<usize>, Vec<usize>) = used.into_iter().partition(|&point| owned[point]);
    let (m, wide, others) = (rows.len(), own.len(), rest.len());
    let (mut at_own, mut at_rest) = (vec![0.0; m * wide], vec![0.0; m * others]);
    for (i, &row) in rows.iter().enumerate() {
        for (point, value) in all.matrix.entries(row) {
            match own.binary_search(&point) {
                Ok(j) => at_own[i * wide + j] = value,
                Err(_) => at_rest[i * others + rest.binary_search(&point).expect("a point")] = value,
            }
        }
    }
    let parts = svd(&at_own, [m, wide], true)?;
    let strong = parts.sigma.iter().filter(|&&s| s > STRONG).count();
    let across: Vec<f64> =
        (0..m).flat_map(|k| (0..m).map(move |i| (i, k))).map(|(i, k)| parts.u[i * m + k]).collect();
    let inside = product(&across, &at_own, [m, m, wide]);
    let outside = product(&across, &at_rest, [m, m, others]);
    let found = echelon(&inside[..strong * wide], [strong, wide]);
    // own = -solution outside + null y with new unknowns y.
    let mut from_rest = product(&found.solution, &outside[..strong * others], [wide, strong, others]);
    from_rest.iter_mut().for_each(|x| *x = -*x);
    let weak = &inside[strong * wide..];
    let mut left = product(weak, &from_rest, [m - strong, wide, others]);
    left.iter_mut().zip(&outside[strong * others..]).for_each(|(x, at)| *x += at);
    let at_new = product(weak, &found.null, [m - strong, wide, wide - strong]);
    Ok(Solution { rows, own, rest, strong, from_rest, null: found.null, at_rest: left, at_new })
}
