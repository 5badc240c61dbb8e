//! Splines from the bytes of a fuzzer: every string of bytes is a valid model, as the Python side hands it over.

/// Reads numbers off a string of bytes; zeros at its end.
pub struct Bytes<'a>(&'a [u8]);

impl<'a> Bytes<'a> {
    /// Start at the first byte.
    pub fn new(data: &'a [u8]) -> Self {
        Self(data)
    }

    /// The next byte.
    pub fn byte(&mut self) -> u8 {
        match self.0.split_first() {
            Some((&first, rest)) => {
                self.0 = rest;
                first
            }
            None => 0,
        }
    }

    /// A number from `low` to `high`.
    pub fn between(&mut self, low: usize, high: usize) -> usize {
        low + self.byte() as usize % (high - low + 1)
    }

    /// A coordinate: a byte says of which kind.
    pub fn coordinate(&mut self) -> f64 {
        let kind = self.byte();
        match kind % 8 {
            // Few different ones, so that points coincide.
            0..=4 => (self.byte() as i8) as f64 / 16.0,
            5 => i16::from_le_bytes([self.byte(), self.byte()]) as f64 / 256.0,
            // Next to another number.
            6 => (self.byte() as i8) as f64 / 16.0 + (self.byte() as i8) as f64 * f64::EPSILON,
            _ => {
                let bits: [u8; 8] = std::array::from_fn(|_| self.byte());
                let x = f64::from_le_bytes(bits);
                if x.abs() <= 1e150 { x } else { 0.0 }
            }
        }
    }

    /// A clamped knot vector with inner multiplicities up to the degree.
    pub fn knots(&mut self, degree: usize, max_inner: usize) -> Vec<f64> {
        let mut t = 0.0;
        let mut knots = vec![t; degree + 1];
        for _ in 0..self.between(0, max_inner) {
            t += self.step();
            let multiplicity = self.between(1, degree);
            knots.resize(knots.len() + multiplicity, t);
        }
        t += self.step();
        knots.resize(knots.len() + degree + 1, t);
        knots
    }

    /// Length of a knot span: mostly ordinary, sometimes tiny or huge.
    fn step(&mut self) -> f64 {
        let b = self.byte();
        if b < 224 { 1.0 + (b % 8) as f64 } else { 10f64.powi(b as i32 - 240) }
    }

    /// A positive weight.
    pub fn weight(&mut self) -> f64 {
        let b = self.byte();
        if b < 240 { 1.0 + (b % 16) as f64 / 4.0 } else { 10f64.powi(b as i32 - 248) }
    }
}

/// Value and derivative of a spline's coefficients at `t`, summed over the span `k`: rows `(weight, slope)`.
pub fn basis(knots: &[f64], degree: usize, k: usize, t: f64) -> (Vec<f64>, Vec<f64>) {
    let (mut values, mut slopes) = (vec![0.0; degree + 1], vec![0.0; degree + 1]);
    patchtransfer_core::spline::basis_on_span(knots, degree, k, t, &mut values, &mut slopes);
    (values, slopes)
}
