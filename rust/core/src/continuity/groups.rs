//! Equations solved group by group, each group tied together by common unknowns.

use super::RANK_TOLERANCE;
use super::consistency::{consistent, missed};
use super::echelon::echelon;
use super::lift::Reduced;
use super::sparse_rows::{SparseRows, Sum};
use crate::numeric::dense::{NoConvergence, product, svd};
use rayon::prelude::*;

/// Rows that boundary values violate by more than this fraction of the model's size contradict them.
const CONSISTENT: f64 = 1e-9;
/// Groups that a thread takes at least: one of an extraordinary vertex is some 50 µs' work, as much as waking a thread.
const A_THREAD: usize = 4;

/// What the equations say about the unknowns.
pub(super) struct Solved {
    /// Number of coordinates that stay free.
    pub width: usize,
    /// From these coordinates to the unknowns, one row each.
    pub null: SparseRows,
    /// From the fixed points to the unknowns, one row each.
    pub particular: SparseRows,
    /// Rows that the fixed points contradict, sorted.
    pub dropped: Vec<usize>,
    /// How many of the others follow from each other.
    pub redundant: usize,
}

/// Equations and unknowns that belong together.
struct Group {
    equations: Vec<usize>,
    unknowns: Vec<usize>,
}

/// What a group's equations say about its unknowns.
struct Solution {
    /// Which equations hold.
    kept: Vec<bool>,
    rank: usize,
    /// (unknowns, unknowns - rank).
    null: Vec<f64>,
    /// (unknowns, equations kept): from the equations' values at the fixed points.
    particular: Vec<f64>,
}

/// Solve the equations for the unknowns; rows that `points` contradict are dropped, the last in `order` first.
pub(super) fn solved(reduced: &Reduced, points: &[[f64; 2]], order: &[i64]) -> Result<Solved, NoConvergence> {
    let tolerance = CONSISTENT * diameter(points);
    let n = points.len();
    let fixed = at_fixed_points(&reduced.equations, n);
    let values = fixed.times(points);
    let (mut dropped, mut redundant) = (vec![], 0);
    for (equation, value) in values.iter().enumerate() {
        if fixed.row(equation).0.len() == reduced.equations.row(equation).0.len() {
            if value.iter().any(|x| x.abs() > tolerance) {
                dropped.push(reduced.stands_for[equation]);
            } else {
                redundant += 1;
            }
        }
    }
    let groups = tied(&reduced.equations, n, reduced.lift.width() - n);
    let one = |group: &Group| {
        let dense = block(&reduced.equations, group, n);
        let at: Vec<[f64; 2]> = group.equations.iter().map(|&e| values[e]).collect();
        let order: Vec<i64> = group.equations.iter().map(|&e| order[reduced.stands_for[e]]).collect();
        solve(dense, &at, tolerance, &order)
    };
    let solutions: Vec<Solution> =
        groups.par_iter().with_min_len(A_THREAD).map(one).collect::<Result<_, _>>()?;
    for (group, solution) in groups.iter().zip(&solutions) {
        let holding = solution.kept.iter().filter(|&&kept| kept).count();
        redundant += holding - solution.rank;
        dropped.extend(
            group.equations.iter().zip(&solution.kept).filter(|e| !e.1).map(|e| reduced.stands_for[*e.0]),
        );
    }
    dropped.sort_unstable();
    let (null, particular) = gathered(&groups, &solutions, &fixed, n, reduced.lift.width() - n);
    Ok(Solved { width: null.width(), null, particular, dropped, redundant })
}

fn diameter(points: &[[f64; 2]]) -> f64 {
    let size = |c: usize| {
        let (low, high) = points
            .iter()
            .fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), p| (low.min(p[c]), high.max(p[c])));
        (high - low).max(0.0)
    };
    size(0).hypot(size(1))
}

/// The part of the equations that concerns points.
fn at_fixed_points(equations: &SparseRows, n: usize) -> SparseRows {
    let mut out = SparseRows::new(n);
    (0..equations.len()).for_each(|e| out.push(equations.entries(e).take_while(|entry| entry.0 < n)));
    out
}

/// Groups in the order of their first equations; their unknowns are sorted.
fn tied(equations: &SparseRows, n: usize, unknowns: usize) -> Vec<Group> {
    let mut root: Vec<usize> = (0..equations.len()).collect();
    let mut first = vec![usize::MAX; unknowns];
    let top = |root: &mut [usize], mut e: usize| {
        while root[e] != e {
            root[e] = root[root[e]];
            e = root[e];
        }
        e
    };
    let of = |e: usize| equations.entries(e).filter_map(move |(column, _)| column.checked_sub(n));
    for e in 0..equations.len() {
        for unknown in of(e) {
            let known = first[unknown];
            first[unknown] = known.min(e);
            if known != usize::MAX {
                let (a, b) = (top(&mut root, known), top(&mut root, e));
                root[a.max(b)] = a.min(b);
            }
        }
    }
    let mut number = vec![usize::MAX; equations.len()];
    let mut groups: Vec<Group> = vec![];
    for e in (0..equations.len()).filter(|&e| of(e).next().is_some()) {
        let head = top(&mut root, e);
        if number[head] == usize::MAX {
            number[head] = groups.len();
            groups.push(Group { equations: vec![], unknowns: vec![] });
        }
        groups[number[head]].equations.push(e);
    }
    for (unknown, &e) in first.iter().enumerate().filter(|u| *u.1 != usize::MAX) {
        groups[number[top(&mut root, e)]].unknowns.push(unknown);
    }
    groups
}

fn block(equations: &SparseRows, group: &Group, n: usize) -> Vec<f64> {
    let wide = group.unknowns.len();
    let mut dense = vec![0.0; group.equations.len() * wide];
    for (line, &e) in dense.chunks_exact_mut(wide).zip(&group.equations) {
        for (column, value) in equations.entries(e).filter(|entry| entry.0 >= n) {
            line[group.unknowns.binary_search(&(column - n)).expect("an unknown of the group")] = value;
        }
    }
    dense
}

/// Solve ``dense y = -fixed``.
fn solve(
    mut dense: Vec<f64>,
    fixed: &[[f64; 2]],
    tolerance: f64,
    order: &[i64],
) -> Result<Solution, NoConvergence> {
    let mut m = fixed.len();
    let n = dense.len() / m;
    let mut kept = vec![true; m];
    let mut parts = svd(&dense, [m, n], false)?;
    let rank = |sigma: &[f64]| sigma.iter().filter(|&&s| s > RANK_TOLERANCE).count();
    // No y reaches what the fixed points leave outside of the range.
    let outside = missed(&parts.u, rank(&parts.sigma), fixed);
    if outside.as_flattened().iter().any(|x| x.abs() > tolerance) {
        kept = consistent(&dense, n, fixed, tolerance, order)?;
        dense = dense
            .chunks_exact(n)
            .zip(&kept)
            .filter(|line| *line.1)
            .flat_map(|line| line.0)
            .copied()
            .collect();
        m = dense.len() / n;
        parts = svd(&dense, [m, n], false)?;
    }
    let k = rank(&parts.sigma);
    // On orthonormal rows: weak ones would lose their digits.
    let found = echelon(&parts.vt[..k * n], [k, n]);
    let wide = parts.sigma.len();
    let back: Vec<f64> = (0..k)
        .flat_map(|j| (0..m).map(move |i| (i, j)))
        .map(|(i, j)| -parts.u[i * wide + j] / parts.sigma[j])
        .collect();
    Ok(Solution { kept, rank: k, null: found.null, particular: product(&found.solution, &back, [n, k, m]) })
}

/// The groups' solutions as matrices; unknowns that no equation touches are coordinates themselves.
fn gathered(
    groups: &[Group],
    solutions: &[Solution],
    fixed: &SparseRows,
    n: usize,
    unknowns: usize,
) -> (SparseRows, SparseRows) {
    let mut member = vec![None; unknowns];
    for (g, group) in groups.iter().enumerate() {
        group.unknowns.iter().enumerate().for_each(|(place, &unknown)| member[unknown] = Some((g, place)));
    }
    let alone = member.iter().filter(|m| m.is_none()).count();
    let mut begin = Vec::with_capacity(groups.len());
    let mut width = alone;
    for (group, solution) in groups.iter().zip(solutions) {
        begin.push(width);
        width += group.unknowns.len() - solution.rank;
    }
    let (mut null, mut particular) = (SparseRows::new(width), SparseRows::new(n));
    let (mut sum, mut next) = (Sum::new(n), 0);
    for of_unknown in member {
        let Some((g, place)) = of_unknown else {
            null.push([(next, 1.0)]);
            particular.push([]);
            next += 1;
            continue;
        };
        let solution = &solutions[g];
        let rest = groups[g].unknowns.len() - solution.rank;
        let line = &solution.null[place * rest..(place + 1) * rest];
        null.push(line.iter().enumerate().filter(|e| *e.1 != 0.0).map(|(j, &v)| (begin[g] + j, v)));
        let kept = groups[g].equations.iter().zip(&solution.kept).filter(|e| *e.1).map(|e| *e.0);
        let m = solution.kept.iter().filter(|&&k| k).count();
        let line = &solution.particular[place * m..(place + 1) * m];
        kept.zip(line).for_each(|(equation, &factor)| sum.add_row(factor, fixed.row(equation)));
        sum.finish(&mut particular);
    }
    (null, particular)
}
