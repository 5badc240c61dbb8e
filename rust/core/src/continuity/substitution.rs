//! Rows that express one point, their slave, by others: read as substitutions.

use super::lift::{Lift, Reduced};
use super::sparse_rows::{SparseRows, Sum};
use super::{ContinuityError, Rows};

/// Points that a row expresses, each by the first row that does.
fn substitutions(rows: &Rows, free: &[bool]) -> Vec<Option<usize>> {
    let mut of_point = vec![None; free.len()];
    for (row, slave) in rows.slave.iter().enumerate() {
        if let Some(point) = slave.filter(|&s| free[s]) {
            of_point[point].get_or_insert(row);
        }
    }
    of_point
}

/// Read rows as substitutions, one a slave; the other rows are equations.
pub(super) fn substituted(rows: &Rows, free: &[bool]) -> Result<Reduced, ContinuityError> {
    let row_of = substitutions(rows, free);
    let n = free.len();
    let mut lift = Lift::new(n, (0..n).filter(|&i| free[i] && row_of[i].is_none()));
    let mut sum = Sum::new(lift.width());
    for point in in_order(rows, &row_of)? {
        let row = row_of[point].expect("a slave");
        // Rows are scaled by their factor of the slave, so the others are its substitution.
        for (other, weight) in rows.matrix.entries(row).filter(|e| e.0 != point) {
            sum.add_row(weight, lift.of(other));
        }
        lift.express(point, &mut sum);
    }
    let mut used = vec![false; rows.slave.len()];
    row_of.iter().flatten().for_each(|&row| used[row] = true);
    let stands_for: Vec<usize> = (0..used.len()).filter(|&row| !used[row]).collect();
    let mut equations = SparseRows::new(lift.width());
    for &row in &stands_for {
        rows.matrix.entries(row).for_each(|(point, weight)| sum.add_row(weight, lift.of(point)));
        sum.finish(&mut equations);
    }
    Ok(Reduced { lift, equations, stands_for })
}

/// The slaves, those that others need first.
fn in_order(rows: &Rows, row_of: &[Option<usize>]) -> Result<Vec<usize>, ContinuityError> {
    #[derive(Clone, Copy, PartialEq)]
    enum State {
        New,
        Begun,
        Done,
    }
    let mut state = vec![State::New; row_of.len()];
    let mut order = vec![];
    let mut path = vec![];
    for start in (0..row_of.len()).filter(|&i| row_of[i].is_some()) {
        path.push(start);
        while let Some(&point) = path.last() {
            let row = row_of[point].expect("a slave");
            if state[point] == State::New {
                state[point] = State::Begun;
                for (other, _) in rows.matrix.entries(row) {
                    if other == point || row_of[other].is_none() {
                        continue;
                    }
                    match state[other] {
                        State::New => path.push(other),
                        State::Begun => return Err(ContinuityError::Circle),
                        State::Done => (),
                    }
                }
                continue;
            }
            path.pop();
            if state[point] == State::Begun {
                state[point] = State::Done;
                order.push(point);
            }
        }
    }
    Ok(order)
}
