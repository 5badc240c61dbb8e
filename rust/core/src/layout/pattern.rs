//! Where the terms of a sparse symmetric matrix go.

/// Compressed columns of an upper triangle, and the place among its values of every term that it was made of.
pub(super) struct Pattern {
    pub offsets: Vec<usize>,
    pub rows: Vec<usize>,
    pub place: Vec<usize>,
}

impl Pattern {
    /// Pattern of terms (column, row); several terms may share a place.
    pub(super) fn new(columns: usize, terms: &[(usize, usize)]) -> Self {
        let by_row = counted(columns, 0..terms.len(), |t| terms[t].1);
        let order = counted(columns, by_row.into_iter(), |t| terms[t].0);
        let (mut offsets, mut rows) = (vec![0; columns + 1], Vec::new());
        let mut place = vec![0; terms.len()];
        let mut last = None;
        for t in order {
            let (column, row) = terms[t];
            if last != Some((column, row)) {
                last = Some((column, row));
                offsets[column + 1] += 1;
                rows.push(row);
            }
            place[t] = rows.len() - 1;
        }
        for c in 0..columns {
            offsets[c + 1] += offsets[c];
        }
        Self { offsets, rows, place }
    }
}

/// Items in the order of their keys below `n`, and as they came where keys are equal.
fn counted(
    n: usize,
    items: impl ExactSizeIterator<Item = usize> + Clone,
    key: impl Fn(usize) -> usize,
) -> Vec<usize> {
    let mut next = vec![0; n + 1];
    items.clone().for_each(|t| next[key(t) + 1] += 1);
    for k in 0..n {
        next[k + 1] += next[k];
    }
    let mut out = vec![0; items.len()];
    for t in items {
        let slot = &mut next[key(t)];
        out[*slot] = t;
        *slot += 1;
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn terms_of_one_place_share_it() {
        let p = Pattern::new(3, &[(2, 1), (0, 0), (2, 0), (1, 1), (2, 1)]);
        assert_eq!(p.offsets, [0, 1, 2, 4]);
        assert_eq!(p.rows, [0, 1, 0, 1]);
        assert_eq!(p.place, [3, 0, 2, 1, 3]);
    }
}
