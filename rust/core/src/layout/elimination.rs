//! Linear constraints with coefficients ±1, solved exactly: every unknown as a short combination of free ones.
//!
//! Most constraints of a seamless map say x = ±y + (translations), so unknowns are kept in a forest whose links have a
//! sign and a sum of *parameters* (the translations of seams). What does not fit into a forest, a few equations
//! between roots and parameters, is left to Gauss–Jordan elimination. As coefficients are small whole numbers or
//! halves of such, nothing is rounded, and what unknowns are computed from satisfies the constraints to the last bits.

use std::collections::BTreeMap;

/// A sum of coefficient · variable.
type Row = BTreeMap<usize, f64>;

/// Below it a coefficient, a small multiple of a power of two, is 0.
const ZERO: f64 = 1e-9;

/// Unknowns and parameters with equations between them.
///
/// Variables are numbered: unknowns first, then parameters.
pub(super) struct Elimination {
    parent: Vec<usize>,
    sign: Vec<f64>,
    shift: Vec<Row>,
    parameters: usize,
    rest: Vec<Row>,
}

impl Elimination {
    pub(super) fn new(unknowns: usize, parameters: usize) -> Self {
        Self {
            parent: (0..unknowns).collect(),
            sign: vec![1.0; unknowns],
            shift: vec![Row::new(); unknowns],
            parameters,
            rest: Vec::new(),
        }
    }

    /// Require x = sign · y + sign_p · parameter, for unknowns x and y.
    pub(super) fn tie(&mut self, x: usize, sign: f64, y: usize, parameter: Option<(usize, f64)>) {
        let (x, y) = (self.find(x), self.find(y));
        let first = self.parent.len();
        // s_x r_x + d_x = sign (s_y r_y + d_y) + p
        let mut row = self.shift[y].clone();
        row.values_mut().for_each(|c| *c *= sign);
        if let Some((p, sign)) = parameter {
            add(&mut row, first + p, sign);
        }
        let (shift, own) = (self.shift[x].clone(), self.sign[x]);
        shift.iter().for_each(|(&v, &c)| add(&mut row, v, -c));
        let (root_x, root_y) = (self.parent[x], self.parent[y]);
        let factor = sign * self.sign[y] * own;
        row.values_mut().for_each(|c| *c *= own);
        if root_x == root_y {
            add(&mut row, root_x, factor - 1.0);
            self.rest.push(row);
        } else {
            self.parent[root_x] = root_y;
            self.sign[root_x] = factor;
            self.shift[root_x] = row;
        }
    }

    /// Require x = 0.
    pub(super) fn ground(&mut self, x: usize) {
        let x = self.find(x);
        let mut row = self.shift[x].clone();
        add(&mut row, self.parent[x], self.sign[x]);
        self.rest.push(row);
    }

    /// Link an unknown to its root directly, and all on the way there.
    fn find(&mut self, x: usize) -> usize {
        let mut path = vec![x];
        while self.parent[path[path.len() - 1]] != path[path.len() - 1] {
            path.push(self.parent[path[path.len() - 1]]);
        }
        let root = path.pop().unwrap_or(x);
        // From the root's child downwards: the parent is linked to the root already.
        for &v in path.iter().rev().skip(1) {
            let above = self.parent[v];
            let (sign, mut row) = (self.sign[v], self.shift[above].clone());
            row.values_mut().for_each(|c| *c *= sign);
            self.shift[v].iter().for_each(|(&p, &c)| add(&mut row, p, c));
            self.shift[v] = row;
            self.sign[v] *= self.sign[above];
            self.parent[v] = root;
        }
        x
    }

    /// Solve: for every unknown its combination of the free variables 0..n, and n.
    pub(super) fn solve(mut self) -> (Vec<Vec<(usize, f64)>>, usize) {
        let unknowns = self.parent.len();
        let pivots = gauss_jordan(std::mem::take(&mut self.rest));
        let mut number = vec![None; unknowns + self.parameters];
        let mut free = 0;
        for (variable, slot) in number.iter_mut().enumerate() {
            let depends = variable < unknowns && self.parent[variable] != variable;
            if !depends && !pivots.contains_key(&variable) {
                *slot = Some(free);
                free += 1;
            }
        }
        let combinations = (0..unknowns).map(|x| {
            let x = self.find(x);
            let mut row = self.shift[x].clone();
            add(&mut row, self.parent[x], self.sign[x]);
            let mut out = Row::new();
            for (variable, coefficient) in row {
                match pivots.get(&variable) {
                    None => add(&mut out, variable, coefficient),
                    Some(terms) => {
                        terms.iter().for_each(|(&v, &c)| add(&mut out, v, coefficient * c));
                    }
                }
            }
            out.into_iter().map(|(v, c)| (number[v].expect("a free variable"), c)).collect()
        });
        let combinations = combinations.collect();
        (combinations, free)
    }
}

fn add(row: &mut Row, variable: usize, coefficient: f64) {
    let entry = row.entry(variable).or_insert(0.0);
    *entry += coefficient;
    if entry.abs() < ZERO {
        row.remove(&variable);
    }
}

/// Every pivot variable as a combination of variables that are no pivots.
fn gauss_jordan(rows: Vec<Row>) -> BTreeMap<usize, Row> {
    let mut solved: BTreeMap<usize, Row> = BTreeMap::new();
    for row in rows {
        let mut reduced = Row::new();
        for (variable, coefficient) in row {
            match solved.get(&variable) {
                None => add(&mut reduced, variable, coefficient),
                Some(terms) => terms.iter().for_each(|(&v, &c)| add(&mut reduced, v, coefficient * c)),
            }
        }
        // Of the largest coefficients the last variable, a parameter where there is one.
        let Some((pivot, coefficient)) =
            reduced.iter().map(|(&v, &c)| (v, c)).max_by(|a, b| a.1.abs().total_cmp(&b.1.abs()))
        else {
            continue;
        };
        reduced.remove(&pivot);
        reduced.values_mut().for_each(|c| *c /= -coefficient);
        for terms in solved.values_mut() {
            if let Some(factor) = terms.remove(&pivot) {
                reduced.iter().for_each(|(&v, &c)| add(terms, v, factor * c));
            }
        }
        solved.insert(pivot, reduced);
    }
    solved
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Values of all unknowns for values of the free variables.
    fn values(combinations: &[Vec<(usize, f64)>], free: &[f64]) -> Vec<f64> {
        combinations.iter().map(|row| row.iter().map(|&(v, c)| c * free[v]).sum()).collect()
    }

    #[test]
    fn ties_chain_with_signs_and_parameters() {
        let mut e = Elimination::new(4, 1);
        e.tie(0, -1.0, 1, Some((0, 1.0)));
        e.tie(2, 1.0, 0, None);
        e.tie(3, -1.0, 2, Some((0, -1.0)));
        let (rows, free) = e.solve();
        assert_eq!(free, 2);
        for y in [[1.0, 0.0], [0.5, 2.0]] {
            let x = values(&rows, &y);
            let t = x[0] + x[1];
            assert_eq!(x[2], x[0]);
            assert_eq!(x[3], -x[2] - t);
        }
    }

    #[test]
    fn a_rotation_about_a_point_determines_its_translation() {
        // (u, v) = R (u, v) + t by a quarter turn: u = -v + t0, v = u + t1.
        let mut e = Elimination::new(2, 2);
        e.tie(0, -1.0, 1, Some((0, 1.0)));
        e.tie(1, 1.0, 0, Some((1, 1.0)));
        let (rows, free) = e.solve();
        assert_eq!(free, 2);
        // Any place is a fixed point of one of them.
        let columns = [values(&rows, &[1.0, 0.0]), values(&rows, &[0.0, 1.0])];
        let determinant = columns[0][0] * columns[1][1] - columns[0][1] * columns[1][0];
        assert!(determinant.abs() > 0.1);
    }

    #[test]
    fn redundant_equations_change_nothing() {
        let mut e = Elimination::new(3, 0);
        e.tie(0, 1.0, 1, None);
        e.tie(1, 1.0, 2, None);
        e.tie(2, 1.0, 0, None);
        assert_eq!(e.solve().1, 1);
        let mut e = Elimination::new(3, 0);
        e.tie(0, 1.0, 1, None);
        e.tie(1, 1.0, 2, None);
        e.ground(2);
        let (rows, free) = e.solve();
        assert_eq!((rows, free), (vec![vec![]; 3], 0));
    }
}
