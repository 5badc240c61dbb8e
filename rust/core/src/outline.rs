//! A closed chain of rational Bézier pieces parameterized by arc length.

/// Pieces of equal degree and the arc lengths at `intervals` equal parameter steps on each of them.
pub struct Outline<'a> {
    /// Homogeneous Bézier points, `degree + 1` a piece.
    pub pieces: &'a [[f64; 3]],
    /// Common degree.
    pub degree: usize,
    /// Increasing arc lengths, `intervals` a piece and the total length.
    pub table: &'a [f64],
    /// Table intervals a piece.
    pub intervals: usize,
}

impl Outline<'_> {
    /// Piece and local parameter at arc length `s`, taken modulo the length; at breaks the later piece, or the
    /// earlier one with `from_left`. Linear in every table interval.
    fn locate(&self, s: f64, from_left: bool) -> (usize, f64) {
        let length = self.table[self.table.len() - 1];
        let mut s = s.rem_euclid(length);
        if from_left && s == 0.0 {
            s = length;
        }
        let after = self.table.partition_point(|&x| if from_left { x < s } else { x <= s });
        let k = after.saturating_sub(1).min(self.table.len() - 2);
        let step = (self.table[k + 1] - self.table[k]).max(f64::MIN_POSITIVE);
        let fraction = ((s - self.table[k]) / step).clamp(0.0, 1.0);
        (k / self.intervals, ((k % self.intervals) as f64 + fraction) / self.intervals as f64)
    }

    /// Point and derivative with respect to the local parameter (de Casteljau).
    pub fn on_piece(&self, piece: usize, t: f64, scratch: &mut Vec<[f64; 3]>) -> ([f64; 2], [f64; 2]) {
        scratch.clear();
        scratch.extend_from_slice(&self.pieces[piece * (self.degree + 1)..][..self.degree + 1]);
        for level in (2..=self.degree).rev() {
            for i in 0..level {
                for d in 0..3 {
                    scratch[i][d] += t * (scratch[i + 1][d] - scratch[i][d]);
                }
            }
        }
        let slope: [f64; 3] = std::array::from_fn(|d| self.degree as f64 * (scratch[1][d] - scratch[0][d]));
        let value: [f64; 3] = std::array::from_fn(|d| scratch[0][d] + t * (scratch[1][d] - scratch[0][d]));
        let point = [value[0] / value[2], value[1] / value[2]];
        (point, std::array::from_fn(|d| (slope[d] - slope[2] * point[d]) / value[2]))
    }

    /// Feet of the perpendiculars from `points`, starting at the arc lengths `s`: `[s, distance]` each.
    ///
    /// Newton steps along the tangent, at most 8 and none longer than `reach`, as long as the distance falls.
    pub fn feet(&self, points: &[[f64; 2]], s: &[f64], reach: &[f64]) -> Vec<[f64; 2]> {
        let small = 1e-9 * self.table[self.table.len() - 1];
        let starts = points.iter().zip(s).zip(reach);
        starts
            .map(|((point, &start), &reach)| {
                let (mut at, mut best) = (start, [start, f64::INFINITY]);
                for _ in 0..8 {
                    let here = self.evaluate(&[at], false)[0];
                    let offset = [point[0] - here[0], point[1] - here[1]];
                    let distance = offset[0].hypot(offset[1]);
                    if distance >= best[1] {
                        break;
                    }
                    best = [at, distance];
                    let step = (offset[0] * here[2] + offset[1] * here[3]).clamp(-reach, reach);
                    if step.abs() <= small {
                        break;
                    }
                    at += step;
                }
                best
            })
            .collect()
    }

    /// Points and unit tangents at the arc lengths `s`, `[x, y, tx, ty]` each.
    pub fn evaluate(&self, s: &[f64], from_left: bool) -> Vec<[f64; 4]> {
        let flat = 1e-9 * self.table[self.table.len() - 1];
        let mut scratch = Vec::with_capacity(self.degree + 1);
        s.iter()
            .map(|&s| {
                let (piece, t) = self.locate(s, from_left);
                let (point, mut d) = self.on_piece(piece, t, &mut scratch);
                if d[0].hypot(d[1]) <= flat {
                    // Coinciding end control points: the direction is the limit from inside.
                    let inside = if t > 0.5 { t - 1e-3 } else { t + 1e-3 };
                    d = self.on_piece(piece, inside, &mut scratch).1;
                }
                let size = d[0].hypot(d[1]).max(f64::MIN_POSITIVE);
                [point[0], point[1], d[0] / size, d[1] / size]
            })
            .collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_square_is_walked_by_arc_length_and_corners_have_two_tangents() {
        let corners = [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]];
        let pieces: Vec<[f64; 3]> =
            (0..4).flat_map(|i| [corners[i], corners[(i + 1) % 4]].map(|c| [c[0], c[1], 1.0])).collect();
        let table: Vec<f64> = (0..=8).map(|k| f64::from(k) / 2.0).collect();
        let outline = Outline { pieces: &pieces, degree: 1, table: &table, intervals: 2 };
        assert_eq!(outline.evaluate(&[1.25, -0.75, 5.0], false)[0], [1.0, 0.25, 0.0, 1.0]);
        assert_eq!(outline.evaluate(&[-0.75], false)[0], [0.0, 0.75, 0.0, -1.0]);
        assert_eq!(outline.evaluate(&[1.0], false)[0], [1.0, 0.0, 0.0, 1.0]);
        assert_eq!(outline.evaluate(&[1.0], true)[0], [1.0, 0.0, 1.0, 0.0]);
        assert_eq!(outline.evaluate(&[0.0], true)[0], [0.0, 0.0, 0.0, -1.0]);
        assert_eq!(
            outline.feet(&[[0.3, -0.5], [1.2, 0.6]], &[0.5, 1.5], &[0.5, 0.5]),
            [[0.3, 0.5], [1.6, 0.19999999999999996]]
        );
    }
}
