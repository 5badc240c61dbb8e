use super::*;
use crate::numeric::dense::{product, svd};
use proptest::prelude::*;

/// A matrix from its dense rows.
fn sparse(rows: &[Vec<f64>], width: usize) -> SparseRows {
    let mut out = SparseRows::new(width);
    for row in rows {
        out.push(row.iter().copied().enumerate().filter(|entry| entry.1 != 0.0));
    }
    out
}

fn points(n: usize) -> Vec<[f64; 2]> {
    (0..n).map(|i| [(i as f64 * 1.7).sin(), (i as f64 * 0.9).cos()]).collect()
}

/// Rows that tie random points together; some are substitutions of their last point, which no other needs.
fn random_rows(n: usize, seeds: &[(u64, bool)]) -> (Rows, Vec<Vec<f64>>) {
    let (mut dense, mut slave) = (vec![], vec![]);
    for (k, &(seed, substitution)) in seeds.iter().enumerate() {
        let mut row = vec![0.0; n];
        for e in 0..4 {
            let at = (seed >> (6 * e)) as usize % (n / 2);
            row[at] += ((seed >> (6 * e + 3)) % 17) as f64 / 8.0 - 1.0;
        }
        let own = n / 2 + k % (n / 2);
        if substitution {
            row[own] = -1.0;
        }
        let size = row.iter().map(|x| x * x).sum::<f64>().sqrt();
        if !substitution && size > 0.0 {
            row.iter_mut().for_each(|x| *x /= size);
        }
        slave.push(substitution.then_some(own));
        dense.push(row);
    }
    let m = seeds.len();
    let interface = (0..m).map(|k| k / 3).collect();
    (Rows { matrix: sparse(&dense, n), slave, interface, order: vec![0; m] }, dense)
}

fn dense(z: &CscMatrix<f64>) -> Vec<f64> {
    let mut out = vec![0.0; z.nrows() * z.ncols()];
    z.triplet_iter().for_each(|(i, j, &v)| out[i * z.ncols() + j] = v);
    out
}

fn rank(matrix: &[f64], [m, n]: [usize; 2]) -> usize {
    if m * n == 0 {
        return 0;
    }
    svd(matrix, [m, n], false).unwrap().sigma.iter().filter(|&&s| s > 1e-9).count()
}

proptest! {
    #[test]
    fn the_basis_is_the_null_space(seeds in prop::collection::vec((any::<u64>(), any::<bool>()), 0..12), whole in any::<bool>()) {
        let n = 24;
        let seeds: Vec<_> = seeds.into_iter().map(|(s, sub)| (s, sub && !whole)).collect();
        let (rows, dense_rows) = random_rows(n, &seeds);
        let interior: Vec<usize> = (1..n).filter(|i| i % 5 != 2).collect();
        let x = points(n);
        let space = RowSpace::new(&rows, &interior, &x).unwrap();
        let kept: Vec<usize> = (0..seeds.len()).filter(|r| !space.dropped().contains(r)).collect();
        let b: Vec<f64> = kept.iter().flat_map(|&r| interior.iter().map(move |&i| (r, i))).map(|(r, i)| dense_rows[r][i]).collect();
        let (m, free) = (kept.len(), interior.len());
        let z = dense(space.basis());
        let columns = space.basis().ncols();
        let found = rank(&b, [m, free]);
        prop_assert_eq!(columns, free - found);
        prop_assert_eq!(space.redundant(), m - found);
        prop_assert_eq!(rank(&z, [free, columns]), columns);
        prop_assert!(product(&b, &z, [m, free, columns]).iter().all(|v| v.abs() < 1e-11));
        let there = space.project(&x).unwrap();
        prop_assert!(space.residual(&there) < 1e-10);
        prop_assert!((0..n).all(|i| interior.contains(&i) || there[i] == x[i]));
        // The nearest: what is moved is at right angles to what may move.
        for (_, column) in (0..columns).map(|j| (j, space.basis().col(j))) {
            for c in 0..2 {
                let along: f64 = column.row_indices().iter().zip(column.values()).map(|(&i, v)| v * (there[interior[i]][c] - x[interior[i]][c])).sum();
                prop_assert!(along.abs() < 1e-10);
            }
        }
    }

    #[test]
    fn threads_change_no_bit(seeds in prop::collection::vec((any::<u64>(), any::<bool>()), 12..40)) {
        let n = 120;
        let (rows, _) = random_rows(n, &seeds);
        let interior: Vec<usize> = (0..n).collect();
        let one = |threads| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            let space = pool.install(|| RowSpace::new(&rows, &interior, &points(n))).unwrap();
            (space.basis().clone(), space.particular().clone(), space.project(&points(n)).unwrap())
        };
        let first = one(1);
        for threads in [2, 3] {
            let other = one(threads);
            prop_assert_eq!(&first.0, &other.0);
            prop_assert_eq!(&first.1, &other.1);
            prop_assert_eq!(&first.2, &other.2);
        }
    }
}

#[test]
fn substitutions_in_a_circle_are_refused() {
    let rows = Rows {
        matrix: sparse(&[vec![-1.0, 0.5, 0.5], vec![1.0, -1.0, 0.0]], 3),
        slave: vec![Some(0), Some(1)],
        interface: vec![0, 1],
        order: vec![0, 0],
    };
    let found = RowSpace::new(&rows, &[0, 1], &points(3));
    assert!(matches!(found, Err(ContinuityError::Circle)));
}

#[test]
fn of_rows_that_contradict_each_other_the_first_in_order_stay() {
    let x = [[0.0, 0.0], [1.0, 0.0], [0.4, 0.0], [0.2, 0.3]];
    // Point 2 shall be where point 0 is, and where point 1 is; point 3 lies halfway between 0 and 1.
    let matrix =
        sparse(&[vec![1.0, 0.0, -1.0, 0.0], vec![0.0, 1.0, -1.0, 0.0], vec![0.5, 0.5, 0.0, -1.0]], 4);
    let mut rows =
        Rows { matrix, slave: vec![None, None, Some(3)], interface: vec![0, 1, 2], order: vec![1, 0, 0] };
    let space = RowSpace::new(&rows, &[2, 3], &x).unwrap();
    assert_eq!((space.dropped(), space.redundant(), space.basis().ncols()), (&[0][..], 0, 0));
    let there = space.project(&x).unwrap();
    assert!((there[2][0] - 1.0).abs() < 1e-15 && (there[3][0] - 0.5).abs() < 1e-15);
    assert!(space.residual(&there) < 1e-15);
    // Without slaves all rows of an interface go.
    rows.slave = vec![None; 3];
    rows.interface = vec![0, 0, 2];
    let space = RowSpace::new(&rows, &[2, 3], &x).unwrap();
    assert_eq!((space.dropped(), space.redundant(), space.basis().ncols()), (&[0, 1][..], 0, 1));
}

#[test]
fn the_nearest_points_satisfy_the_chosen_rows() {
    let x = [[0.0, 0.0], [2.0, 0.0], [1.0, 1.0], [1.0, 3.0]];
    let matrix =
        sparse(&[vec![0.5, 0.5, -1.0, 0.0], vec![0.0, 0.0, 1.0, -1.0], vec![1.0, -1.0, 0.0, 0.0]], 4);
    let free = [false, false, true, true];
    let moved = nearest(&matrix, &[0, 2], &free, &x).unwrap();
    assert!((moved[2][1]).abs() < 1e-11 && moved[3] == x[3] && moved[0] == x[0]);
    let both = nearest(&matrix, &[0, 1], &free, &x).unwrap();
    assert!(both[2][1].abs() < 1e-11 && both[3][1].abs() < 1e-11);
    assert_eq!(nearest(&matrix, &[], &free, &x).unwrap(), x);
}
